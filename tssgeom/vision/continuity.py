"""Nameless markers through time: each keeps its position on the chain, or is missing; docs/model.md (139)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from tssgeom.arrays import Points, Vector, rows_at
from tssgeom.errors import ShapeError
from tssgeom.vision.matching import Matches, sure
from tssgeom.vision.neighbours import chain_of
from tssgeom.vision.ordering import FEWEST

_REACH = 0.45  # of the spacing: how far a marker may be from where it is expected
_ELSEWHERE = 1.5  # least ratio of the distance to the next expected position over that to its own
_LEAST_SHARE = 0.4  # of the markers: a frame with fewer is lost


@dataclass(frozen=True, slots=True)
class Beginning:
    """The frame from which the markers are counted."""

    frame: int
    blobs: np.ndarray
    """Its matches in the order of the route [n, v]."""
    points: Points
    """[n, 3] [m]."""
    reach: float
    """Distance within which the next marker lies [m]."""

    @property
    def spacing(self) -> float:
        """Median distance of neighbours [m]."""
        return float(np.median(np.linalg.norm(np.diff(self.points, axis=0), axis=1)))


Off = Callable[[Points], Vector]


def beginning(matches: Sequence[Matches], reach: float, off: Off | None, count: int | None) -> Beginning:
    """Choose the first of the frames that show most markers, and order them along the route.

    Parameters
    ----------
    matches
        Possible points of every frame.
    reach
        Distance within which the next marker lies [m].
    off
        Distance of positions [n, 3] [m] from the proximal end; without it the route begins at the end with
        the smaller x.
    count
        How many markers there are, where that is known.

    Raises
    ------
    ShapeError
        Where no frame shows markers enough in a clear order.
    """
    chains, reasons = dict[int, np.ndarray](), dict[int, str]()
    for frame, candidates in enumerate(matches):
        try:
            chains[frame] = chain_of(candidates, reach)
        except ShapeError as error:
            reasons[frame] = str(error)
    wanted = FEWEST if count is None else count
    fitting = {frame: chain for frame, chain in chains.items() if count is None or len(chain) <= count}
    most = max(map(len, fitting.values()), default=0)
    if most < wanted:
        raise ShapeError(_too_few(wanted, most, reasons))
    frame = next(frame for frame, chain in fitting.items() if len(chain) == most)
    return _beginning(frame, matches[frame].take(fitting[frame]), reach, off)


def _too_few(wanted: int, most: int, reasons: Mapping[int, str]) -> str:
    first = next((f"; frame {frame}: {reason}" for frame, reason in reasons.items()), "")
    return (
        f"at most {most} markers are located in one frame, {wanted} are needed: check lighting, area and "
        f"calibration{first}"
    )


def _beginning(frame: int, candidates: Matches, reach: float, off: Off | None) -> Beginning:
    ends = candidates.points[[0, -1]]
    first, last = ends[:, 0] if off is None else off(ends)
    way = slice(None, None, -1) if first > last else slice(None)
    return Beginning(frame, candidates.blobs[way], candidates.points[way], reach)


def _decided(candidates: Matches, near: Points, within: float) -> np.ndarray:
    """Return the matches near known positions that no conflicting match equals in number of views."""
    close = cdist(candidates.points, near).min(axis=1, initial=np.inf) <= within
    kept, _ = sure(candidates.take(np.flatnonzero(close)))
    return np.flatnonzero(close)[kept]


def followed(matches: Sequence[Matches], begin: Beginning) -> Iterator[tuple[int, np.ndarray]]:
    """Follow the markers from the beginning to the last frame, then to the first one.

    Parameters
    ----------
    matches
        Possible points of every frame.
    begin
        Where they are counted.

    Yields
    ------
    tuple
        Number of the frame, and the match of every marker: blob of each view, -1 for none [n, v].
    """
    yield begin.frame, begin.blobs
    yield from _one_way(matches, begin, range(begin.frame + 1, len(matches)))
    yield from _one_way(matches, begin, range(begin.frame - 1, -1, -1))


def _one_way(
    matches: Sequence[Matches], begin: Beginning, frames: Iterable[int]
) -> Iterator[tuple[int, np.ndarray]]:
    believed, moving = begin.points, np.zeros_like(begin.points)
    for frame in frames:
        candidates = matches[frame]
        match_of = _assigned(candidates, believed + moving, begin.spacing)
        if np.count_nonzero(match_of >= 0) < _LEAST_SHARE * len(believed):
            match_of = _reordered(candidates, believed, begin.reach)
        matched = match_of >= 0
        blobs = np.full((len(believed), begin.blobs.shape[1]), -1)
        blobs[matched] = candidates.blobs[match_of[matched]]
        yield frame, blobs
        if matched.any():
            moving = _spread(candidates.points[match_of[matched]] - believed[matched], matched)
            believed = believed + moving
        else:
            moving = np.zeros_like(believed)


def _assigned(candidates: Matches, expected: Points, spacing: float) -> np.ndarray:
    """Give each marker the match nearest to where it is expected, -1 where none or two are near [n].

    The whole chain may have moved more than expected: the second pass starts from the first result.
    """
    reach = _REACH * spacing
    match_of = np.full(len(expected), -1)
    for _ in range(2):
        usable = _decided(candidates, expected, reach)
        match_of = np.full(len(expected), -1)
        if not len(usable):
            break
        distance = cdist(expected, candidates.points[usable])
        rows, columns = linear_sum_assignment(np.minimum(distance, 10.0 * reach) ** 2)
        for row, column in zip(rows, columns, strict=True):
            others = np.delete(distance[:, column], row).min(initial=np.inf)
            if distance[row, column] < reach and others > _ELSEWHERE * distance[row, column]:
                match_of[row] = usable[column]
        matched = match_of >= 0
        if not matched.any():
            break
        expected = expected + _spread(candidates.points[match_of[matched]] - expected[matched], matched)
    return match_of


def _spread(moved: Points, matched: np.ndarray) -> Points:
    """Displacement of every marker, interpolated between the detected ones along the chain [n, 3]."""
    along = np.arange(len(matched))
    return rows_at(along, along[matched], moved)


def _reordered(candidates: Matches, believed: Points, reach: float) -> np.ndarray:
    """Order a frame anew in which the markers are not near their expected positions; all must be detected."""
    lost = np.full(len(believed), -1)
    try:
        order = chain_of(candidates, reach)
    except ShapeError:
        return lost
    if len(order) != len(believed):
        return lost
    ways = order, order[::-1]
    off = [float(np.linalg.norm(candidates.points[way] - believed, axis=1).mean()) for way in ways]
    best = int(np.argmin(off))
    return ways[best] if off[best] < off[1 - best] / _ELSEWHERE else lost
