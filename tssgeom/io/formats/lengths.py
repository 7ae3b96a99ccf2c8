"""Units of length that a user may state, without imports: every command has the option."""

from typing import Literal

LengthUnit = Literal["mm", "m", "cm", "in", "dm", "um", "nm", "ft", "mil"]
"""Units of length that a user may state: those that names of columns may have, by their symbols."""
