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
