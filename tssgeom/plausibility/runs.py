"""The rules on a measured run, all of them, in the order of their weight."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.channel_names import unit_of
from tssgeom.effects import FrictionLaw, LoadLaw, SensorLaw, StretchLaw
from tssgeom.effects.kinds import ANSWERS
from tssgeom.plausibility.digits import digit_remarks
from tssgeom.plausibility.kinds import Remark
from tssgeom.plausibility.limits import LIMITS
from tssgeom.plausibility.motion import motion_remarks
from tssgeom.plausibility.rules import remark
from tssgeom.plausibility.series import DRIVES, TIME, Series, value_remarks
from tssgeom.rig import Rig


def run_remarks(
    columns: Mapping[str, Vector],
    rig: Rig | None = None,
    *,
    length: float | None = None,
    angle: float | None = None,
    fitted: bool = True,
) -> list[Remark]:
    """Return the rules that a run breaks, those that refuse it first.

    Parameters
    ----------
    columns
        `time_s` and channels by their names in SI, [n] each; NaN where a reading is missing.
    rig
        Rig of the run, where there is one.
    length, angle
        Length [m] and total angle [rad] of the route, where they are known.
    fitted
        Whether the run is to be fitted. Else it may be planned: then turns, rest and digits mean nothing.
    """
    run = Series(columns, rig, length, angle)
    if not run.channels or not len(run.time):
        return []
    remarks = [*value_remarks(run), *motion_remarks(run, fitted=fitted), *digit_remarks(run, fitted=fitted)]
    remarks += law_remarks(run)
    return sorted(remarks, key=lambda each: each.severity != "refuse")


def fit_remarks(columns: Mapping[str, Vector]) -> Iterator[Remark]:
    """Yield what a run lacks for a campaign: a drive, a response, and rows with both."""
    drives = [name for name in DRIVES if name in columns]
    if not drives:
        yield remark("no_drive", "campaign", "no drive")
        return
    known = {name: np.isfinite(columns[name]) for name in {*DRIVES, *ANSWERS} if name in columns}
    shared = [
        int(np.count_nonzero(known[drive] & known[other]))
        for drive in drives
        for other in known
        if other != drive
    ]
    if not shared:
        yield remark("no_response", "campaign", "a drive without a response")
    elif max(shared) < LIMITS.fewest_rows:
        both = f"drive and response are both there in {max(shared)} of {len(columns[TIME])} rows"
        yield remark("few_rows", "campaign", both)


def campaign_remarks(runs: Sequence[tuple[str, Mapping[str, Vector]]]) -> Iterator[Remark]:
    """Yield what runs, by name, break together."""
    for (one, columns), (other, others) in combinations(runs, 2):
        same = [name for name in Series(columns).noisy() if name in others]
        if same and all(np.array_equal(columns[name], others[name], equal_nan=True) for name in same):
            yield remark("same_readings", "campaign", f"{one} and {other} have the same readings")


_UNITS = {"tension": "N", "speed": "m/s", "time": "s", "position": "m"}


def law_remarks(run: Series) -> Iterator[Remark]:
    """Yield for each law of the rig that a run leaves its range, above all others by how much."""
    if run.rig is None:
        return
    reached = _reached(run)
    for effect in run.rig.effects:
        over, x = _over(effect)
        if over not in reached:
            continue
        most = reached[over]
        if most > x[-1] + LIMITS.slight * (x[-1] - x[0]):
            unit = _UNITS.get(over, unit_of(over))
            ends = f"the law over {over.replace('_', ' ')} ends at {x[-1]:.3g} {unit}"
            yield remark("beyond_law", "run", f"{ends}, the run goes to {most:.3g} {unit}")


def _over(effect: object) -> tuple[str, tuple[float, ...]]:
    """Return what a law is over and its points; of an effect that is none, nothing."""
    if isinstance(effect, FrictionLaw):
        return effect.over, effect.x
    if isinstance(effect, StretchLaw):
        return "tension", effect.x
    if isinstance(effect, LoadLaw):
        return "joint_angle_rad", effect.x
    if isinstance(effect, SensorLaw):
        return effect.channel if effect.over == "reading" else "time", effect.x
    return "", ()


def _reached(run: Series) -> Mapping[str, float]:
    """Return the greatest value that a run has of each thing a law may be over, in SI."""
    out = {"time": float(np.nanmax(run.time) - np.nanmin(run.time))}
    tensions = [_most(v) for name, v in run.channels.items() if name.startswith("tension")]
    if tensions:
        out["tension"] = max(tensions)
    position = run.channels.get("displacement_in_m")
    if position is not None and len(position) > 1:
        out["position"] = _most(position)
        speed = np.abs(np.diff(position)) / np.maximum(np.diff(run.time), 1e-12)
        there = speed[np.isfinite(speed)]
        out["speed"] = float(np.quantile(there, 0.99)) if len(there) else 0.0
    return out | {name: _most(values) for name, values in run.channels.items()}


def _most(values: Vector) -> float:
    there = values[np.isfinite(values)]
    return float(there.max()) if len(there) else 0.0
