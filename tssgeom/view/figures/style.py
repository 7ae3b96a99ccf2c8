"""Styles of figures: on white, on a dark ground, or for a column of a journal."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Literal

StyleName = Literal["light", "dark", "paper"]
"""`paper`: width of a journal's column, 88 mm, or of its page, 180 mm, and no titles."""

FIXED = "fixed colour"
"""Group id of texts that stand on a colour of their own, so that a dark style leaves them."""

_wanted: ContextVar[StyleName] = ContextVar("style of figures for print", default="light")
_used: ContextVar[StyleName] = ContextVar("style of the figure that is drawn", default="light")


def choose(style: StyleName) -> None:
    """Choose the style of the figures for print that follow; the figures of a page stay as they are."""
    _wanted.set(style)


@contextmanager
def for_print() -> Iterator[None]:
    """Draw figures in the style that was chosen for print."""
    before = _used.set(_wanted.get())
    try:
        yield
    finally:
        _used.reset(before)


def used() -> StyleName:
    """Return the present style of figures."""
    return _used.get()
