"""Points of recorded frames, filtered by those before and after each, and lengths unlike those of neighbours.

Source: docs/model.md (162), (331).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from typing import NamedTuple, TypeVar

import numpy as np

from tssgeom.arrays import Points, Vector
from tssgeom.core.constants import CHANCE, MEDIANS
from tssgeom.errors import TssgeomError
from tssgeom.frame import Frame, in_order, with_rows
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.rig import Rig
from tssgeom.route.fibre.models import stretches
from tssgeom.route.observations import MIN_POINTS
from tssgeom.route.time_filter import PointFilter
from tssgeom.route.time_smoother import smoothed
from tssgeom.sensed_route import fit_frame


@dataclass(frozen=True, slots=True)
class LengthLimits:
    """When a length is outlying."""

    beside: int = 3
    """Frames before, and as many after, whose medians a length is compared with [1]. Chosen: a bad one beside
    it is outvoted, and a route that begins to move is like those on one side."""
    around: int = 8
    """Frames before, and as many after, that show how much it varies there [1]. Chosen."""
    share: float = 0.005
    """Difference over the length below which nothing is said [1]. Chosen: markers that sit on a sheath which
    moves quickly differ by half of it."""


LENGTHS = LengthLimits()


def outlying_lengths(points: Mapping[int, Points]) -> dict[int, str]:
    """Say of which recorded frames the points lie along a length that is not that of their neighbours.

    Parameters
    ----------
    points
        Points [n, 3] [m] by the count of the frame, in the order of time. Frames that lack points, or have
        another number of them than the first one, are left out.
    """
    first = next(iter(points.values()), np.zeros((0, 3)))
    complete = [i for i, each in points.items() if each.shape == first.shape and np.isfinite(each).all()]
    if len(complete) < PLAUSIBLE.repeated_rows or len(first) < MIN_POINTS or first.shape[1] != 3:
        return {}
    chords, longer = _lengths(np.array([points[i] for i in complete]))
    length = chords + longer
    usual = _medians(length, LENGTHS.beside)
    off = np.abs(length - usual).min(axis=0)
    varies = np.maximum(np.median(off), np.median(_windows(off, LENGTHS.around), axis=1))
    unsure = np.abs(longer - _medians(longer, LENGTHS.beside)).max(axis=0)  # of sharp bends
    outlying = off > np.maximum(
        CHANCE.never * MEDIANS.sd_per_absolute * varies, LENGTHS.share * length + unsure
    )
    return {complete[i]: _said(length[i], float(usual[:, i].mean())) for i in np.flatnonzero(outlying)}


def _medians(values: Vector, count: int) -> np.ndarray:
    """Medians of so many values before each, and after it [2, n]; at an end those of the other side."""
    padded = np.pad(values, count, constant_values=np.nan)
    every = np.lib.stride_tricks.sliding_window_view(padded, count)
    before, after = every[: len(values)], every[count + 1 :]
    with_both = np.stack((before, after))
    full = np.isfinite(with_both).all(axis=2)
    medians = np.median(np.nan_to_num(with_both), axis=2)
    return np.where(full, medians, medians[::-1])


def _windows(values: Vector, count: int) -> np.ndarray:
    """So many values before each and after it, turned round at the ends [n, 2 count + 1]."""
    padded = np.pad(values, count, mode="reflect")
    return np.lib.stride_tricks.sliding_window_view(padded, 2 * count + 1)


def _lengths(points: np.ndarray) -> tuple[Vector, Vector]:
    """Chords of the points of frames [f, n, 3], in all, and what the arcs over them are longer [f] [m]."""
    chord = np.diff(points, axis=1)
    size = np.maximum(np.linalg.norm(chord, axis=2), np.finfo(np.float64).tiny)
    unit = chord / size[..., None]
    turn = np.arccos(np.clip(np.sum(unit[:, 1:] * unit[:, :-1], axis=2), -1.0, 1.0))
    return np.sum(size, axis=1), np.sum(turn**2 * (size[:, 1:] + size[:, :-1]), axis=1) / 48.0


def _said(length: float, usual: float) -> str:
    return (
        f"the points lie along {1e3 * length:.4g} mm, in the frames before and after along "
        f"{1e3 * usual:.4g} mm: check for points that are lost, exchanged, or taken for others"
    )


_T = TypeVar("_T")


class Window(NamedTuple):
    """How much of a recording is smoothed at a time."""

    points: int = 50_000
    """Points of all frames [1]. Chosen: their filters take 40 MB."""
    most: int = 512
    """Frames [1]. Chosen: beyond them the noise that is left hardly falls."""
    overlap: int = 32
    """Frames before and after those that are smoothed [1]. Chosen: a filter that moves remembers fewer."""


_WINDOW = Window()


def smoothed_in_time(frames: Sequence[object], rig: Rig) -> dict[int, PointFilter]:
    """Filter the points of recorded frames by those before and after each; by the count of the frame."""
    every = {i: frame for i, frame in enumerate(frames) if isinstance(frame, Frame)}
    if not rig.shape.time_filter or len(every) < 2:
        return {}
    first = next(iter(every.values()))
    usable = {i: frame for i, frame in every.items() if _goes_on(frame, first)}
    of_fibre = first.curvatures is not None
    cell = None if first.stations is None or not of_fibre else stretches(first.stations)
    for frame in usable.values():
        with suppress(TssgeomError, ArithmeticError):
            tracked = fit_frame(frame, rig)[1]
            noise = tracked.fit.noise if tracked.fibre_noise is None else tracked.fibre_noise.noise
            points = [one.points if one.curvatures is None else one.curvatures for one in usable.values()]
            results = smoothed(points, [one.time for one in usable.values()], noise, cell)
            return {i: now for i, now in zip(usable, results, strict=True) if now is not None}
    return {}


def _goes_on(frame: Frame, first: Frame) -> bool:
    """Whether a frame has points as the first one has, or gratings at the same stations."""
    if frame.curvatures is None or first.curvatures is None:
        return frame.curvatures is first.curvatures
    if frame.stations is None or first.stations is None:
        return False
    return np.array_equal(frame.stations, first.stations)


def along_the_route(frames: Iterable[_T], rig: Rig) -> Iterator[_T | Frame]:
    """Put the points of frames in order where the rig wants it; each route begins where the last one did."""
    first: Points | None = None
    for frame in frames:
        if rig.shape.order == "given" or not isinstance(frame, Frame):
            yield frame
            continue
        if frame.stations is not None or len(frame.points) < MIN_POINTS:
            yield frame
            continue
        ordered = frame
        with suppress(TssgeomError):  # the fit refuses what has too many points
            ordered = in_order(frame, first)
        first = ordered.points[0] if len(ordered.points) else first
        yield ordered


def _in_order(frame: _T | Frame, now: PointFilter | None) -> _T | Frame:
    """Return a frame with its points in the order of the others, where some were exchanged."""
    if not isinstance(frame, Frame) or now is None or now.order is None:
        return frame
    return with_rows(frame, now.order)


def smoothed_at_once(frames: Sequence[_T], rig: Rig) -> list[tuple[_T | Frame, PointFilter | None]]:
    """Return recorded frames with the filters of their points, where these go on."""
    known = smoothed_in_time(frames, rig)
    return [(frame, known.get(i)) for i, frame in enumerate(_with_outlying_lengths(frames, known))]


def _with_outlying_lengths(frames: Sequence[_T], known: Mapping[int, PointFilter]) -> list[_T | Frame]:
    """Return recorded frames, with a warning where one is not as long as those before and after it; (331)."""
    points = {
        i: frame.points
        for i, each in enumerate(frames)
        if isinstance(frame := _in_order(each, known.get(i)), Frame) and frame.curvatures is None
    }
    said = outlying_lengths(points)
    return [
        replace(frame, warnings=(*frame.warnings, said[i]))
        if i in said and isinstance(frame, Frame)
        else frame
        for i, frame in enumerate(frames)
    ]


def smoothed_in_windows(frames: Iterable[_T], rig: Rig) -> Iterator[tuple[_T | Frame, PointFilter | None]]:
    """Yield frames with the filters of their points, where these go on."""
    rest = along_the_route(frames, rig)
    first = list(islice(rest, 1))
    points = max(first[0].points.shape[0], 1) if first and isinstance(first[0], Frame) else 1
    count = min(max(_WINDOW.points // points, _WINDOW.overlap), _WINDOW.most)
    before, block = list[_T | Frame](), first + list(islice(rest, count))
    while block:
        after = list(islice(rest, count))
        every = (*before, *block, *after[: _WINDOW.overlap])
        known = smoothed_at_once(every, rig)[: len(before) + len(block)]
        yield from known[len(before) :]
        latest = zip((*before, *block), known, strict=True)
        before = [_in_order(frame, now) for frame, (_, now) in latest][-_WINDOW.overlap :]
        block = after
