"""Outlying points and directions: the limit of a squared residual, and what a fit does not explain."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tssgeom import core
from tssgeom.arrays import Matrix, Points, Vector, read_only
from tssgeom.core.constants import CHANCE, ROUNDING
from tssgeom.core.constants_route import OUTLIERS, RAW, SPACING
from tssgeom.route.route import across, step_lengths


def outlier_limit(count: int, variance: float) -> float:
    """Return the square beyond which a residual of this variance, one of `count`, is an outlier; (29).

    Pure noise of two components takes one of `count` for one with a chance of e^-8 = 0.03 %, whatever it is.
    """
    return (CHANCE.rare**2 + 2.0 * math.log(count)) * variance


def raw_outliers(points: Points, count: NDArray[np.int64] | None = None) -> np.ndarray:
    """Mark points [n] that stand off the curve through their neighbours by more than a spacing.

    Parameters
    ----------
    points
        Observed points along the route [m].
    count
        Number of each among these and the missing ones, increasing; None: none is missing.
    """
    n = len(points)
    mark, index, kept = np.zeros(n, np.bool_), np.arange(n), read_only(points)
    for _ in range(max(1, n // 6)):
        worst = core.worst_outlier(kept, core.median(step_lengths(kept)))
        if worst < 0:
            break
        mark[index[worst]] = True
        index = np.delete(index, worst)
        kept = read_only(points[index])
    if mark.any():
        _unmark_long_runs(mark)
        _unmark_ends(points, mark)
        if count is not None:
            _unmark_behind_missing(points, count, mark)
    return mark if mark.sum() <= OUTLIERS.share * n else np.zeros_like(mark)


def _unmark_long_runs(mark: np.ndarray) -> None:
    """Unmark runs of many points: where many in a row are off, the sequence breaks and none is an outlier."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mark, [False]))))
    for begin, end in edges.reshape(-1, 2):
        if end - begin > OUTLIERS.longest_run:
            mark[begin:end] = False


def _unmark_ends(points: Points, mark: np.ndarray) -> None:
    """Unmark points at an end that continue the kept ones: an outlier beside them had marked them."""
    for direction in (slice(None), slice(None, None, -1)):
        p, off = points[direction], mark[direction]
        kept = np.flatnonzero(~off)[: RAW.extrapolated_from]
        if not len(kept) or not kept[0]:
            continue
        one, other = np.triu_indices(len(kept), 1)
        slope = np.median((p[kept[other]] - p[kept[one]]) / (kept[other] - kept[one])[:, None], axis=0)
        start = np.median(p[kept] - kept[:, None] * slope, axis=0)  # one outlier more does not turn the line
        step = float(np.linalg.norm(slope))
        apart = p[: kept[0]] - start - np.arange(kept[0])[:, None] * slope
        along = apart @ slope / (step + 1e-300)
        aside = np.sqrt(np.maximum(np.einsum("ij,ij->i", apart, apart) - along**2, 0.0))
        off[: kept[0]] &= (aside > step) | (np.abs(along) > SPACING.uneven * step)


def _unmark_behind_missing(points: Points, count: NDArray[np.int64], mark: np.ndarray) -> None:
    """Unmark points at an end behind missing ones that lie no farther off than the way along these is.

    The direction and the parabola of an end hold for points that follow each other only.
    """
    spacing = core.median(step_lengths(points) / np.diff(count))
    for order in (np.arange(len(points)), np.arange(len(points))[::-1]):
        kept = np.flatnonzero(~mark[order])
        last = order[kept[0]] if len(kept) else order[0]
        for here in order[: kept[0]][::-1] if len(kept) else ():
            steps = abs(count[here] - count[last])
            if steps > abs(int(here) - int(last)) and (
                np.linalg.norm(points[here] - points[last]) <= RAW.end_leap * steps * spacing
            ):
                mark[here], last = False, here


def leaves_out_a_stretch(weight: Vector) -> bool:
    """Whether so many points side by side have no weight that they are a part of the route."""
    used = np.flatnonzero(weight)
    if len(used) < 2:
        return True
    at_end, within = max(used[0], len(weight) - 1 - used[-1]), int(np.diff(used).max()) - 1
    most_within = max(2 * OUTLIERS.longest_run, OUTLIERS.share * len(weight))
    return bool(at_end > OUTLIERS.longest_run or within > most_within)


def outlying_tangent(tangents: Points, variance: Vector, u: Vector, mean: Matrix, spread: Vector) -> int:
    """Return the sensed direction that a fit explains least, if beyond chance and a jump of curvature, or -1.

    Parameters
    ----------
    tangents, variance
        Directions [n, 3] and their variances, 0 where none was sensed [n].
    u, mean, spread
        Stations [n] and states [n, 3, 4] of the fit, and the variance of a component of its tangents [n].
    """
    used = np.flatnonzero(variance > 0.0)
    if not used.size:
        return -1
    speed = np.maximum(np.linalg.norm(mean[:, :, 1], axis=1), 1e-12)
    fitted = mean[:, :, 1] / speed[:, None]
    bend = np.linalg.norm(across(mean[:, :, 2], fitted), axis=1) / speed**2
    turn = OUTLIERS.turn_share * float(np.max(bend * np.gradient(u)))
    cosine = np.einsum("ij,ij->i", tangents[used], fitted[used])
    off = np.where(cosine > 0.0, np.maximum(1.0 - cosine**2, 0.0), 4.0)
    own = np.maximum(1.0 - spread[used] / variance[used], ROUNDING.exact)
    over_limit = off / (variance[used] * own * outlier_limit(len(used), 1.0))  # docs/model.md (29)
    over_limit = np.where(np.sqrt(off) / own > turn, over_limit, 0.0)
    worst = int(np.argmax(over_limit))
    return int(used[worst]) if over_limit[worst] > 1.0 else -1


def may_drop_tangent(used: Points | None, sensed: Points | None) -> bool:
    """Whether one more of the sensed directions may be left out of those that are used."""
    if used is None or sensed is None:
        return False
    count = int(np.count_nonzero(~np.isnan(sensed[:, 0])))
    dropped = count - int(np.count_nonzero(~np.isnan(used[:, 0])))
    return dropped + 1 <= max(OUTLIERS.share * count, 1.0)
