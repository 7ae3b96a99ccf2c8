"""Points that are sensed again and again, filtered in time before a route is fitted; docs/model.md (156).

Each point is followed by itself, all with one gain, so that what is left of the noise is as white along the
route as it was. The gain comes from how the smoothest part of all points moves: a route that stands is
averaged over all its frames, one that leaps is followed at once. Curvature components of a fibre, [n, 2] in
1/m, are filtered as points [n, 3] in m whose third coordinate is 0.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Points, Vector, read_only
from tssgeom.core.constants import CHANCE, ROUNDING
from tssgeom.core.constants_route import OUTLIERS, POINTS
from tssgeom.route.directions import NOISE_PRIOR
from tssgeom.route.exchanges import is_shorter, named, order_of
from tssgeom.route.filter_limits import FAR, FILTER, alone, leap_warning, leapt_points
from tssgeom.route.lost_ends import LostEnds, carried_on, has_leapt, rows_of, taken
from tssgeom.route.observations import MIN_POINTS
from tssgeom.statistics import EVEN, EVIDENCE_SCALE

_FEWEST = 2  # points that may leap alone, of however few; chosen
_MOTIONS = 7  # of core/time_filter.c
_CALM = 4  # of them, those that average over frames


class Turning(NamedTuple):
    """The component of curvatures that Φ depends on, filtered by how it moves itself; docs/model.md (282)."""

    cell: Vector
    """Length of the stretch that each grating stands for [n] [m]."""
    direction: Points
    """Unit vector of the component [n, 3] [1]."""
    size: float
    """Change of Φ with the component [m]."""
    noise: float
    """Standard deviation of the component that is left [1/m]."""
    of_its_own: PointFilter
    """The filter whose gain comes from this component."""


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
    remarks: tuple[str, ...]
    """Points that leapt alone in this frame, or were exchanged before it, a sentence each."""
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
    coordinates: int
    """Coordinates that are sensed: 3 of a point, 2 of the curvature of a fibre."""
    turning: Turning | None = None
    """Of a fibre, the component of its curvatures that Φ depends on."""
    order: np.ndarray | None = None
    """Row of each point as it came, where points of this frame are exchanged; -1 where it lacks one [n]."""
    lost: LostEnds | None = None
    """Ends that are missing in this frame, and are carried on."""
    reordered: bool = False
    """Whether it was those of the frames before that were exchanged, as the fit of the last one."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to know of the points of this frame, a sentence each."""
        if self.order is None and self.lost is None:
            return self.remarks
        order = () if self.order is None else named(self.order)
        put_back = (f"{name} are exchanged in this frame: put back" for name in order)
        return (*put_back, *self.remarks, *(() if self.lost is None else (self.lost.warning,)))

    @property
    def stands(self) -> bool | None:
        """Whether the route stands; None where that is not known yet."""
        if self.interval == 0.0:
            return None
        if self.standing > EVEN:
            return True
        return None if self.standing > EVIDENCE_SCALE.false_alarms else False  # it takes frames to show


def begun(points: Points, noise: float, time: float, cell: Vector | None = None) -> PointFilter | None:
    """Begin with the points of a frame [n, 3] [m] and the noise of their fit [m]; None where most miss.

    Of curvatures [n, 2] [1/m] also the lengths of the stretches are given that each grating stands for [m].
    """
    if points.ndim != 2 or points.shape[1] not in (2, 3) or np.isinf(points).any():
        return None
    coordinates, points = points.shape[1], as_points(points)
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
    known = (memory, probability, covariance, counts)
    first = PointFilter(points, noise, noise, 0.0, (), *known, time, 0.0, missing, coordinates)
    if cell is None:
        return first
    return first._replace(turning=Turning(cell, np.zeros_like(filled), 0.0, noise, first))


def filtered(
    before: PointFilter, points: Points, noise: float, time: float, *, may_lack: bool = True
) -> PointFilter | None:
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
    may_lack
        Whether a few points that were in the last frame may not be listed in this one.
    """
    lacks, rows = len(points) < len(before.points), None
    if lacks and may_lack and before.coordinates == 3 and points.shape[1:] == (3,):
        rows = rows_of(points, np.tensordot(before.probability, _positions(before), 1))
        points = points if rows is None else taken(points, rows)
    after = _filtered(before, points, noise, time)
    if after is not None and rows is not None:
        after = after._replace(order=rows if after.order is None else rows[after.order])
    if after is None or before.coordinates < 3 or _complete(after.points[[0, -1]]):
        return after
    return _with_ends(before, after)


def _filtered(before: PointFilter, points: Points, noise: float, time: float) -> PointFilter | None:
    """Do as `filtered`, and leave what is missing out."""
    if points.shape != (len(before.points), before.coordinates) or not (
        _complete(points) or np.isfinite(points[~np.isnan(points)]).all()
    ):
        return None
    points = np.ascontiguousarray(as_points(points), dtype=np.float64)
    passed = time - before.time
    interval = before.interval or (passed if passed > 0.0 else 1.0)
    step = passed / interval if passed > 0.0 else 1.0
    if step > 1.0 / FILTER.least_step:
        return None
    step = max(step, FILTER.least_step)
    if _is_sent_again(before, points):  # it has no new information
        return before._replace(time=time, remarks=(), reordered=False)
    most = FILTER.most_over_spatial * (noise * before.sensed_noise / before.noise) ** 2
    before = before._replace(time=time, interval=interval, remarks=(), order=None, lost=None, reordered=False)
    after, distance = _advanced(before, points, step, most)
    if distance.max() <= FAR:
        return _turned(before, after, points, step, most) if math.isfinite(after.noise) else None
    ordered = _in_order(before, points, step, distance)
    if ordered is not None:
        before, points = ordered
        after, distance = _advanced(before, points, step, most)
    back = np.flatnonzero((before.outlying >= FILTER.patience) & (distance > FAR))
    if len(back):
        before = _begun_anew(before, points, back)
        after, distance = _advanced(before, points, step, most)
    if not math.isfinite(after.noise):
        return None
    leapt = leapt_points(distance)
    calm = before.probability[:_CALM].sum() > 0.5  # else nothing is known of where a point should be
    if not (calm and 0 < len(leapt) <= max(_FEWEST, OUTLIERS.share * len(points))):  # else the route moved
        return _turned(before, after, points, step, most)
    leapt = alone(leapt, distance, after.outlying)
    if not len(leapt):
        return _turned(before, after, points, step, most)
    points = np.array(points)
    points[leapt] = np.nan
    after, _ = _advanced(before, points, step, most)
    estimate = np.array(after.points)
    estimate[leapt] = np.tensordot(after.probability, _positions(after)[:, leapt], 1)
    outlying = np.array(after.outlying)
    outlying[leapt] = before.outlying[leapt] + 1.0
    remarks = (*before.remarks, leap_warning(leapt, before.coordinates))
    after = after._replace(points=estimate, outlying=outlying, remarks=remarks)
    return _turned(before, after, points, step, most)


def _turned(before: PointFilter, after: PointFilter, points: Points, step: float, most: float) -> PointFilter:
    """Take the component that Φ depends on from the filter that follows how it moves; docs/model.md (282).

    All gratings may move as one while the smoothest components, taken together, seem to stand.
    """
    turning = before.turning
    if turning is None:
        return after
    used = np.nan_to_num(before.points)
    square = np.einsum("ic,ic->i", used, used)
    clear = np.sqrt(square) / (square + (CHANCE.clear * before.noise) ** 2)
    change = used * (turning.cell * clear)[:, None]
    size = float(np.linalg.norm(change))
    direction = change / size if size > 0.0 else change
    own, _ = _advanced(turning.of_its_own, points, step, most, direction)
    off = float(np.sum(direction * np.nan_to_num(own.points - after.points)))
    left = own.noise * after.sensed_noise / own.sensed_noise
    return after._replace(
        points=after.points + off * direction,
        standing=min(after.standing, own.standing),
        turning=Turning(turning.cell, direction, size, left, own),
    )


def _advanced(
    before: PointFilter, points: Points, step: float, most: float, direction: Points | None = None
) -> tuple[PointFilter, Vector]:
    """Filter a frame; returns also how far each point is from where it was expected, squared [noise²]."""
    direction = np.zeros_like(points) if direction is None else direction
    *state, estimate, distance, variance, sensed, standing = core.filter_in_time(
        *(before.memory, before.probability, before.covariance, before.counts),
        *(points, step, most, before.coordinates, direction),
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


def points_used(of: PointFilter) -> Points:
    """Points of the frame in their order; NaN where one is missing or left out [n, 3] [m]."""
    return of.memory[2 * _MOTIONS]


def _with_ends(before: PointFilter, after: PointFilter) -> PointFilter:
    """Carry on what is missing at the ends, unless the route leaps or the frame does not list it; (324)."""
    reference = before.points if before.lost is None else before.lost.reference
    ends = carried_on(after.points, reference, after.noise)
    if ends is None:
        return after
    is_listed = after.order is None or after.order[[0, -1]].min() >= 0
    went_on = before.lost is None or before.lost.is_carried
    if not (is_listed and went_on) or has_leapt(points_used(before), points_used(after)):
        return after._replace(lost=ends[1]._replace(is_carried=False))
    return after._replace(points=ends[0], lost=ends[1])


def as_points(sensed: Matrix) -> Points:
    """Points [n, 3] as they are; curvature components [n, 2] with a column of zeros."""
    return sensed if sensed.shape[1] == 3 else np.column_stack((sensed, np.zeros(len(sensed))))


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


def _is_sent_again(before: PointFilter, points: Points) -> bool:
    """Whether the points of a frame [n, 3] are those of the last one."""
    last, order = before.memory[2 * _MOTIONS], before.order
    points = points if order is None else points[order]
    return points[0, 0] == last[0, 0] and np.array_equal(points, last)


def _in_order(
    before: PointFilter, points: Points, step: float, distance: Vector
) -> tuple[PointFilter, Points] | None:
    """Put back points that are exchanged [n, 3] [m], or what is remembered of them; docs/model.md (325).

    The order of the frames before is right, unless the path is clearly shorter in the new one. None where no
    points are exchanged.
    """
    far = np.flatnonzero(distance > FAR)
    if before.coordinates < 3 or not 2 <= len(far) <= POINTS.few:
        return None
    expected = np.tensordot(before.probability, _positions(before) + step * _velocities(before), 1)
    order = order_of(points, expected, distance, far)
    if order is None:
        return None
    if not is_shorter(points, points[order]):
        return before._replace(order=order), read_only(points[order])
    since = tuple(f"{name} were exchanged until this frame, whose path is shorter" for name in named(order))
    now = np.argsort(order)
    known = before._replace(memory=np.take(before.memory, now, axis=1), outlying=before.outlying[now])
    return known._replace(remarks=since, reordered=True), points


def _begun_anew(before: PointFilter, points: Points, which: np.ndarray) -> PointFilter:
    """Take some points for where they are now, whatever the filter remembers of them."""
    memory = np.array(before.memory)
    memory[:_MOTIONS, which] = points[which]
    memory[_MOTIONS : 2 * _MOTIONS, which] = 0.0
    turning = before.turning
    if turning is not None:
        turning = turning._replace(of_its_own=_begun_anew(turning.of_its_own, points, which))
    return before._replace(memory=memory, turning=turning)
