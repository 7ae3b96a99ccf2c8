"""Messages to the processes beside a stream, packed quickly: numpy's own way takes most of the time."""

from __future__ import annotations

import copyreg
import io
import pickle
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np

_LENGTH = struct.Struct("!I")  # of a message in bytes, before it


def unpacked_array(data: bytes | bytearray, kind: str, shape: tuple[int, ...]) -> np.ndarray:
    """Return an array from its bytes, type and shape; it is read-only unless they are a bytearray."""
    return np.frombuffer(data, kind).reshape(shape)


def _array(array: np.ndarray) -> tuple[Any, ...]:
    """Return how to make an array anew, writable or not as it was: kernels are compiled for each kind."""
    data = bytearray(array.tobytes()) if array.flags.writeable else array.tobytes()
    return unpacked_array, (data, array.dtype.str, array.shape)


class _Packer(pickle.Pickler):
    """Packs arrays as their bytes, type and shape."""

    dispatch_table = copyreg.dispatch_table | {np.ndarray: _array}


def packed(kind: str, content: object) -> bytes:
    """Pack one message, to be taken out by `unpacked`."""
    file = io.BytesIO()
    file.seek(_LENGTH.size)
    _Packer(file, pickle.HIGHEST_PROTOCOL).dump((kind, content))
    file.seek(0)
    file.write(_LENGTH.pack(len(file.getbuffer()) - _LENGTH.size))
    return file.getvalue()


def unpacked(data: bytearray) -> Iterator[tuple[str, Any]]:
    """Take all whole messages out of the bytes so far; they come from the parent process only."""
    while len(data) >= _LENGTH.size and len(data) >= (end := _LENGTH.size + _LENGTH.unpack_from(data)[0]):
        with memoryview(data) as view:
            message = pickle.loads(view[_LENGTH.size : end])
        del data[:end]
        yield message
