"""Memory that the core is given has a fence at both ends, and holds nothing that makes sense before."""

import math
import threading
from collections import deque

import numpy as np
import pytest

from tssgeom.core import _entries, binding

_FENCE = 64
_BYTE = 0xA5
"""Size [bytes] and content of a fence."""
_WATCHED = 64
"""Arrays that are watched at a time."""


class Fences:
    """Memory with fences, which no entry may change."""

    def __init__(self) -> None:
        self._arrays = deque[np.ndarray]()
        self._work = dict[tuple[int, str], np.ndarray]()

    def _fenced(self, size: int) -> tuple[np.ndarray, np.ndarray]:
        whole = np.full(size + 2 * _FENCE, _BYTE, np.uint8)
        return whole, whole[_FENCE : _FENCE + size]

    def empty(self, shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
        """Return memory for results."""
        whole, inside = self._fenced(math.prod(shape) * dtype.itemsize)
        self._arrays.append(whole)
        if len(self._arrays) > _WATCHED:
            check(self._arrays.popleft())
        made = inside.view(dtype).reshape(shape)
        if dtype == np.float64:
            made[:] = np.nan
        return made

    def scratch(self, name: str, size: int) -> object:
        """Return the address of memory for one call; that of the call before is checked."""
        key = threading.get_ident(), name
        if key in self._work:
            check(self._work[key])
        self._work[key], inside = self._fenced(size)
        inside.view(np.float64)[:] = np.nan
        return binding.from_buffer(inside)

    def check(self) -> None:
        """Compare all fences."""
        for each in (*self._arrays, *self._work.values()):
            check(each)


def check(whole: np.ndarray) -> None:
    """Compare both fences of some memory."""
    fences = np.concatenate((whole[:_FENCE], whole[-_FENCE:]))
    assert (fences == _BYTE).all(), "an entry of the core writes beside the memory that it is given"


@pytest.fixture(autouse=True)
def fences(monkeypatch):
    """Put fences around results and working memory of every entry."""
    made = Fences()
    monkeypatch.setattr(_entries, "empty", made.empty)
    monkeypatch.setattr(_entries, "scratch", made.scratch)
    yield made
    made.check()
