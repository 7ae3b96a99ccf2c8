"""Tuned numbers of the compiled core that several parts use: once for C, once for Python."""

import math
from typing import NamedTuple


class WallTolerance(NamedTuple):
    """When numbers of a wall differ by rounding alone."""

    same_point: float = 1e-7
    """Relative to the distance and to the side of a triangle. chosen: above the rounding of a foot."""


WALL = WallTolerance()


class NormalMedians(NamedTuple):
    """Medians of standard normal numbers; a sample median over them is a standard deviation or a variance."""

    sd_per_absolute: float
    """Standard deviation over the median absolute value [1]: 1/Φ⁻¹(3/4)."""
    length_2: float
    """Of the length of a vector of two components [1]."""
    square_2: float
    """Of the sum of two squares [1]."""
    square_3: float
    """Of the sum of three squares [1]: χ² of three degrees of freedom."""


MEDIANS = NormalMedians(
    sd_per_absolute=1.482602,
    length_2=math.sqrt(2.0 * math.log(2.0)),
    square_2=2.0 * math.log(2.0),
    square_3=2.365974,
)


class Chance(NamedTuple):
    """How far normal errors go, in standard deviations."""

    clear: float = 3.0
    """From here a number differs from what was expected [1]; derived: 1 of 370 by chance."""
    rare: float = 4.0
    """Of many numbers hardly one goes so far, and none does without a reason [1]; derived: 1 of 16 000 by
    chance."""
    never: float = 6.0
    """No error of a whole run goes so far [1]; derived: 1 of 10⁹ by chance."""


CHANCE = Chance()


class Rounding(NamedTuple):
    """What is no more than the arithmetic of float64, over the size of the numbers."""

    single: float
    """Of a few operations [1]: eight errors of 2⁻⁵²."""
    relative: float
    """Of results of many operations [1]: 2¹¹ times `exact`, for sums that are solved for."""
    exact: float
    """Of results of some operations, and of a pivot that the others determine [1]: a sum of 2¹¹ terms, each
    with an error of 2⁻⁵²."""


ROUNDING = Rounding(single=2.0 ** (3 - 52), relative=2.0 ** (22 - 52), exact=2.0 ** (11 - 52))
