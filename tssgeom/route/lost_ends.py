"""Ends of a route that are missing in a frame, carried on with the points beside them; model.md (324)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Points, read_only
from tssgeom.core.constants_route import OUTLIERS, POINTS
from tssgeom.route.exchanges import EXCHANGE
from tssgeom.route.observations import MIN_POINTS
from tssgeom.route.route import step_lengths


class LostEnds(NamedTuple):
    """Ends of a route that were sensed before, and are missing now."""

    first: int
    """Points that are missing before the first one that is not."""
    last: int
    """Points that are missing behind the last one that is not."""
    reference: Points
    """All points as they were when these ends were last sensed [n, 3] [m]."""
    turn: float
    """Standard deviation of what the route turns from point to point less than it did then [rad]."""
    length: float
    """Length of the path along them, then [m]."""
    is_carried: bool = True
    """Whether the route goes on to them; not where it leapt since, or a frame does not list them."""

    @property
    def angle_variance(self) -> float:
        """Variance of Φ since they are carried on [rad²]."""
        if not self.is_carried:
            return 0.0
        turns = sum((lost + 0.5) ** 2 for lost in (self.first, self.last) if lost)  # half a one at the tip
        return turns * self.turn**2

    @property
    def warning(self) -> str:
        """Which they are, and how much of the route is not sensed."""
        ends = (("first", self.first), ("last", self.last))
        names = [f"{end} point" if n == 1 else f"{end} {n} points" for end, n in ends if n]
        are = "is" if self.first + self.last == 1 else "are"
        text = f"the {' and the '.join(names)} {are} missing, {1e3 * self.length:.3g} mm of the route"
        return f"{text}: carried on with the others" if self.is_carried else f"{text}, which ends before"


def carried_on(points: Points, reference: Points, noise: float) -> tuple[Points, LostEnds] | None:
    """Return points with the missing ones at their ends, and what these are; None where nothing shows them.

    Parameters
    ----------
    points
        Points of a frame; NaN where one is missing [n, 3] [m].
    reference
        The same, when the ends were last sensed.
    noise
        Standard deviation of a coordinate of both [m].
    """
    sensed = np.flatnonzero(~np.isnan(points[:, 0]))
    first, last = int(sensed[0]), len(points) - 1 - int(sensed[-1])
    both = sensed[~np.isnan(reference[sensed, 0])]
    if max(first, last) > OUTLIERS.longest_run or len(both) < MIN_POINTS or len(points) > POINTS.few:
        return None
    filled = np.array(points)
    for lost, beside in (
        (np.arange(first), both[:MIN_POINTS]),
        (np.arange(len(points) - last, len(points)), both[-MIN_POINTS:]),
    ):
        filled[lost] = _moved(reference[lost], reference[beside], points[beside], noise)
    if np.isnan(filled[[0, -1]]).any():
        return None
    change = _turns(points[both]) - _turns(reference[both])
    turn = float(np.sqrt(np.mean(np.square(change))))
    then = np.where(np.isnan(reference), filled, reference)  # so that each frame has the same length
    length = float(step_lengths(then[: first + 1]).sum() + step_lengths(then[len(then) - last - 1 :]).sum())
    return read_only(filled), LostEnds(first, last, reference, turn, length)


def has_leapt(before: Points, now: Points) -> bool:
    """Whether half of the points moved by a third of their distance from one frame to the next."""
    moved, chord = np.square(now - before).sum(axis=1), np.square(np.diff(before, axis=0)).sum(axis=1)
    return bool(np.nanmedian(moved) > EXCHANGE.share * np.nanmedian(chord))


def rows_of(points: Points, expected: Points) -> np.ndarray | None:
    """Return the row of each expected point [n] in a frame that lacks some, -1 for these; None where unclear.

    All points of the frame follow each other as expected, and are near to where they were.
    """
    count, n = len(points), len(expected)
    lacking = n - count
    if lacking > OUTLIERS.longest_run or count < MIN_POINTS or n > POINTS.few:
        return None
    between = points[:, None] - expected
    square = np.nan_to_num(np.einsum("ijc,ijc->ij", between, between))
    total = np.zeros(lacking + 1)  # by how many were lacking so far
    steps = np.zeros((count, lacking + 1), dtype=np.int64)
    for i in range(count):
        steps[i] = [int(total[: k + 1].argmin()) for k in range(lacking + 1)]
        total = total[steps[i]] + square[i, i : i + lacking + 1]
    rows, k = np.full(n, -1), int(total.argmin())
    for i in range(count - 1, -1, -1):
        rows[i + k], k = i, int(steps[i, k])
    listed = rows >= 0
    off = float(square[rows[listed], listed.nonzero()[0]].max())
    return rows if off < EXCHANGE.share * float(np.square(step_lengths(expected)).min()) else None


def taken(points: Points, rows: np.ndarray) -> Points:
    """Return these rows of an array [n, …], NaN for each row -1."""
    chosen = np.array(points[rows], dtype=np.float64)
    chosen[rows < 0] = np.nan
    return read_only(chosen)


def _moved(points: Points, before: Points, now: Points, noise: float) -> Points:
    """Move points as the rigid motion does that takes others from `before` to `now` (Kabsch 1976).

    What these do not determine, as the turn about a straight line, is none.
    """
    middle, to = before.mean(axis=0), now.mean(axis=0)
    h = (before - middle).T @ (now - to) + len(now) * noise**2 * np.eye(3)
    u, _, vt = np.linalg.svd(h)
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    return (points - middle) @ u @ mirror @ vt + to


def _turns(points: Points) -> np.ndarray:
    """Angles between successive chords [rad]."""
    chord = np.diff(points, axis=0)
    along = np.einsum("ij,ij->i", chord[:-1], chord[1:])
    return np.arctan2(np.linalg.norm(np.cross(chord[:-1], chord[1:]), axis=1), along)
