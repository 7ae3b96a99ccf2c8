"""What the drive of each run does: levels of tension, passed at a speed, given to the rig as positions."""

from dataclasses import dataclass

import numpy as np

from tests.lumped import Distal, Drive, Path, Physics, simulate

SLOW, MIDDLE, FAST = 3e-4, 1e-3, 3e-3  # m/s
_SAMPLES = 300
_FINER = 8  # steps of a drive with round turns from sample to sample
_REST = 0.04  # of the time in motion, before the first pull


@dataclass(frozen=True, slots=True)
class Course:
    """Levels of proximal tension after the pretension [N], the dwell at each [s], and the speed [m/s]."""

    route: int
    levels: tuple[float, ...]
    dwells: tuple[float, ...]
    speed: float


STEPS = (8.0, 2.5, 12.0, 2.5, 16.0, 2.5)
COURSES = (
    Course(0, STEPS, (0.0,) * 6, SLOW),
    Course(0, (12.0, 2.5, 16.0, 2.5, 8.0, 2.5), (0.0, 0.3, 0.0, 0.0, 0.0, 0.2), FAST),
    Course(1, (15.0, 5.0, 12.0, 2.5), (25.0, 8.0, 0.0, 0.0), SLOW),
    Course(1, (16.0, 7.0, 12.0, 7.0, 16.0, 7.0), (0.0, 0.0, 0.4, 0.0, 0.0, 0.0), FAST),
    Course(2, (10.0, 2.5, 16.0, 5.0, 11.0, 2.5), (0.0, 0.0, 15.0, 0.0, 0.0, 0.0), MIDDLE),
)


@dataclass(frozen=True, slots=True)
class Timed:
    """A course with its times."""

    times: np.ndarray
    """[n] s, of the samples."""
    at: np.ndarray
    """[k] s, of the values."""
    values: np.ndarray
    """[k] m or N, straight lines in between."""


def timed(course: Course, path: Path, believed: Physics, distal: Distal, plan: str) -> Timed:
    """Return times and values that take the nominal rig through the levels.

    Turns and dwells begin at samples, so that none is cut off between two; with "round_turns", each leg is
    half a cosine. The values are positions [m], with "force_driven" proximal tensions [N].
    """
    levels = np.array([believed.pretension_N, *course.levels])
    order = np.arange(len(levels), dtype=float)
    observed = simulate(path, believed, Drive("force", order, levels), distal, order, 1.0)
    there = observed.displacement_in
    spans = np.abs(np.diff(there)) / course.speed
    rest = _REST * spans.sum()
    ends = rest + np.cumsum(spans + np.array([0.0, *course.dwells[:-1]]))
    total = ends[-1] + course.dwells[-1]
    step = round(total / (_SAMPLES - 1), 6)
    wanted = levels if plan == "force_driven" else there
    knots, values = [0.0, rest], [wanted[0], wanted[0]]
    for end, stay, value in zip(ends, course.dwells, wanted[1:], strict=True):
        knots += [end, end + stay] if stay else [end]
        values += [value, value] if stay else [value]
    times = np.round(step * np.arange(_SAMPLES), 6)
    at, what = np.round(step * np.rint(np.array(knots) / step), 6), np.array(values)
    if plan == "round_turns":
        fine = np.linspace(0.0, times[-1], _FINER * (_SAMPLES - 1) + 1)
        return Timed(times, fine, _half_cosines(fine, at, what))
    return Timed(times, times, np.round(np.interp(times, at, what), 9))  # rounding in a dwell would be a turn


def _half_cosines(times: np.ndarray, at: np.ndarray, values: np.ndarray) -> np.ndarray:
    before = np.clip(np.searchsorted(at, times, side="right") - 1, 0, len(at) - 2)
    share = np.clip((times - at[before]) / (at[before + 1] - at[before]), 0.0, 1.0)
    return values[before] + (values[before + 1] - values[before]) * 0.5 * (1.0 - np.cos(np.pi * share))
