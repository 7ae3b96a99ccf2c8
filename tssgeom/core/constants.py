"""Tuned numbers of the compiled core that several parts use: once for C, once for Python."""

from typing import NamedTuple


class NormalMedians(NamedTuple):
    """Medians of standard normal numbers; a sample median over them is a standard deviation or a variance."""

    sd_per_absolute: float = 1.4826
    """Standard deviation over the median absolute value [1]; derived: 1/Φ⁻¹(3/4)."""
    length_2: float = 1.177
    """Of the length of a vector of two components [1]; derived: √(2 ln 2)."""
    square_2: float = 1.386
    """Of the sum of two squares [1]; derived: 2 ln 2."""
    square_3: float = 2.366
    """Of the sum of three squares [1]; derived: χ² of three degrees of freedom."""


MEDIANS = NormalMedians()


class Chance(NamedTuple):
    """How far normal errors go, in standard deviations."""

    clear: float = 3.0
    """From here a number differs from what was expected [1]; derived: 1 of 370 by chance."""
    never: float = 6.0
    """No error of a whole run goes so far [1]; derived: 1 of 10⁹ by chance."""


CHANCE = Chance()


class Rounding(NamedTuple):
    """What is no more than the arithmetic of float64, over the size of the numbers."""

    relative: float = 1e-9
    """Of results of many operations [1]; derived: sums of a thousand terms, solved again and again."""
    exact: float = 1e-12
    """Of results of a few operations [1]; derived."""
    pivot: float = 1e-13
    """What elimination leaves of a pivot that the others determine, of its own size [1]; fitted."""


ROUNDING = Rounding()
