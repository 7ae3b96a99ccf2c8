"""What each outcome of a proposed run would mean: where the models differ most, and on which side of what.

Source: docs/discovery.md, "Designed experiments".
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.channel_names import unit_of
from tssgeom.identify.candidate_models import BASE, CandidateModel
from tssgeom.identify.expected_evidence import Information, Predicted, difference, step_of
from tssgeom.identify.verdict import plain
from tssgeom.identify.waveform import Course
from tssgeom.statistics import EVIDENCE_SCALE

_FACTORS = {"N": (1.0, "N"), "m": (1e3, "mm"), "rad": (1e3, "mrad"), "Nm": (1e3, "mN·m")}
_SYMBOLS = {
    "tension_in_N": "T_in",
    "tension_out_N": "T_out",
    "elongation_m": "δ",
    "displacement_in_m": "x_in",
    "displacement_out_m": "x_out",
    "motor_torque_Nm": "τ_m",
    "joint_angle_rad": "θ_j",
}
_MIDDLE = 0.2  # share of a leg at each end that does not count; chosen: what follows a turn is less sure
_CLEAR = 2.0  # standard deviations by which an outcome is evidence for a model; chosen


@dataclass(frozen=True, slots=True)
class Contrast:
    """One pair of models in a run, the second refitted to the first."""

    true: int
    other: int
    difference: Mapping[str, Vector]
    """[n] By channel [N, m]; NaN where the run has no reading."""
    refitted: Mapping[str, Vector]
    """[n] The other model, by channel."""


def contrasts(run: Predicted, models: Sequence[CandidateModel], total: Information) -> list[Contrast]:
    """Return the first model held against each other one, the base model as the one that is refitted."""
    out = []
    for k in range(1, len(models)):
        pair = (k, 0) if models[k].may_be_true else (0, k)
        off = difference(run, pair, step_of(total, models, pair))
        (left,), (other,) = (run.problem.stack.split(each) for each in (off, run.flat[pair[0]] - off))
        out.append(Contrast(*pair, left, other))
    return out


def words_of(name: str) -> str:
    """Return the name of a model in words."""
    return "friction and compliance alone" if name == BASE else plain(name)


def outcome(
    contrast: Contrast,
    names: tuple[str, str],
    sigma: Mapping[str, Vector],
    course: Course,
    drives: Sequence[str],
) -> tuple[str, str]:
    """Return the channel in which two models differ most, and what each outcome means, a sentence.

    Parameters
    ----------
    contrast
        The two models.
    names
        Of the one that is taken for true, and of the other.
    sigma
        [n] Of the sensors by channel [N, m].
    course, drives
        What the drives do, and which channels they are.
    """
    channel, (start, stop) = _clearest(contrast, sigma, course)
    over_noise = (values / sigma[name] for name, values in contrast.difference.items())
    if sum(float(np.nansum(np.square(each))) for each in over_noise) < EVIDENCE_SCALE.strong:
        return channel, f"it does not separate {words_of(names[0])} from {words_of(names[1])}"
    factor, unit = _FACTORS[unit_of(channel)]
    rows = _inner(course, start, stop)
    other = factor * float(np.mean(contrast.refitted[channel][rows]))
    true = other + factor * float(np.mean(contrast.difference[channel][rows]))
    spread = factor * float(np.mean(sigma[channel][rows]))
    digits = max(0, 1 - math.floor(math.log10(max(abs(true - other), 1e-9))))
    middle = f"{0.5 * (true + other):.{digits}f} {unit}"
    where = f"mean {_SYMBOLS.get(channel, channel)} {_leg(course, start, stop, drives)}"
    expected = (
        f"{where} is {true:.{digits}f} {unit} with {words_of(names[0])} and {other:.{digits}f} {unit} with "
        f"{words_of(names[1])} (sensors ± {_CLEAR * spread:.2g} {unit})"
    )
    above, below = names if true > other else names[::-1]
    if abs(true - other) < _CLEAR * spread:
        return channel, f"{expected}: no leg alone decides, the course over all of them does"
    return channel, (f"{expected}: above {middle} speaks for {words_of(above)}, below for {words_of(below)}")


def _clearest(contrast: Contrast, sigma: Mapping[str, Vector], course: Course) -> tuple[str, tuple[int, int]]:
    """Return the channel and the leg, by its corners, in which the mean difference is largest over noise."""
    best, out = -1.0, ("", (0, 1))
    for channel, values in contrast.difference.items():
        for start, stop in pairwise(range(len(course.corner_time))):
            rows = _inner(course, start, stop)
            size = abs(float(np.mean(values[rows]))) / float(np.mean(sigma[channel][rows]))
            if size > best:
                best, out = size, (channel, (start, stop))
    return out


def _inner(course: Course, start: int, stop: int) -> np.ndarray:
    """Return the samples in the middle of a leg, one at least [n] bool."""
    begin, end = course.corner_time[start], course.corner_time[stop]
    edge = _MIDDLE * (end - begin)
    rows = (course.time >= begin + edge - 1e-9) & (course.time <= end - edge + 1e-9)
    rows[int(np.argmin(np.abs(course.time - 0.5 * (begin + end))))] = True
    return rows


def _leg(course: Course, start: int, stop: int, drives: Sequence[str]) -> str:
    """Return which leg or dwell it is, with its rate and its time."""
    factor, unit = _FACTORS[unit_of(drives[0])]
    before, after = factor * course.corner[start], factor * course.corner[stop]
    begin, end = course.corner_time[start], course.corner_time[stop]
    when, there = f"({begin:.3g} to {end:.3g} s)", f"{', '.join(f'{each:.3g}' for each in after)} {unit}"
    if (before == after).all():
        return f"in the dwell at {there} {when}"
    rate = np.abs(after - before).max() / (end - begin)
    way = "pull" if (after > before).all() else "release" if (after < before).all() else "move"
    way = "turn" if drives[0].endswith("_rad") else way
    return f"in the {way} to {there} at {rate:.2g} {unit}/s {when}"
