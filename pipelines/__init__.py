"""The commands of `tssgeom`: `pipelines.NAME` holds the command NAME with its options."""

from __future__ import annotations


def tssgeom_version() -> str:
    """Return the version of the installed package, or that it is not installed."""
    import tssgeom  # here, since `--help` needs no version

    return tssgeom.__version__
