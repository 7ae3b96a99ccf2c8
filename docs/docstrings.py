"""Texts of docstrings as the pages of the reference have them: units, sentences, cells of tables."""

import ast
import inspect
import re
import sys
import textwrap
from functools import cache
from typing import is_typeddict


def parted(meaning: str) -> tuple[str, str]:
    """Return a docstring without its unit in brackets, and the unit."""
    units = re.findall(r" \[([^\]\d][^\]]*|1(?:/[^\]]+)?)\]", meaning)
    unit = units[0] if units else ""
    return (meaning.replace(f" [{unit}]", "", 1) if units else meaning), unit


@cache
def field_docs(kind: type) -> dict[str, str]:
    """Return the docstring below each field of a class and of those that it inherits from."""
    docs: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        if base.__module__.partition(".")[0] != "tssgeom":
            continue
        (node,) = ast.parse(textwrap.dedent(inspect.getsource(base))).body
        assert isinstance(node, ast.ClassDef)
        for above in node.bases if is_typeddict(kind) else ():  # they are not in its order of resolution
            if (held := getattr(sys.modules[base.__module__], ast.unparse(above), None)) and is_typeddict(
                held
            ):
                docs |= field_docs(held)
        for field, below in zip(node.body, node.body[1:], strict=False):
            match field, below:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
                    docs[name] = " ".join(text.split())
    return docs


def sentences(text: str) -> str:
    """Return a docstring as one paragraph, with links to the model."""
    text = re.sub(r"\bdocs/model\.md\b", "[model.md](../model.md)", " ".join(text.split()))
    return re.sub(r"; docs/(\w+)\.md", r"; [\1.md](../\1.md)", text)


def cell(text: str) -> str:
    """Return text for a cell of a table."""
    text = re.sub(
        r"; model\.md|(?<!\[)docs/model\.md",
        lambda m: m[0].replace("docs/model.md", "[model.md](../model.md)"),
        text,
    )
    return " ".join(text.split()).replace("|", "\\|")


def wrapped(text: str) -> str:
    """Return paragraphs in lines of at most 118 characters."""
    parts = text.split("\n\n")
    return "\n\n".join(
        textwrap.fill(" ".join(part.split()), 118, break_on_hyphens=False, break_long_words=False)
        for part in parts
    )
