"""The next experiment: which change of the plan best separates what is tied.

Source: docs/model.md (117).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.errors import TssgeomError
from tssgeom.identify.finding import Experiment
from tssgeom.identify.problem import Fit, Problem, columns
from tssgeom.identify.readings import Reading
from tssgeom.identify.stack import Stack, simulated, stacked
from tssgeom.identify.whitening import Weighing
from tssgeom.route.pieces import Arcs

_TOLD = 3  # experiments that are told
_HELD_S = 60.0
_LIMIT = 1e4  # ΔBIC beyond which more says no more


@dataclass(frozen=True, slots=True)
class Plan:
    """One way to run the rig once more."""

    words: str
    changed: Callable[[Reading], Reading]


def _with_drive(reading: Reading, time: Vector, drive: Vector) -> Reading:
    """Return a reading on another course, its temperature held."""
    given = {"time_s": time, reading.drive: drive}
    if "temperature_C" in reading.given:
        given["temperature_C"] = np.interp(time, reading.time, reading.given["temperature_C"])
    measured = {name: np.zeros(len(time)) for name in reading.measured}
    return replace(reading, given=given, measured=measured)


def _faster(reading: Reading) -> Reading:
    return _with_drive(reading, 0.1 * reading.time, reading.given[reading.drive])


def _slower(reading: Reading) -> Reading:
    return _with_drive(reading, 10.0 * reading.time, reading.given[reading.drive])


def _held(reading: Reading) -> Reading:
    """Hold at the highest point."""
    time, drive = reading.time, reading.given[reading.drive]
    top = int(np.argmax(drive)) + 1
    hold = np.linspace(0.0, _HELD_S, 61)[1:]
    later = np.concatenate([time[:top], time[top - 1] + hold, time[top:] + _HELD_S])
    return _with_drive(
        reading, later, np.concatenate([drive[:top], np.full(60, drive[top - 1]), drive[top:]])
    )


def _cycled(reading: Reading) -> Reading:
    time, drive = reading.time, reading.given[reading.drive]
    span = time[-1] - time[0] + float(np.median(np.diff(time)))
    return _with_drive(reading, np.concatenate([time + k * span for k in range(5)]), np.tile(drive, 5))


def _pulled(reading: Reading) -> Reading:
    return _with_drive(reading, reading.time, 2.0 * reading.given[reading.drive])


def _on(bent: Callable[[Arcs], Arcs]) -> Callable[[Reading], Reading]:
    def changed(reading: Reading) -> Reading:
        route = replace(reading.route, name="new route", arcs=bent(reading.route.arcs))
        return replace(reading, route=route)

    return changed


def _straight(arcs: Arcs) -> Arcs:
    return Arcs.exact(arcs.length, 0.05 * arcs.angle)


def _end_unbent(arcs: Arcs) -> Arcs:
    """Put all of the angle into the middle half, so that both ends are straight and radii differ."""
    length, angle = arcs.total_length, arcs.total_angle
    return Arcs.exact(length * np.array([0.25, 0.5, 0.25]), angle * np.array([0.0, 1.0, 0.0]))


def _sharp(arcs: Arcs) -> Arcs:
    """Put the same angle into three sharp bends."""
    length, angle = arcs.total_length, arcs.total_angle
    return Arcs.exact(
        length * np.array([0.1, 0.1, 0.3, 0.1, 0.2, 0.1, 0.1]),
        angle * np.array([0.0, 0.4, 0.0, 0.3, 0.0, 0.3, 0.0]),
    )


MENU = (
    Plan("repeat a run ten times faster", _faster),
    Plan("repeat a run ten times slower", _slower),
    Plan(f"hold for {_HELD_S:g} s at the highest tension of a run", _held),
    Plan("repeat a run with five times the cycles", _cycled),
    Plan("repeat a run with twice the stroke", _pulled),
    Plan("lay the sheath nearly straight and repeat a run", _on(_straight)),
    Plan(
        "lay the sheath with both ends straight and all bends in its middle, and repeat a run",
        _on(_end_unbent),
    ),
    Plan("lay the sheath with the same angle in three sharp bends, and repeat a run", _on(_sharp)),
)
"""What can be measured next with what is there."""


def best_plans(
    problem: Problem, first: Fit, others: Sequence[Fit], names: tuple[str, ...]
) -> list[Experiment]:
    """Return the changes of the plan that best separate a model from those it is tied with."""
    found = []
    for plan in MENU:
        gains = [_expected(problem, first, other, plan) for other in others]
        if min(gains) > 0.0:
            found.append(Experiment(plan.words, min(gains), names))
    found.sort(key=lambda one: -one.expected_delta_bic)
    return found[:_TOLD]


def _expected(problem: Problem, first: Fit, other: Fit, plan: Plan) -> float:
    """Return how much worse the other model would fit one changed run if the first is right; (117)."""
    reading = plan.changed(problem.stack.readings[0])
    stack: Stack = stacked([reading])
    plain = Weighing(stack.noise, np.zeros((stack.size, 0)), np.zeros((0, 0)))
    try:
        truth = simulated(stack, first.at.rig(problem.rig), first.at.effects)
        new = Problem(stack, plain, problem.rig, truth)
        left = new.left(other.at)
        slope = columns(new, other.at, left)
    except TssgeomError:
        return 0.0
    off = plain.weighed(left)
    known = np.linalg.inv(other.covariance)
    step = np.linalg.solve(slope.T @ slope + known, slope.T @ off)
    rest = off - slope @ step
    return float(min(rest @ rest + step @ known @ step, _LIMIT))
