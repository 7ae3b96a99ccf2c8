"""Sightings of cameras to ordered points over time, with the noise estimated from their views."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tssgeom.arrays import Vector, read_only
from tssgeom.errors import ShapeError
from tssgeom.vision.cameras import Camera, project
from tssgeom.vision.continuity import Off, beginning, followed
from tssgeom.vision.localisation import Alone, located, refuse_one_camera
from tssgeom.vision.matching import Matches, matches_of, sure
from tssgeom.vision.neighbours import reach_of, unopposed
from tssgeom.vision.triangulation import gates, pixel_scale
from tssgeom.vision.views import Located, Sightings, ViewSet, nowhere, view_set_of

_SAME = 0.22  # of ln radius: spread of one size by lighting, blur and slanted views
_MOSTLY = 0.7  # of the sure matches that have to agree before size is used


_GENEROUS = 5.0  # times the stated pixel noise, before it is estimated from the views
_PROBED = 60  # frames from which the pixel noise is estimated before anything is refused
_FEW = 30.0  # degrees of freedom that the stated pixel noise weighs beside those of the views
_UNUSED = 0.1  # of the blobs of a camera, above which more than chance is wrong
_INCONSISTENT, _INCONSISTENT_PIXELS = 3.0, 0.2  # times the stated noise, and pixels
_SELDOM = 0.02  # of the frames: a tag located in fewer is a misreading


@dataclass(frozen=True, slots=True)
class Wanted:
    """What the markers are, and in which order they lie."""

    tags: bool
    ids: tuple[int, ...] = ()
    """Numbers of the tags from the proximal to the distal end; rising by default."""
    count: int | None = None
    """How many blobs there are, where that is known."""
    proximal: tuple[float, float] | None = None
    """Pixel of the first camera near the proximal end, for blobs [px]."""
    alone: Alone = field(default_factory=Alone)


@dataclass(frozen=True, slots=True)
class Track:
    """Markers over time."""

    ids: tuple[int, ...]
    """Number of each tag along the route; for blobs their count from 0."""
    frames: tuple[Located, ...]
    scale: float
    """Noise of a pixel as estimated from the views, over what the detections state [1]."""
    reprojection: Vector
    """Root mean square distance of a marker from the projection of its point, for each camera [v] [px]."""
    warnings: tuple[str, ...] = ()


def track(cameras: tuple[Camera, ...], sightings: Iterable[Sequence[Sightings]], wanted: Wanted) -> Track:
    """Turn sightings into ordered points.

    Parameters
    ----------
    cameras
        The cameras, in one common frame.
    sightings
        For each frame the sightings of each camera.
    wanted
        What the markers are and how they are ordered.

    Raises
    ------
    SettingsError
        Where one camera has nothing that determines depth.
    ShapeError
        Where the markers are not detected, or in no clear order.
    """
    refuse_one_camera(cameras, wanted.alone, tags=wanted.tags)
    view_sets = [view_set_of(cameras, one) for one in sightings]
    if not view_sets:
        raise ShapeError("there is no frame: check the video")
    if wanted.tags:
        return _of_tags(cameras, view_sets, wanted)
    return _of_blobs(cameras, view_sets, wanted)


def _of_tags(cameras: tuple[Camera, ...], view_sets: Sequence[ViewSet], wanted: Wanted) -> Track:
    known = wanted.ids or tuple(
        sorted({int(k) for one in view_sets for sightings in one.sightings for k in sightings.ids})
    )
    if not known:
        raise ShapeError(
            "no tag of the family is detected in any image: check --tags, the light and the sharpness"
        )
    numbered = [_numbered(one, known) for one in view_sets]

    def positioned(scale: float, chosen: Sequence[int]) -> list[Located]:
        gate = gates(len(cameras), scale)
        return [located(cameras, view_sets[k], numbered[k], gate, wanted.alone) for k in chosen]

    scale = _scale(positioned(_GENEROUS, _probes(view_sets)))
    frames = positioned(max(scale, 1.0), range(len(view_sets)))
    ids, frames, notes = _often(known, frames, stated=bool(wanted.ids))
    return _track(cameras, view_sets, ids, frames, notes)


def _numbered(one: ViewSet, known: Sequence[int]) -> np.ndarray:
    """Return the sighting of each camera for every number, -1 where it does not see it [n, v]."""
    which = np.full((len(known), len(one.sightings)), -1)
    row = {number: i for i, number in enumerate(known)}
    for v, sightings in enumerate(one.sightings):
        for k, number in enumerate(sightings.ids):
            if int(number) in row:
                which[row[int(number)], v] = k
    return which


def _often(
    known: Sequence[int], frames: Sequence[Located], *, stated: bool
) -> tuple[tuple[int, ...], list[Located], tuple[str, ...]]:
    """Leave out numbers that hardly any frame shows, unless they were requested."""
    times = np.count_nonzero([np.isfinite(one.points[:, 0]) for one in frames], axis=0)
    keep = np.flatnonzero(times >= (0 if stated else max(_SELDOM * len(frames), 1)))
    if not times[keep].sum():
        raise ShapeError(
            "tags are detected, but none could be located: check that calibration and cameras belong together"
        )
    seldom = [
        str(number) for number, count in zip(known, times, strict=True) if count < times.max() * _SELDOM
    ]
    notes = (
        () if stated or not seldom else (f"tags {', '.join(seldom)} are located in too few frames: left out",)
    )
    return tuple(known[int(k)] for k in keep), [_rows(one, keep) for one in frames], notes


def _rows(one: Located, keep: np.ndarray) -> Located:
    return Located(
        one.points[keep], one.covariance[keep], one.square[keep], one.freedom[keep], one.which[keep]
    )


def _of_blobs(cameras: tuple[Camera, ...], view_sets: Sequence[ViewSet], wanted: Wanted) -> Track:
    gate = gates(len(cameras), max(_scale_of_blobs(cameras, view_sets, wanted.alone), 1.0))
    matches, reach = _possible(cameras, view_sets, gate, wanted.alone)
    begin = beginning(matches, reach, _off_end(cameras[0], wanted.proximal), wanted.count)
    frames = [nowhere(len(begin.points), len(cameras))] * len(view_sets)
    for k, which in followed(matches, begin):
        frames[k] = located(cameras, view_sets[k], which, gate, wanted.alone)
    whole = uncovered(cameras, view_sets, frames)
    frames = [
        one if np.array_equal(one.which, which) else located(cameras, sightings, which, gate, wanted.alone)
        for sightings, one, which in zip(view_sets, frames, whole, strict=True)
    ]
    notes = () if wanted.proximal else (_taken_end(begin.points[0]),)
    notes += tuple(_unused(cameras, view_sets, frames))
    return _track(cameras, view_sets, tuple(range(len(begin.points))), frames, notes)


def _possible(
    cameras: tuple[Camera, ...], view_sets: Sequence[ViewSet], gate: Vector, alone: Alone
) -> tuple[list[Matches], float]:
    """Return the points that each frame may show, and the distance within which the next marker lies [m]."""
    matches = [matches_of(cameras, one, gate, alone) for one in view_sets]
    matches = of_one_size(cameras, view_sets, matches)
    return matches, reach_of(cameras, view_sets, matches)


def _scale_of_blobs(cameras: tuple[Camera, ...], view_sets: Sequence[ViewSet], alone: Alone) -> float:
    """Return the pixel noise that clear matches of a few frames show, over the stated one [1]."""
    gate, few = gates(len(cameras), _GENEROUS), [view_sets[k] for k in _probes(view_sets)]
    matches, reach = _possible(cameras, few, gate, alone)
    clear = [candidates.blobs[unopposed(candidates, reach)] for candidates in matches]
    return _scale([located(cameras, one, which, gate, alone) for one, which in zip(few, clear, strict=True)])


def _unused(
    cameras: tuple[Camera, ...], view_sets: Sequence[ViewSet], frames: Sequence[Located]
) -> Iterator[str]:
    """Say of which camera many blobs are not used."""
    for v, camera in enumerate(cameras):
        total = sum(len(one.sightings[v]) for one in view_sets)
        used = sum(int((one.which[:, v] >= 0).sum()) for one in frames)
        if total - used > _UNUSED * total:
            yield (
                f"camera {camera.name!r}: {100 * (total - used) / total:.0f} % of its blobs belong to no "
                "marker (red in the images of --overlay): check calibration, colour and area of the blobs"
            )


def _taken_end(position: Vector) -> str:
    at = ", ".join(f"{1e3 * x:.0f}" for x in position)
    return f"the end at ({at}) mm is taken for the proximal one: give --proximal X,Y where it is the other"


def _off_end(camera: Camera, pixel: tuple[float, float] | None) -> Off | None:
    """Return the distance of projections from a pixel of the first camera [px]."""
    if pixel is None:
        return None
    return lambda points: np.linalg.norm(project(camera, points) - np.array(pixel), axis=1)


def _probes(view_sets: Sequence[ViewSet]) -> list[int]:
    count = min(len(view_sets), _PROBED)
    return [int(k) for k in np.linspace(0, len(view_sets) - 1, count).round()]


def _scale(frames: Sequence[Located]) -> float:
    square = np.concatenate([one.square for one in frames])
    return pixel_scale(square, np.concatenate([one.freedom for one in frames]))


def _track(
    cameras: tuple[Camera, ...],
    view_sets: Sequence[ViewSet],
    ids: tuple[int, ...],
    frames: Sequence[Located],
    notes: tuple[str, ...],
) -> Track:
    """Scale the covariances by the noise estimated from the views; docs/model.md (133)."""
    square = sum(float(np.nansum(one.square)) for one in frames)
    freedom = sum(float(one.freedom.sum()) for one in frames)
    scale = float(np.sqrt((square + _FEW) / (freedom + _FEW)))
    scaled = tuple(
        replace(one, points=read_only(one.points), covariance=read_only(one.covariance * scale**2))
        for one in frames
    )
    off = _reprojection(cameras, view_sets, scaled)
    if scale > _INCONSISTENT and np.nanmax(off) > _INCONSISTENT_PIXELS:
        notes += (
            f"views miss each other by {np.nanmax(off):.2f} px, {scale:.1f} times what images allow: check "
            "that the calibration is of these cameras, in this order, and that they film in step",
        )
    return Track(ids, scaled, scale, off, notes)


def _reprojection(
    cameras: tuple[Camera, ...], view_sets: Sequence[ViewSet], frames: Sequence[Located]
) -> Vector:
    squares = [list[float]() for _ in cameras]
    for view_set, one in zip(view_sets, frames, strict=True):
        for v, camera in enumerate(cameras):
            here = one.which[:, v] >= 0
            off = view_set.sightings[v].centre[one.which[here, v]] - project(camera, one.points[here])
            squares[v].extend(np.sum(off * off, axis=1))
    return np.array([np.sqrt(np.mean(each)) if each else np.nan for each in squares])


_WHOLE = (0.75, 1.35)  # of the usual area: smaller is covered in part, larger is two in one
_HALF = 15  # frames before and after, over which the usual area is taken
_FEWEST = 5


def uncovered(
    cameras: tuple[Camera, ...], view_sets: Sequence[ViewSet], frames: Sequence[Located]
) -> list[np.ndarray]:
    """Return the sightings of every marker without those that are covered in part or two in one.

    Their area jumps, and their centre is off; docs/model.md (139).

    Parameters
    ----------
    cameras
        The cameras.
    view_sets, frames
        Sightings of every frame, and the markers located by them.

    Returns
    -------
    list of ndarray
        For each frame the sighting of each camera, -1 for none [n, v].
    """
    which = np.array([one.which for one in frames])
    size = np.full(which.shape, np.nan)
    for f, (view_set, one) in enumerate(zip(view_sets, frames, strict=True)):
        for v, camera in enumerate(cameras):
            here = which[f, :, v] >= 0
            depth = one.points[here] @ camera.rotation[2] + camera.shift[2]
            size[f, here, v] = view_set.sightings[v].size[which[f, here, v]] * depth**2
    share = size / _usual(size)
    return list(np.where((share < _WHOLE[0]) | (share > _WHOLE[1]), -1, which))


def _usual(size: np.ndarray) -> np.ndarray:
    """Median over the frames around, NaN where too few of them have a value [f, n, v]."""
    usual = np.full_like(size, np.nan)
    for f in range(len(size)):
        around = np.sort(size[max(f - _HALF, 0) : f + _HALF + 1], axis=0)  # NaN last
        known = np.isfinite(around).sum(axis=0)
        middle = [np.take_along_axis(around, k[None], axis=0)[0] for k in ((known - 1) // 2, known // 2)]
        usual[f] = np.where(known >= _FEWEST, 0.5 * (middle[0] + middle[1]), np.nan)
    return usual


def of_one_size(
    cameras: tuple[Camera, ...], view_sets: Sequence[ViewSet], matches: Sequence[Matches]
) -> list[Matches]:
    """Leave out matches whose blobs would be markers of another size than most; docs/model.md (137).

    Parameters
    ----------
    cameras
        The cameras.
    view_sets, matches
        Sightings of each frame, and the points that they may be.

    Returns
    -------
    list of Matches
        The same where markers have sizes of their own.
    """
    radii = [
        _log_radius(cameras, one, candidates) for one, candidates in zip(view_sets, matches, strict=True)
    ]
    usual = _densest(np.concatenate(radii))
    certain = [radius[sure(candidates)[0]] for radius, candidates in zip(radii, matches, strict=True)]
    agreeing = np.abs(np.concatenate(certain) - usual) <= _SAME
    if np.count_nonzero(agreeing) < _MOSTLY * len(agreeing):
        return list(matches)
    kept = [np.flatnonzero(np.abs(radius - usual) <= _SAME) for radius in radii]
    return [candidates.take(rows) for candidates, rows in zip(matches, kept, strict=True)]


def _log_radius(cameras: tuple[Camera, ...], one: ViewSet, candidates: Matches) -> Vector:
    """Logarithm of the radius that a marker would have, the mean over the views that see it [ln m]."""
    total, views = np.zeros(len(candidates.points)), np.zeros(len(candidates.points))
    for v, camera in enumerate(cameras):
        here = candidates.blobs[:, v] >= 0
        depth = candidates.points[here] @ camera.rotation[2] + camera.shift[2]
        area = one.sightings[v].size[candidates.blobs[here, v]] / (camera.matrix[0, 0] * camera.matrix[1, 1])
        total[here] += 0.5 * np.log(area / np.pi) + np.log(depth)
        views[here] += 1.0
    return total / np.maximum(views, 1.0)


def _densest(values: Vector) -> float:
    """Return the median of the values in the window, `_SAME` wide, that holds most of them."""
    if not len(values):
        return 0.0
    ordered = np.sort(values)
    until = np.searchsorted(ordered, ordered + _SAME, side="right")
    first = int(np.argmax(until - np.arange(len(ordered))))
    return float(np.median(ordered[first : until[first]]))
