"""How Python calls the core: the library, its error codes, and checks at the door."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from tssgeom.core import _declarations
from tssgeom.errors import FitError

ffi: Any = _declarations.ffi
F8, I8, U1, C1 = np.dtype(np.float64), np.dtype(np.int64), np.dtype(np.bool_), np.dtype(np.uint8)


def _library() -> Any:
    """Load the library for this processor; both give the same digits."""
    end = ".dll" if sys.platform == "win32" else ".so"
    here = Path(__file__).parent
    any_processor = ffi.dlopen(str(here / f"_core{end}"))
    faster = here / f"_core_avx2{end}"
    if faster.exists() and any_processor.tss_has_avx2() and not os.environ.get("TSSGEOM_NO_AVX2"):
        return ffi.dlopen(str(faster))
    return any_processor


library = _library()
NULL, from_buffer, new, empty = ffi.NULL, ffi.from_buffer, ffi.new, np.empty

_FAULTS = {  # codes of core.h
    1: "the points give no finite curve: check the unit, and check for outlying points",
    2: "the tendon finds no equilibrium: check stiffness, friction and tension of the rig",
    3: "arrays of the geometry do not belong to each other: this is a fault of the program, please report it",
}
_buffers = threading.local()


def give_way(wait: Callable[[], object]) -> None:
    """Let this thread call `wait` before each entry that takes long: another one may need the interpreter."""
    _buffers.__dict__["wait"] = wait


def scratch(name: str, size: int) -> object:
    """Return the address of so many bytes that an entry may use while it runs; each thread has its own."""
    own = _buffers.__dict__
    if "wait" in own:
        own["wait"]()
    held = own.get(name)
    if held is None or held[0] < size:
        held = size, from_buffer(np.empty(size // 8 + 1))
        _buffers.__dict__[name] = held
    return held[1]


def array(value: object, dtype: np.dtype, changed: bool) -> np.ndarray:
    """Return a contiguous array of the type that an entry takes; one that it changes must be so already."""
    if changed:
        raise TypeError(f"an array that is changed must be contiguous {dtype}")
    return np.ascontiguousarray(value, dtype=dtype)


def wrong(entry: str, name: str, shape: tuple[int, ...], wanted: tuple[int, ...]) -> NoReturn:
    """Refuse an array of another shape than the entry takes."""
    raise ValueError(f"{entry}: {name} has shape {shape}, not {wanted}")


def failed(status: int, entry: str) -> NoReturn:
    """Raise the error of a code that an entry returned.

    Raises
    ------
    FitError
        With the sentence of that code.
    """
    raise FitError(_FAULTS.get(status, f"{entry} cannot be computed (code {status})"))
