"""The table of analyse and batch: a row for each input, in the units that people read."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any

from pipelines.inputs import MOST_REPORTED, RunSettings
from pipelines.terminal import print_table
from tssgeom.channel_names import marked
from tssgeom.effects import named
from tssgeom.errors import listed

RADIANS, WARNINGS = "Φ ± s.e.\n[rad]", "warnings"
CLEARANCE = "clearance\n[mm]"
REJECTED = "rejected"
_MOVED = (
    0.1  # rad; chosen: bends that take 1 % of a tension at μ = 0.1. Φ of a route that moves, its errors apart
)
COLUMNS = (
    "shape",
    "points",
    "L\n[mm]",
    "Φ ± s.e.\n[°]",
    RADIANS,
    "pieces",
    "T_in\n[N]",
    "T_out ± s.e.\n[N]",
    "δ ± s.e.\n[mm]",
    WARNINGS,
)


def print_summary(
    every: Sequence[dict[str, Any]],
    settings: RunSettings,
    rejected: Sequence[tuple[str, str]] = (),
    most: int | None = None,
) -> None:
    """Print summary rows as a table, with the settings above and the warnings below.

    The first of the rejected inputs, each a source and a reason, are named below too. Of more than `most`
    inputs the first are listed: where a report has all of them.

    A recording is reported by the range over its frames, or by the middle of a range that is less than the
    greatest standard error of these; the standard errors have their range too.
    """
    rows = every[:most]
    more = every[len(rows) :]
    assumed = [row["name"] for row in rows if row.get("tension_in_assumed")]
    has_clearance = any(row.get("clearance_m") is not None for row in rows)
    notes = _warnings(rows)
    if more:
        warned = sum(bool(row["warnings"]) for row in more)
        notes.insert(0, f"and {len(more)} more inputs, {warned} of them with warnings: all are in the report")
    if assumed and not settings.tension_in_given:
        notes.append(
            f"T_in = {settings.tension_in:g} N is assumed (--tension-in): no drive in {listed(assumed)}"
        )
    if not settings.geometry_only and (moved := [row["name"] for row in rows if _is_held(row)]):
        held = f"T_out is that of a tendon held at {settings.tension_in:g} N since the first frame"
        later = f"bends that came later take nothing of it, in {listed(moved)}"
        notes.append(f"{held}; {later}: --geometry-only pulls it anew in each frame")
    columns = (*COLUMNS[:-1], CLEARANCE, WARNINGS) if has_clearance else COLUMNS
    optional = {RADIANS, WARNINGS}
    cells = [_cells(row) for row in rows]
    if has_clearance:
        cells = [(*some, _clearance(row), last) for row, (*some, last) in zip(rows, cells, strict=True)]
    if any(row["rejected"] for row in rows):
        columns = (*columns, REJECTED)
        cells = [(*some, _frames_rejected(row)) for row, some in zip(rows, cells, strict=True)]
    for source, reason in rejected[:MOST_REPORTED]:
        name = PurePath(source).name or source
        notes.append(f"rejected: {name}: {reason.partition(f'{name}: ')[2] or reason}")
    if len(rejected) > MOST_REPORTED:
        notes.append(f"rejected: {len(rejected) - MOST_REPORTED} more, each with its reason in run.json")
    print_table(_title(settings), columns, cells, notes=notes, optional=optional)


def _is_held(row: dict[str, Any]) -> bool:
    """Whether a route moves under a tendon whose drive nobody measured."""
    turned = row["total_angle_max_rad"] - row["total_angle_min_rad"]
    return (
        bool(row.get("tension_in_assumed"))
        and row["timed"]
        and turned > _MOVED + 6 * row["total_angle_se_rad"]
    )


def _frames_rejected(row: dict[str, Any]) -> str:
    return f"{row['rejected']} of {row['frames']} frames" if row["rejected"] else ""


def with_effects(settings: RunSettings) -> str:
    """Return the end of a title that names the effects of the rig; empty where it has none."""
    return f"; with {named(settings.rig.effects)}" if settings.rig.effects else ""


def _title(settings: RunSettings) -> str:
    rig = "the paper's rig" if settings.rig_file is None else str(settings.rig_file)
    friction, compliance = settings.rig.friction.coefficient, settings.rig.tendon.compliance_per_N
    return (
        f"T_in = {settings.tension_in:g} N where the file gives none; "
        f"{rig}: μ = {friction:g}, ρ = {compliance:g} /N" + with_effects(settings)
    )


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    degrees = math.degrees(1.0)
    angle = (row, "total_angle_rad")
    times = f" × {row['frames'] - row['rejected']}" if row["timed"] else ""
    return (
        row["name"],
        f"{row['points']}{times}",
        _range(row, "length_m", 1e3, 1),
        _with_error(*angle, degrees, 1),
        _with_error(*angle, 1.0, 3),
        str(row["pieces"]),
        _range(row, "tension_in_N", 1.0, 2),
        _with_error(row, "tension_out_N", 1.0, 2),
        _with_error(row, "elongation_m", 1e3, 3),
        str(len(row["warnings"]) or ""),
    )


def _clearance(row: dict[str, Any]) -> str:
    least = row.get("clearance_m")
    return "" if least is None else f"{1e3 * least:.1f}"


def _with_error(row: dict[str, Any], key: str, factor: float, digits: int) -> str:
    from tssgeom.view.wording import decimals, plus_minus

    error = row[marked(key, "se_max")]
    low, high = (plus_minus(factor * row[marked(key, f"se_{end}")], digits) for end in ("min", "max"))
    errors = high if low == high else f"{low}–{high.removeprefix('± ')}"
    return f"{_range(row, key, factor, decimals(factor * error, digits), error)} {errors}"


def _range(row: dict[str, Any], key: str, factor: float, digits: int, error: float = 0.0) -> str:
    ends = row[marked(key, "min")], row[marked(key, "max")]
    if ends[1] - ends[0] < error:
        ends = (sum(ends) / 2,) * 2
    low, high = (f"{end * factor:z.{digits}f}" for end in ends)
    return low if low == high else f"{low}–{high}"


def _warnings(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the warnings with the names of their inputs; one that all of several have, once."""
    texts = [list[str](row["warnings"]) for row in rows]
    shared = [text for text in texts[0] if all(text in each for each in texts)] if len(rows) > 1 else []
    of_each = [
        f"{row['name']}: {text}"
        for row, each in zip(rows, texts, strict=True)
        for text in each
        if text not in shared
    ]
    return [f"all {len(rows)} inputs: {text}" for text in shared] + of_each
