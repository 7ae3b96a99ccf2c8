"""The table of analyse and batch: a row for each input, in the units that people read."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from pipelines.console import show
from pipelines.work import Options
from tssgeom.effects import named

RADIANS, WARNINGS = "Φ ± s.e.\n[rad]", "warnings"
CLEARANCE = "clearance\n[mm]"
COLUMNS = (
    "shape",
    "points",
    "L\n[mm]",
    "Φ ± s.e.\n[°]",
    RADIANS,
    "pieces",
    "T_in\n[N]",
    "T_out\n[N]",
    "δ ± s.e.\n[mm]",
    WARNINGS,
)


def show_summary(rows: Sequence[dict[str, Any]], chosen: Options) -> None:
    """Print summary rows as a table, with the settings above and the warnings below.

    A recording is told by the range over its frames; the standard errors are those of the frame that stands
    for it, at the last of the highest peaks of T_in.
    """
    measured = any(row.get("clearance_m") is not None for row in rows)
    notes = [f"{row['name']}: {warning}" for row in rows for warning in row["warnings"]]
    columns = (*COLUMNS[:-1], CLEARANCE, WARNINGS) if measured else COLUMNS
    cells = [_cells(row) for row in rows]
    if measured:
        cells = [(*some, _clearance(row), last) for row, (*some, last) in zip(rows, cells, strict=True)]
    show(_title(chosen), columns, cells, notes=notes, optional=(RADIANS, WARNINGS))


def acting(chosen: Options) -> str:
    """Say which effects act, as the end of a title."""
    return f"; with {named(chosen.rig.effects)}" if chosen.rig.effects else ""


def _title(chosen: Options) -> str:
    rig = "the paper's rig" if chosen.rig_file is None else str(chosen.rig_file)
    friction, compliance = chosen.rig.friction.coefficient, chosen.rig.tendon.compliance_per_N
    return (
        f"T_in = {chosen.tension_in:g} N where the file tells none; "
        f"{rig}: μ = {friction:g}, ρ = {compliance:g} /N" + acting(chosen)
    )


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    degrees = math.degrees(1.0)
    angle = (row, "total_angle_rad", row["total_angle_se_rad"])
    times = f" × {row['frames'] - row['rejected']}" if row["timed"] else ""
    return (
        row["name"],
        f"{row['points']}{times}",
        _range(row, "length_m", 1e3, 1),
        _with_error(*angle, degrees, 1),
        _with_error(*angle, 1.0, 3),
        str(row["pieces"]),
        _range(row, "tension_in_N", 1.0, 2),
        _range(row, "tension_out_N", 1.0, 2),
        _with_error(row, "elongation_m", row["elongation_se_m"], 1e3, 3),
        str(len(row["warnings"]) or ""),
    )


def _clearance(row: dict[str, Any]) -> str:
    least = row.get("clearance_m")
    return "" if least is None else f"{1e3 * least:.1f}"


def _with_error(row: dict[str, Any], key: str, error: float, factor: float, usual: int) -> str:
    from tssgeom.view.wording import decimals, plus_minus

    digits = decimals(factor * error, usual)
    return f"{_range(row, key, factor, digits)} {plus_minus(factor * error, usual)}"


def _range(row: dict[str, Any], key: str, factor: float, digits: int) -> str:
    quantity, _, unit = key.rpartition("_")
    low, high = (f"{row[f'{quantity}_{end}_{unit}'] * factor:.{digits}f}" for end in ("min", "max"))
    return low if low == high else f"{low}–{high}"
