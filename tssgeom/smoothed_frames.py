"""Points of recorded frames, filtered by those before and after each; docs/model.md (162)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import islice
from typing import NamedTuple, TypeVar

import numpy as np

from tssgeom.arrays import Points
from tssgeom.errors import TssgeomError
from tssgeom.frame import Frame, fit_frame, in_order, with_rows
from tssgeom.rig import Rig
from tssgeom.route.fibre.models import stretches
from tssgeom.route.observations import MIN_POINTS
from tssgeom.route.outlying_lengths import outlying_lengths
from tssgeom.route.time_filter import PointFilter
from tssgeom.route.time_smoother import smoothed

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
