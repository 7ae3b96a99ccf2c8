"""Pages that need no other file: one style, and parts filled into a template."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from string import Template


def filled(template: str, **parts: str) -> str:
    """Return a page: a template of this folder with the common style and its parts filled in."""
    here = files("tssgeom.view.report")
    style = here.joinpath("page.css").read_text("utf-8")
    return Template(here.joinpath(template).read_text("utf-8")).substitute(style=style, **parts)


def program_version() -> str:
    """Return the version of this program."""
    try:
        return version("tssgeom")
    except PackageNotFoundError:
        return "(not installed)"
