"""Self-contained pages: one style, parts filled into a template, written whole."""

from __future__ import annotations

import os
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path
from string import Template

from tssgeom.errors import require_replaceable, unwritable


def filled(template: str, **parts: str) -> str:
    """Return a page: a template of this folder with the common style and its parts filled in."""
    here = files("tssgeom.view.report")
    style = here.joinpath("page.css").read_text("utf-8")
    return Template(here.joinpath(template).read_text("utf-8")).substitute(style=style, **parts)


def write_page(path: Path, page: str) -> None:
    """Write a page; an older one gives way only when it is done.

    Raises
    ------
    SourceError
        Where the file cannot be written.
    """
    unfinished = path.with_name(f".{path.name}.part")
    try:
        require_replaceable(path)
        unfinished.write_text(page, encoding="utf-8")
        os.replace(unfinished, path)
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        unfinished.unlink(missing_ok=True)


def program_version() -> str:
    """Return the version of this program."""
    try:
        return version("tssgeom")
    except PackageNotFoundError:
        return "(not installed)"
