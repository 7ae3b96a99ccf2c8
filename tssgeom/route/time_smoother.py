"""Recorded points, filtered in time by the frames before and after each; docs/model.md (162)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from tssgeom.arrays import Points, Vector
from tssgeom.core.constants import ROUNDING
from tssgeom.route.lost_ends import LostEnds, taken
from tssgeom.route.time_filter import PointFilter, begun, filtered, points_used

_T = TypeVar("_T", float, np.ndarray)
_PASSES = 3  # both ways, until all frames are in one order [1]; chosen: the second mostly changes none


def smoothed(
    points: Sequence[Points], times: Sequence[float], noise: float, cell: Vector | None = None
) -> list[PointFilter | None]:
    """Filter recorded frames by those before and after them (Fraser and Potter 1969); model.md (162).

    Parameters
    ----------
    points, times
        The points [n, 3] [m] of each frame, NaN where one is missing, and its time [s].
    noise
        Noise of the fit of one frame [m].
    cell
        Of curvatures [n, 2] [1/m], the length of the stretch that each grating stands for [n] [m].
    """
    sent, orders = list(points), [np.arange(len(each)) for each in points]
    forward, backward = list[PointFilter | None](), list[PointFilter | None]()
    for _ in range(_PASSES):
        forward = _passed(sent, times, noise, cell)
        _put_back(forward, sent, orders)
        backward = _passed(sent[::-1], [-time for time in times[::-1]], noise, cell, may_lack=False)[::-1]
        if not _put_back(backward, sent, orders):  # else the frames before were in another order
            break
    results = list[PointFilter | None]()
    for first, second, order in zip(forward, backward, orders, strict=True):
        both = first if first is None or second is None else _combined(first, second)
        is_put_back = both is not None and (order != np.arange(len(order))).any()
        results.append(_as_listed(both, order) if both is not None and is_put_back else both)
    return results


def _put_back(results: list[PointFilter | None], sent: list[Points], orders: list[np.ndarray]) -> bool:
    """Put points that are exchanged back, in frames and their orders; returns whether there are any."""
    changed = False
    for i, one in enumerate(results):
        if one is not None and one.order is not None:
            sent[i] = taken(sent[i], one.order)
            orders[i] = np.where(one.order < 0, -1, orders[i][one.order])
        changed |= one is not None and (one.order is not None or one.reordered)
    return changed


def _as_listed(both: PointFilter, order: np.ndarray) -> PointFilter:
    """Return points with the rows that they came in; ends that the frame does not list are missing."""
    lost, points = both.lost, both.points
    if lost is not None and order[[0, -1]].min() < 0:
        points = np.where(np.isnan(points_used(both)), np.nan, points)
        lost = lost._replace(is_carried=False)
    return both._replace(order=order, points=points, lost=lost)


def _passed(
    points: Sequence[Points],
    times: Sequence[float],
    noise: float,
    cell: Vector | None,
    *,
    may_lack: bool = True,
) -> list[PointFilter | None]:
    """Filter frames in order; those that cannot begin a filter have none."""
    results, last = list[PointFilter | None](), None
    for sensed, time in zip(points, times, strict=True):
        # the noise of a fit of filtered points is less in proportion
        left = 0.0 if last is None else noise * last.noise / last.sensed_noise
        now = None if last is None else filtered(last, sensed, left, time, may_lack=may_lack)
        last = begun(sensed, noise, time, cell) if now is None else now
        results.append(last)
    return results


def _combined(before: PointFilter, later_on: PointFilter) -> PointFilter:
    """Combine the estimate by this frame and those before it with that by this and those after it."""
    sensed = np.where(np.isfinite(points_used(later_on)), points_used(before), np.nan)
    r = before.sensed_noise**2
    points, noise = _joined(before.points, before.noise, later_on.points, later_on.noise, sensed, r)
    points = np.where(np.isfinite(points), points, before.points)
    points, lost = _with_ends(points, before, later_on)
    turning, later = before.turning, later_on.turning
    if turning is not None and later is not None:
        along = np.where(np.isfinite(sensed), turning.direction, 0.0)
        own, after, now, reading = (
            float(np.nansum(along * each)) for each in (before.points, later_on.points, points, sensed)
        )
        value, left = _joined(own, turning.noise, after, later.noise, reading, r)
        points = points + (value - now) * turning.direction
        turning = turning._replace(noise=left)
    return before._replace(points=points, noise=noise, turning=turning, lost=lost)


def _with_ends(points: Points, before: PointFilter, later_on: PointFilter) -> tuple[Points, LostEnds | None]:
    """Return points with the ends that are missing, between where both have them, by how sure each is."""
    both = [one for one in (before, later_on) if one.lost is not None and one.lost.is_carried]
    if not both:
        return points, before.lost or later_on.lost
    weight = np.array([1.0 / (one.lost.turn**2 + ROUNDING.exact) for one in both if one.lost is not None])
    between = np.tensordot(weight / weight.sum(), [one.points for one in both], 1)
    surest = both[int(weight.argmax())]
    return np.where(np.isnan(points_used(before)), between, points), surest.lost


def _joined(
    own: _T, own_noise: float, other: _T, other_noise: float, sensed: _T, variance: float
) -> tuple[_T, float]:
    """Join two estimates that hold one reading, and their noise; the first where the other adds nothing."""
    weight, later = 1.0 / own_noise**2, 1.0 / other_noise**2 - 1.0 / variance
    if later <= 0.0:
        return own, own_noise
    from_later = (other / other_noise**2 - sensed / variance) / later
    return (weight * own + later * from_later) / (weight + later), 1.0 / math.sqrt(weight + later)
