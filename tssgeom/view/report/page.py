"""Pages that need no other file: one style, and parts filled into a template."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from string import Template

from tssgeom.view.quantities import SYMBOL


def filled(template: str, **parts: str) -> str:
    """Return a page: a template of this folder with the common style and its parts filled in."""
    here = files("tssgeom.view.report")
    style = here.joinpath("page.css").read_text("utf-8")
    return Template(here.joinpath(template).read_text("utf-8")).substitute(style=style, **parts)


def with_subscripts(markup: str) -> str:
    """Write `T_in` in the markup of a page as a symbol with its subscript."""
    return SYMBOL.sub(lambda symbol: f"{symbol[1]}<sub>{symbol[2]}{symbol[3] or ''}</sub>", markup)


def program_version() -> str:
    """Return the version of this program."""
    try:
        return version("tssgeom")
    except PackageNotFoundError:
        return "(not installed)"
