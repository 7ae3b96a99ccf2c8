"""The version of the installed package."""

from importlib.metadata import PackageNotFoundError, version


def tssgeom_version() -> str:
    """Return the version, or say that the package is not installed."""
    try:
        return version("tssgeom")
    except PackageNotFoundError:
        return "not installed"
