"""The version of the installed package."""


def tssgeom_version() -> str:
    """Return the version, or say that the package is not installed."""
    from importlib.metadata import PackageNotFoundError, version  # here, since `--help` needs no version

    try:
        return version("tssgeom")
    except PackageNotFoundError:
        return "not installed"
