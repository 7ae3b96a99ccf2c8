"""Array aliases: the shape stands in the annotation, the unit in the docstring that uses it."""

from typing import Annotated, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

Vector: TypeAlias = Annotated[NDArray[np.float64], "n"]
"""One number for each of n places."""

Points: TypeAlias = Annotated[NDArray[np.float64], "n 3"]
"""n places in space; a row of NaN is a place that was not seen."""

Matrix: TypeAlias = Annotated[NDArray[np.float64], "m n"]
"""A dense matrix, such as a covariance."""

# To numba a literal argument (-1, True) and one that is left out are types of their own, for which it
# compiles a kernel once more; a numpy scalar has the type of any other number.
NO_INDEX = cast(int, np.int64(-1))
"""No index, as kernels pass it on."""
TRUE = cast(bool, np.bool_(True))
"""True, as kernels pass it on."""


def read_only(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return `array` as contiguous float64 that refuses writes."""
    frozen = np.ascontiguousarray(array, dtype=np.float64)
    if frozen.flags.writeable:
        frozen = frozen.view()
        frozen.flags.writeable = False
    return frozen
