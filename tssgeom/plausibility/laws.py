"""The rule on laws of a rig that are curves: a run goes beyond what they were learnt from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.effects import FrictionLaw, SensorLaw, StretchLaw
from tssgeom.plausibility.limits import LIMITS
from tssgeom.plausibility.rules import Remark, remark
from tssgeom.plausibility.series import Series

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
            unit = _UNITS.get(over, over.rpartition("_")[2])
            ends = f"the law over {over.replace('_', ' ')} ends at {x[-1]:.3g} {unit}"
            yield remark("beyond_law", "run", f"{ends}, the run goes to {most:.3g} {unit}")


def _over(effect: object) -> tuple[str, tuple[float, ...]]:
    """Return what a law is over and its points; of an effect that is none, nothing."""
    if isinstance(effect, FrictionLaw):
        return effect.over, effect.x
    if isinstance(effect, StretchLaw):
        return "tension", effect.x
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
