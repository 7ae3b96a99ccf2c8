"""Curvature of a fibre as size and direction, `Kappa [1/m]` and `Theta [deg]`: turned to its components."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from tssgeom.io.formats.columns import AXES, BENDS
from tssgeom.io.formats.laboratory.names import split_unit
from tssgeom.io.formats.laboratory.raw import RawTable
from tssgeom.io.formats.laboratory.units import ANGLE, CURVATURE, Unit, unit_of

_WORDS = {
    CURVATURE: ("kappa", "κ", "curvature", "curv", "bend", "magnitude"),
    ANGLE: ("theta", "θ", "phi", "φ", "angle", "direction", "orientation", "bendangle", "bendingangle"),
}


def with_components(table: RawTable, said: Mapping[str, object]) -> RawTable:
    """Return a table whose curvature has two components instead of size and direction.

    One that has not exactly one column of each, with the unit of each, stays as it is.
    """
    sizes, directions = _columns(table.names, table.units, said)
    if len(sizes) != 1 or len(directions) != 1:
        return table
    (size, unit), (direction, angle) = sizes[0], directions[0]
    kappa, theta = table.columns[size], table.columns[direction]
    if not (isinstance(kappa, np.ndarray) and isinstance(theta, np.ndarray)):
        return table
    turned = unit.factor * kappa, angle.factor * theta
    columns, names, units = list(table.columns), list(table.names), list(table.units)
    columns[size], columns[direction] = turned[0] * np.cos(turned[1]), turned[0] * np.sin(turned[1])
    old = names[size], names[direction]
    names[size], names[direction] = (f"{bend}_per_m" for bend in BENDS)
    if units:
        units[size] = units[direction] = ""
    note = (
        f"{old[0]} and {old[1]} read as size and direction of curvature: kappa_x = κ cos θ, kappa_y = κ sin θ"
    )
    return replace(
        table, names=tuple(names), columns=tuple(columns), units=tuple(units), notes=(*table.notes, note)
    )


def has_size(names: Sequence[str]) -> bool:
    """Whether a name is that of the size of a curvature, with its unit."""
    return bool(_columns(names, (), ())[0])


def _columns(
    names: Sequence[str], units: Sequence[str], said: Collection[str]
) -> tuple[list[tuple[int, Unit]], list[tuple[int, Unit]]]:
    """Return the columns of sizes and of directions, by word and unit, which nobody states otherwise.

    None where there are coordinates: what a shape turns may be written beside its points.
    """
    columns: dict[str, list[tuple[int, Unit]]] = {quantity: [] for quantity in _WORDS}
    split = [] if any(split_unit(name)[0].lower() in AXES for name in names) else map(split_unit, names)
    for k, (stem, unit) in enumerate(split):
        unit = unit_of(units[k] if units else "") or unit
        plain = "".join(letter for letter in stem.lower() if letter.isalpha())
        if unit is not None and plain in _WORDS.get(unit.quantity, ()) and names[k] not in said:
            columns[unit.quantity].append((k, unit))
    return columns[CURVATURE], columns[ANGLE]
