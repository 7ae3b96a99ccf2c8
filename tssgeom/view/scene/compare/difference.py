"""By how much one recording differs from another, as numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.view.scene.compare.reading import Side

COMPARED = ("tension_in_N", "tension_out_N", "elongation_m")
"""What is compared over time."""
_PARTS = 0.01  # of the greater tension: from there on two lines of tension run apart
_STEPS = 200


@dataclass(frozen=True, slots=True)
class Difference:
    """B less A over the time that both have."""

    time: Vector
    """[s]."""
    values: Mapping[str, Vector]
    """Of each of `COMPARED` [SI]."""

    def rms(self, name: str) -> float:
        """Root mean square over time [SI]."""
        return float(np.sqrt(_mean(self.time, self.values[name] ** 2)))

    def most(self, name: str) -> tuple[float, float]:
        """Return the largest difference with its sign [SI], and when it is [s]."""
        place = int(np.argmax(np.abs(self.values[name])))
        return float(self.values[name][place]), float(self.time[place])


def _mean(time: Vector, values: Vector) -> float:
    span = float(time[-1] - time[0])
    return float(np.trapezoid(values, time)) / span if span > 0 else float(values.mean())


def aligned(a: Side, b: Side) -> tuple[Side, Side]:
    """Return both on one time: as it is where their spans overlap, else each from its own beginning."""
    if a.time is None or b.time is None or _overlap(a.time, b.time) is not None:
        return a, b
    return a.begun_at_zero(), b.begun_at_zero()


def _overlap(a: Vector, b: Vector) -> tuple[float, float] | None:
    begin, end = max(float(a[0]), float(b[0])), min(float(a[-1]), float(b[-1]))
    return (begin, end) if end > begin else None


def difference(a: Side, b: Side) -> Difference | None:
    """Return B less A at every time of either; None where not both have a time in common."""
    if a.time is None or b.time is None:
        return None
    common = _overlap(a.time, b.time)
    if common is None:
        return None
    time = np.union1d(a.time, b.time)
    time = time[(time >= common[0]) & (time <= common[1])]
    values = {
        name: np.interp(time, b.time, b.numbers[name]) - np.interp(time, a.time, a.numbers[name])
        for name in COMPARED
    }
    return Difference(time, values)


def parting(a: Side, b: Side) -> float | None:
    """Return the arc length from which on the tensions differ, each at its greatest pull [m].

    None where they do not, and where they differ from the proximal end on.
    """
    ends = a.frames[a.peak], b.frames[b.peak]
    s = np.linspace(0.0, min(float(frame.s[-1]) for frame in ends), _STEPS)
    first, second = (frame.tension_at(s) for frame in ends)
    apart = np.abs(second - first) > _PARTS * max(float(first.max()), float(second.max()), 1e-12)
    place = int(np.argmax(apart))
    return float(s[place]) if place > 0 else None
