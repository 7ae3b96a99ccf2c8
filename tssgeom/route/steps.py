"""Long fits in steps: a generator stops after each, so that a frame that arrives need not wait.

What it yields is the work of the step in visits of a point, some 0.1 µs each.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeVar

Value = TypeVar("Value")


def at_once(steps: Generator[float, None, Value]) -> Value:
    """Return what steps end with, all made one after the other."""
    while True:
        try:
            next(steps)
        except StopIteration as ended:
            return ended.value
