"""Messages to the processes beside a stream, packed quickly: numpy's own way takes most of the time."""

from __future__ import annotations

import copyreg
import io
import pickle
from typing import Any

import numpy as np


def unpacked_array(data: bytes, kind: str, shape: tuple[int, ...]) -> np.ndarray:
    """Return an array from its bytes, type and shape; it refuses writes, as do those of results."""
    return np.frombuffer(data, kind).reshape(shape)


def _array(array: np.ndarray) -> tuple[Any, ...]:
    return unpacked_array, (array.tobytes(), array.dtype.str, array.shape)


class _Packer(pickle.Pickler):
    """Packs arrays as their bytes, type and shape."""

    dispatch_table = copyreg.dispatch_table | {np.ndarray: _array}


def packed(kind: str, content: object) -> bytes:
    """Pack one message, to be unpacked by `pickle.loads`."""
    file = io.BytesIO()
    _Packer(file, pickle.HIGHEST_PROTOCOL).dump((kind, content))
    return file.getvalue()
