"""What changes during a run: friction, compliance and length of the tendon, a bend, the play of the drive."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tests.lumped.physics import Physics
from tests.lumped.route import Path


@dataclass(frozen=True, slots=True)
class Change:
    """One property over time, linear between its times and constant before and after them.

    Changes of the same kind multiply (`friction`, `compliance`) or add up (the others). The friction does not
    depend on the history of its change. Where the compliance changes, the unstretched length stays: a tendon
    that is held and becomes softer loses tension. Creep, a fitting, and friction that does not come from
    tension and turn do not change.
    """

    kind: Literal["friction", "compliance", "length", "bend", "play"]
    """`friction` and `compliance` are factors on that of `Physics` [1]; `length` is what the unstretched
    tendon is longer than before the run [m]; `bend` is a turn of the sheath beside that of the path [rad];
    `play` is beside the backlash of the drive, and is none of the sheath [m]."""
    times: np.ndarray
    """[K] s, increasing."""
    values: np.ndarray
    """[K] In the unit of the kind."""
    start_m: float = 0.0
    """Where it begins, in arc length of the first frame of the path [m]."""
    stop_m: float = math.inf
    """Where it ends; `length` and `bend` are even between both [m]."""

    def __post_init__(self) -> None:
        times, values = np.asarray(self.times, dtype=float), np.asarray(self.values, dtype=float)
        if times.ndim != 1 or times.shape != values.shape or not np.all(np.diff(times) > 0.0):
            raise ValueError(
                f"{self.kind}: times {times.shape}, values {values.shape}: give as many, increasing"
            )
        if self.kind in ("friction", "compliance") and not np.all(values > 0.0):
            raise ValueError(f"{self.kind}: factor {values.min():g}: keep it > 0")
        if not self.stop_m > self.start_m:
            raise ValueError(f"{self.kind} from {self.start_m:g} m to {self.stop_m:g} m: give a stretch")

    def at(self, times: ArrayLike) -> np.ndarray:
        """Return the value at some times."""
        return np.interp(times, self.times, self.values)


class Rows(NamedTuple):
    """What is imposed on a path of n vertices, at P times that hold all knots; linear between."""

    times: np.ndarray  # [P] s
    growth: (
        np.ndarray
    )  # [P, n + 1] m the bars are longer than in the first frame, less the tendon's own length
    turns: np.ndarray  # [P, n] rad
    friction: np.ndarray  # [P, n] factor
    compliance: np.ndarray  # [P, n + 1] factor


def rows(path: Path, physics: Physics, changes: Sequence[Change]) -> Rows:
    """Return a path with its hidden bend and all that changes, at the times of all of them."""
    inside = [change for change in changes if change.kind != "play"]
    times = np.unique(np.concatenate([path.times, *(change.times for change in inside)]))
    at = np.interp(times, path.times, np.arange(len(path.times)))
    bent = physics.bend_at_m - 0.5 * physics.bend_width_m, physics.bend_at_m + 0.5 * physics.bend_width_m
    longer = _between(path.bars - path.bars[0], at)
    turns = _between(path.turns, at) + physics.bend_angle_rad * portions(path.edges, *bent)
    friction, compliance = np.ones_like(turns), np.ones_like(longer)
    ends = np.concatenate(([0.0], np.cumsum(path.bars[0])))
    for change in inside:
        value = change.at(times)[:, None]
        stretch = change.start_m, change.stop_m
        match change.kind:
            case "friction":
                friction *= 1.0 + (value - 1.0) * covered(path.edges, *stretch)
            case "compliance":
                compliance *= 1.0 + (value - 1.0) * covered(ends, *stretch)
            case "length":
                longer = longer - value * portions(ends, *stretch)
            case "bend":
                turns = turns + value * portions(path.edges, *stretch)
    return Rows(times, longer, turns, friction, compliance)


def portions(edges: np.ndarray, start: float, stop: float) -> np.ndarray:
    """[n] Portion of something even from start to stop that lies in each cell; what lies outside is lost."""
    start, stop = np.clip((start, stop), 0.0, edges[-1])
    return np.diff(np.clip(edges, start, stop)) / max(stop - start, 1e-12)


def covered(edges: np.ndarray, start: float, stop: float) -> np.ndarray:
    """[n] How much of each cell lies between start and stop [1]."""
    return np.diff(np.clip(edges, start, stop)) / np.diff(edges)


def _between(frames: np.ndarray, at: np.ndarray) -> np.ndarray:
    before = np.floor(at).astype(int)
    after, share = np.minimum(before + 1, len(frames) - 1), (at - before)[:, None]
    return (1.0 - share) * frames[before] + share * frames[after]


def play_width(physics: Physics, changes: Sequence[Change], grid: np.ndarray) -> np.ndarray:
    """[G] Width of the play of the drive [m]."""
    grown = sum(change.at(grid) for change in changes if change.kind == "play")
    return np.broadcast_to(physics.backlash_m + grown, grid.shape)
