"""The version of the installed package: the one origin of `tssgeom.__version__`, `--version` and reports."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("tssgeom")
except PackageNotFoundError:  # run from its sources
    __version__ = "not installed"
