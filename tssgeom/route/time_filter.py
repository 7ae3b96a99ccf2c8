"""Points that are sensed again and again, filtered in time before a route is fitted; docs/model.md (156).

Each point is followed by itself, all with one gain, so that what is left of the noise is as white along the
route as it was. The gain comes from how the smoothest part of all points moves: a route that stands is
averaged over all its frames, one that leaps is followed at once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Points, Vector, read_only
from tssgeom.core.constants import CHANCE, ROUNDING
from tssgeom.core.constants_route import OUTLIERS
from tssgeom.route.directions import NOISE_PRIOR, listed
from tssgeom.route.observations import MIN_POINTS


@dataclass(frozen=True, slots=True)
class FilterLimits:
    """When a filter begins anew, and which points it leaves out."""

    least_step: float = 0.1
    """Time that passes at least between two frames, and one over that after which the filter begins anew
    [usual steps]. Chosen: frames may come in bursts."""
    most_over_spatial: float = 4.0
    """Variance in time over that in one frame, which shows all noise of single points [1]. Chosen."""
    patience: int = 5
    """Frames in a row after which a point that leapt alone, or comes back, is used [1]. Chosen."""
    constant_share: float = 0.2
    """Least share of a stated variance that counts as constant in time [1]. Chosen: what changes is known to
    some 10 % after a few frames."""
    exchanged: float = 0.1
    """Squared distances of two points that are exchanged over those as they came [1]. Chosen."""


FILTER = FilterLimits()
_FAR = CHANCE.never**2  # squared, over noise², the median of all and neighbours: when all move, none leapt
_EXCHANGE = 2  # points
_MOTIONS = 7  # of core/time_filter.c
_CALM = 4  # of them, those that average over frames


class PointFilter(NamedTuple):
    """Points of a frame after the filter, and what it remembers for the next one."""

    points: Points
    """Filtered points; NaN where one is missing [n, 3] [m]."""
    noise: float
    """Standard deviation of a coordinate that is left [m]."""
    sensed_noise: float
    """Standard deviation of a coordinate as sensed, by differences in time [m]."""
    standing: float
    """Probability that the route stands [1]."""
    warnings: tuple[str, ...]
    """Points that leapt alone or are exchanged in this frame."""
    memory: np.ndarray
    """Positions and velocities for each motion, last two frames as sensed, [16, n, 3] [m, m per step]."""
    probability: Vector
    """Probability of each motion, from one that stands to the liveliest [7]."""
    covariance: Matrix
    """For each, of position and velocity, over the variance of the noise [7, 3]."""
    counts: Vector
    """Counts and sums of squares of the noise, and the last step [5]."""
    time: float
    """Time of the frame [s]."""
    interval: float
    """Usual time between frames, 0 where it is not known yet [s]."""
    outlying: Vector
    """For how many frames in a row each point has leapt alone; of a missing one `patience` [n]."""


def begun(points: Points, noise: float, time: float) -> PointFilter | None:
    """Begin with the points of a frame [n, 3] [m] and the noise of their fit [m]; None where most miss."""
    if points.ndim != 2 or points.shape[1] != 3 or np.isinf(points).any():
        return None
    observed = np.isfinite(points).all(axis=1)
    if np.count_nonzero(observed) < max(MIN_POINTS, 0.5 * len(points)):
        return None
    index, filled = np.arange(len(points)), np.array(points)
    for column in () if observed.all() else filled.T:
        column[~observed] = np.interp(index[~observed], index[observed], column[observed])
    memory = np.zeros((2 * _MOTIONS + 2, *filled.shape))
    memory[:_MOTIONS], memory[2 * _MOTIONS :] = filled, points
    covariance = np.zeros((_MOTIONS, 3))
    covariance[:, 0], covariance[1:, 2] = 1.0, 1.0
    noise = max(noise, ROUNDING.relative * float(np.abs(filled).max()))
    counts = NOISE_PRIOR.values * np.array([1.0, noise**2, 1.0, noise**2, 0.0])
    probability = np.full(_MOTIONS, 1.0 / _MOTIONS)
    missing = np.where(observed, 0.0, FILTER.patience)
    return PointFilter(
        points, noise, noise, 0.0, (), memory, probability, covariance, counts, time, 0.0, missing
    )


def filtered(before: PointFilter, points: Points, noise: float, time: float) -> PointFilter | None:
    """Filter the points of the next frame; None where they do not go on from the last one.

    Parameters
    ----------
    before
        The filter after the last frame.
    points
        The same points, in the same order; a row of NaN is a missing one [n, 3] [m].
    noise
        Noise of the last fit, of filtered points [m].
    time
        Time of the frame [s]; where it does not increase, one usual step is taken to have passed.
    """
    if points.shape != before.points.shape or not (
        _complete(points) or np.isfinite(points[~np.isnan(points)]).all()
    ):
        return None
    points = read_only(points)
    passed = time - before.time
    interval = before.interval or (passed if passed > 0.0 else 1.0)
    step = passed / interval if passed > 0.0 else 1.0
    if step > 1.0 / FILTER.least_step:
        return None
    step = max(step, FILTER.least_step)
    last = before.memory[2 * _MOTIONS]
    if points[0, 0] == last[0, 0] and np.array_equal(points, last):  # sent again: it has no new information
        return before._replace(time=time, warnings=())
    most = FILTER.most_over_spatial * (noise * before.sensed_noise / before.noise) ** 2
    before = before._replace(time=time, interval=interval, warnings=())
    after, distance = _advanced(before, points, step, most)
    back = np.flatnonzero((before.outlying >= FILTER.patience) & (distance > _FAR))
    if len(back):
        before = _begun_anew(before, points, back)
        after, distance = _advanced(before, points, step, most)
    if not math.isfinite(after.noise):
        return None
    leapt = _leapt(distance)
    calm = before.probability[:_CALM].sum() > 0.5  # else nothing is known of where a point should be
    if not (calm and 0 < len(leapt) <= max(_EXCHANGE, OUTLIERS.share * len(points))):  # else the route moved
        return after
    expected = np.tensordot(before.probability, _positions(before) + step * _velocities(before), 1)
    points, swapped = _put_back(points, expected, leapt)
    leapt = _alone(np.setdiff1d(leapt, swapped), distance, after.outlying)
    if not (len(swapped) or len(leapt)):
        return after
    points = np.array(points)
    points[leapt] = np.nan
    after, _ = _advanced(before, points, step, most)
    estimate = np.array(after.points)
    estimate[leapt] = np.tensordot(after.probability, _positions(after)[:, leapt], 1)
    outlying = np.array(after.outlying)
    outlying[leapt] = before.outlying[leapt] + 1.0
    return after._replace(points=estimate, outlying=outlying, warnings=_warnings(swapped, leapt))


def noise_left(now: PointFilter, stated: float | None) -> float | None:
    """Return the noise of filtered points [m] where that of a sensor is stated [m]; None where it is not.

    What is stated beyond what changes in time is the same in every frame, and stays; docs/model.md (159).
    """
    if stated is None:
        return None
    constant = stated**2 - now.sensed_noise**2
    if constant < FILTER.constant_share * stated**2:
        constant = 0.0
    return math.sqrt(constant + now.noise**2)


def noise_growth(fitted: float, before: PointFilter | None, now: PointFilter | None) -> float:
    """Return the noise that the fit of a frame may find, over that of the last one [1]; docs/model.md (255).

    Parameters
    ----------
    fitted
        Noise of the last fit [m].
    before, now
        The filter after the last frame and after this one; without a filter, `now` as before it, the points
        are as sensed.
    """
    if before is None:
        return 1.0
    left = before.sensed_noise if now is None else now.noise
    fitted = max(fitted, ROUNDING.exact * before.noise)
    variance = fitted**2 + left**2 - before.noise**2
    if fitted < before.noise:  # no part of it is the same in each frame
        variance = max(variance, (fitted * left / before.noise) ** 2)
    return math.sqrt(variance) / fitted


def smoothed(points: Sequence[Points], times: Sequence[float], noise: float) -> list[PointFilter | None]:
    """Filter recorded frames by those before and after them (Fraser and Potter 1969); model.md (162).

    Parameters
    ----------
    points, times
        The points [n, 3] [m] of each frame, NaN where one is missing, and its time [s].
    noise
        Noise of the fit of one frame [m].
    """
    forward = _passed(points, times, noise)
    backward = _passed(points[::-1], [-time for time in times[::-1]], noise)[::-1]
    return [
        first if first is None or second is None else _combined(first, second, sensed)
        for first, second, sensed in zip(forward, backward, points, strict=True)
    ]


def _passed(points: Sequence[Points], times: Sequence[float], noise: float) -> list[PointFilter | None]:
    """Filter frames in order; those that cannot begin a filter have none."""
    results, last = list[PointFilter | None](), None
    for sensed, time in zip(points, times, strict=True):
        # the noise of a fit of filtered points is less in proportion
        now = None if last is None else filtered(last, sensed, noise * last.noise / last.sensed_noise, time)
        last = begun(sensed, noise, time) if now is None else now
        results.append(last)
    return results


def _combined(before: PointFilter, later_on: PointFilter, sensed: Points) -> PointFilter:
    """Combine the estimate by this frame and those before it with that by this and those after it."""
    own, after = (1.0 / each.noise**2 for each in (before, later_on))
    variance = before.sensed_noise**2
    later = after - 1.0 / variance  # both hold this frame
    if later <= 0.0:
        return before
    from_later = (after * later_on.points - sensed / variance) / later
    points = (own * before.points + later * from_later) / (own + later)
    usable = np.isfinite(points)
    return before._replace(points=np.where(usable, points, before.points), noise=1.0 / math.sqrt(own + later))


def _advanced(before: PointFilter, points: Points, step: float, most: float) -> tuple[PointFilter, Vector]:
    """Filter a frame; returns also how far each point is from where it was expected, squared [noise²]."""
    *state, estimate, distance, variance, sensed, standing = core.filter_in_time(
        before.memory, before.probability, before.covariance, before.counts, points, step, most
    )
    memory, probability, covariance, counts = state
    after = before._replace(
        points=estimate,
        noise=math.sqrt(variance),
        sensed_noise=math.sqrt(sensed),
        standing=standing,
        memory=memory,
        probability=probability,
        covariance=covariance,
        counts=counts,
        outlying=_missing_for(points),
    )
    return after, distance


def _complete(points: Points) -> bool:
    """Whether no coordinate is missing or infinite."""
    return math.isfinite(points.sum())


def _missing_for(points: Points) -> Vector:
    """Count a missing point as if it had leapt for long: it is used when it comes back."""
    if _complete(points):
        return np.zeros(len(points))
    return np.where(np.isnan(points).any(axis=1), FILTER.patience, 0.0)


def _positions(of: PointFilter) -> np.ndarray:
    return of.memory[:_MOTIONS]


def _velocities(of: PointFilter) -> np.ndarray:
    return of.memory[_MOTIONS : 2 * _MOTIONS]


def _leapt(distance: Vector) -> np.ndarray:
    """Points that are far from where they were expected while most are not."""
    if distance.max() <= _FAR:
        return np.empty(0, dtype=np.int64)
    return np.flatnonzero(distance > _FAR * max(1.0, core.median(distance)))


def _alone(leapt: np.ndarray, distance: Vector, missing: Vector) -> np.ndarray:
    """Those whose neighbours are where they were expected; the tip may move by itself."""
    inside = leapt[(leapt > 0) & (leapt < len(distance) - 1)]
    beside = np.where(missing > 0.0, np.inf, distance)
    nearest = np.maximum(beside[inside - 1], beside[inside + 1])
    return inside[distance[inside] > _FAR * nearest]


def _put_back(points: Points, expected: Points, leapt: np.ndarray) -> tuple[Points, np.ndarray]:
    """Put back points that are exchanged [n, 3] [m]; returns also which they were."""
    between = np.linalg.norm(points[leapt, None] - expected[None, leapt], axis=2) ** 2
    own = between.diagonal()
    better = np.triu(between + between.T < FILTER.exchanged * (own[:, None] + own), 1)
    swapped = list[int]()
    for i, j in leapt[np.argwhere(better)].tolist():
        if i not in swapped and j not in swapped:
            swapped += [i, j]
    if swapped:
        points = np.array(points)
        points[swapped] = points[np.array(swapped).reshape(-1, 2)[:, ::-1].ravel()]
    return points, np.array(swapped, dtype=np.int64)


def _begun_anew(before: PointFilter, points: Points, which: np.ndarray) -> PointFilter:
    """Take some points for where they are now, whatever the filter remembers of them."""
    memory = np.array(before.memory)
    memory[:_MOTIONS, which] = points[which]
    memory[_MOTIONS : 2 * _MOTIONS, which] = 0.0
    return before._replace(memory=memory)


def _warnings(swapped: np.ndarray, leapt: np.ndarray) -> tuple[str, ...]:
    """Say which points are exchanged and which leapt alone."""
    warnings = tuple(
        f"points {i} and {j} are exchanged since the last frame: put back"
        for i, j in zip(swapped[::2], swapped[1::2], strict=True)
    )
    if not len(leapt):
        return warnings
    several = f"points {listed(leapt)} leapt" if len(leapt) > 1 else f"point {leapt[0]} leapt"
    return (*warnings, f"{several} while the others did not: taken for where the last frames had it")
