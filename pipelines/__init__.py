"""The commands of `tssgeom`: `pipelines.NAME` holds the command NAME with its options."""

from __future__ import annotations


def tssgeom_version() -> str:
    """Return the version of the installed package, or that it is not installed."""
    from importlib.metadata import PackageNotFoundError, version  # here, since `--help` needs no version

    try:
        return version("tssgeom")
    except PackageNotFoundError:
        return "not installed"
