"""The pages of the Python names, written before each build into docs/reference; they are not in git."""

import re
import sys
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parents[1]))

import reference


def write(app: Sphinx) -> None:
    """Write the pages that changed."""
    for name, page in reference.python_pages().items():
        path = reference.FOLDER / name
        if not path.exists() or path.read_text("utf-8") != page:
            path.write_text(page, encoding="utf-8")


def as_pages(app: Sphinx, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """Turn the names of documents in docstrings into links, and keep colons in what fields mean."""
    if what == "class" and "Attributes" in lines:
        del lines[lines.index("Attributes") :]  # for `help`; here each field has an entry
    for k, line in enumerate(lines):
        lines[k] = re.sub(r"\bdocs/(\w+)\.md", _linked, line)
    if what in ("attribute", "property", "data"):
        lines[:0] = ["..", ""]  # a comment: napoleon takes what is before a colon in a first line for a type


def shortened(
    app: Sphinx, what: str, name: str, value: Any, options: Any, signature: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    """Write a default that is a whole table of its own by its name alone."""
    if signature is not None:
        signature = re.sub(r"=(\w+)\((?:[^()]|\((?:[^()]|\(\))*\))+\)", r"=\1(...)", signature)
    return signature, returned


def _linked(match: re.Match[str]) -> str:
    page = reference.FOLDER.parent / f"{match[1]}.md"
    return f":doc:`{match[1]}.md </{match[1]}>`" if page.exists() else match[0]


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the pages to Sphinx."""
    app.connect("builder-inited", write)
    app.connect("autodoc-process-docstring", as_pages, priority=400)  # before napoleon's, 500
    app.connect("autodoc-process-signature", shortened)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
