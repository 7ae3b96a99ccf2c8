"""Array aliases: the shape stands in the annotation, the unit in the docstring that uses it."""

from typing import Annotated, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Vector: TypeAlias = Annotated[NDArray[np.float64], "n"]
"""One number for each of n positions."""

Points: TypeAlias = Annotated[NDArray[np.float64], "n 3"]
"""n positions in space; a row of NaN is a missing point."""

Matrix: TypeAlias = Annotated[NDArray[np.float64], "m n"]
"""A dense matrix, such as a covariance."""


def read_only(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return `array` as contiguous float64 that refuses writes."""
    frozen = np.ascontiguousarray(array, dtype=np.float64)
    if frozen.flags.writeable:
        frozen = frozen.view()
        frozen.flags.writeable = False
    return frozen


def rows_at(x: ArrayLike, given: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return rows [n, k], known at increasing `given` [n], at `x` [m] on straight lines between [m, k]."""
    return np.column_stack([np.interp(np.asarray(x), given, column) for column in rows.T])
