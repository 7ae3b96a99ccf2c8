"""The order of the axes in arrays of points: frames, points, coordinates."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from tssgeom.errors import ShapeError

_WAYS = 3.0
"""Way of the points from the first frame to the last, over the extent of the first frame, from which the axes
are the other way round [1]; chosen: a route bends within its length."""


_FEWEST = 4
"""Points of a frame whose coordinates are not the last axis, at least; derived: fewer are no shape."""


@contextmanager
def any_header() -> Iterator[None]:
    """Read headers of arrays without the warnings of their parsers: what is wrong with one is an error.

    NumPy warns where Python 2 wrote it, and Python, which reads it as a literal, of text that is damaged.
    """
    with warnings.catch_warnings():
        for category in (SyntaxWarning, DeprecationWarning):  # from Python 3.12, and before
            warnings.simplefilter("ignore", category)
        warnings.filterwarnings("ignore", "Reading `.npy` or `.npz` file required additional header parsing")
        yield


def order_of_axes(
    path: Path, name: str, shape: tuple[int, ...], frames: int | None = None
) -> tuple[int, ...]:
    """Return the axes of an array as those of [frames, points, 3] or [points, 3].

    The axis of coordinates is the last one, or else the only one of the size 3; that of frames is the first
    of the others, unless the number of `frames` is that of the second one alone.

    Raises ShapeError where it cannot hold points.
    """
    axes = [k for k, size in enumerate(shape) if size == 3]
    order = _order(shape, axes[-1], frames) if axes and len(shape) in (2, 3) and 0 not in shape else ()
    usual = bool(order) and order[-1] == len(shape) - 1
    if not order or not (usual or (len(axes) == 1 and shape[order[-2]] >= _FEWEST)):
        raise ShapeError(
            f"{path}: {name} has the size {shape}: save [F,N,3] or [N,3], of F frames and N points, the "
            "coordinates last (numpy.moveaxis)"
        )
    return order


def _order(shape: tuple[int, ...], last: int, frames: int | None) -> tuple[int, ...]:
    others = [k for k in range(len(shape)) if k != last]
    if len(others) == 2 and shape[others[0]] != frames == shape[others[1]]:
        others.reverse()
    return (*others, last)


def note_of_axes(name: str, order: tuple[int, ...]) -> tuple[str, ...]:
    """Return how an array was read; nothing where its axes are in the usual order."""
    if order == (*range(len(order)),):
        return ()
    letters = ["F", "N", "3"][-len(order) :]
    stored = ",".join(letters[order.index(k)] for k in range(len(order)))
    return (f"{name}[{stored}] read as [{','.join(letters)}]",)


@np.errstate(over="ignore", invalid="ignore")
def require_frames_first(path: Path, name: str, first: np.ndarray, last: np.ndarray) -> None:
    """Refuse an array without times whose first and last row [N, 3] are paths of points, not frames.

    Raises ShapeError where they lie apart by much more than either is long.
    """
    known = np.isfinite(first).all(axis=1) & np.isfinite(last).all(axis=1)
    if not known.any():
        return
    apart = float(np.median(np.linalg.norm(last - first, axis=1)[known]))
    extent = max(float(np.linalg.norm(np.ptp(row[known], axis=0))) for row in (first, last))
    if apart > _WAYS * extent:
        raise ShapeError(
            f"{path}: {name} has frames that span {extent:.3g} and lie {apart:.3g} apart, as points do: save "
            "the axis of frames first (numpy.swapaxes), or the time of each as time_s"
        )
