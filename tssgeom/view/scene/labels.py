"""Places for labels on the screen: near what they name, off the route and off one another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tssgeom.arrays import Points, Vector
from tssgeom.route.pieces import Arcs
from tssgeom.view.samples import RouteSamples
from tssgeom.view.scene.camera import Camera

_HALF_SIZE, _HALF_NUMBER, _HALF_SCALE = np.array([[0.13, 0.021], [0.03, 0.021], [0.045, 0.021]])
"""Half of the size of a label, of the number of a piece alone and of the length of the scale bar, as parts
of the view's height."""
_GAP = 0.025
"""Distance of a label from the route, as a part of the view's height."""
_EDGE = np.array([0.8, 0.49])
"""Distance from the middle of the view to its right and upper edge."""
_FARTHER = (1.0, 3.0)
"""Distances at which a label may stand, the nearest first, in gaps."""
_ALONG_PIECE = (0.5, 0.3, 0.7, 0.15, 0.85)
"""Parts of a piece beside which its label may stand, in order of preference."""
_TURNS = np.radians([0.0, 45.0, -45.0, 90.0, -90.0, 135.0, -135.0])
"""Directions of the label of an end, counted from the way on which the route would go on."""
_FIRST = 3
"""Labels of the scale and of both ends, which come first."""
_COARSE = 2
"""Every so many nodes are enough to see where a label is in the way."""


@dataclass(frozen=True, slots=True)
class Placed:
    """Where the labels of both ends and of the k pieces stand."""

    place: Points
    """[2 + k, 3] Places from which Rerun hangs them [m]."""
    whole: NDArray[np.bool_]
    """[2 + k] False where there is room only for the number of a piece."""


@dataclass(frozen=True, slots=True)
class Candidates:
    """Where n labels may go, m places for each, the best first: near `place`, `shift` away on the screen."""

    place: NDArray[np.float64]
    """[n, m, 3] [m]."""
    shift: NDArray[np.float64]
    """[n, m, 2] in heights of the view."""
    half: NDArray[np.float64]
    """[n, m, 2] Half of the size of the label there, in heights of the view."""


def label_places(camera: Camera, frame: RouteSamples, arcs: Arcs, larger: float = 1.0) -> Placed:
    """Choose where the labels of both ends and of the pieces stand, first the ends; that of the scale stays.

    In a low view text is `larger` beside the route than in one of common height.
    """
    groups = [
        _at_scale(camera, larger),
        _around(*_at_ends(camera, frame), larger, (_HALF_SIZE,)),
        _around(*_at_pieces(camera, frame, arcs), larger, (_HALF_SIZE, _HALF_NUMBER)),
    ]
    place = np.concatenate([group.place.reshape(-1, 3) for group in groups])
    shift = np.concatenate([group.shift.reshape(-1, 2) for group in groups])
    half = np.concatenate([group.half.reshape(-1, 2) for group in groups])
    counts = np.repeat([group.shift.shape[1] for group in groups], [len(group.shift) for group in groups])
    bar, _ = camera.scale_bar(camera.room_below)
    taken = camera.project(np.vstack([frame.position[::_COARSE], bar]))
    chosen = _chosen(camera.project(place) + shift, half, counts, taken, _EDGE)[1:]
    whole = half[chosen, 0] == larger * _HALF_SIZE[0]
    return Placed(camera.label_anchor(place[chosen], shift[chosen], larger), whole)


def scale_label(camera: Camera, larger: float = 1.0) -> tuple[Points, str, Points]:
    """Return the ends of the scale bar, its length in words, and where Rerun hangs them: right of the bar."""
    bar, text = camera.scale_bar(camera.room_below)
    only = _at_scale(camera, larger)
    return bar, text, camera.label_anchor(only.place[0], only.shift[0], larger)


def _at_scale(camera: Camera, larger: float) -> Candidates:
    """Return the one place of the length of the scale bar."""
    bar, _ = camera.scale_bar(camera.room_below)
    right = np.array([[[_HALF_SCALE[0] + 0.5 * _GAP, 0.0]]])
    return Candidates(bar[None, 1:], larger * right, larger * _HALF_SCALE[None, None])


def _at_ends(camera: Camera, frame: RouteSamples) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the places [2, m, 3] beside both ends, and the directions [2, m, 2] from there."""
    reach = min(0.1 * camera.half_width, 0.5 * frame.s[-1])
    ends, inner = frame.position[[0, -1]], frame.at(np.array([reach, frame.s[-1] - reach]))
    onwards = _unit(camera.project(ends) - camera.project(inner))
    turned = np.arctan2(onwards[:, 1], onwards[:, 0])[:, None] + _TURNS
    ways = np.stack([np.cos(turned), np.sin(turned)], axis=2)
    return np.repeat(ends[:, None], len(_TURNS), axis=1), ways


def _at_pieces(
    camera: Camera, frame: RouteSamples, arcs: Arcs
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the same on the outer side of each bend, then on its inner side, beside parts of the piece."""
    part = np.array(_ALONG_PIECE)
    s = arcs.s_start[:, None] + arcs.length[:, None] * part
    reach = np.minimum(0.25 * arcs.length, 0.15 * camera.half_width)[:, None]
    steps = frame.at(np.concatenate([(s + step).ravel() for step in (-reach, 0.0, reach)]))
    before, here, after = camera.project(steps).reshape(3, -1, 2)
    outward = _outward(_unit(after - before), after + before - 2 * here).reshape(*s.shape, 2)
    places = steps.reshape(3, *s.shape, 3)[1]
    return np.tile(places, (1, 2, 1)), np.concatenate([outward, -outward], axis=1)


def _outward(along: Vector, bend: Vector) -> Vector:
    """Return unit vectors [n, 2] square to `along` and away from where it bends to."""
    left = np.column_stack([-along[:, 1], along[:, 0]])
    inward = np.sum(left * bend, axis=1) > 1e-6
    return np.where(inward[:, None], -left, left)


def _unit(ways: Vector) -> Vector:
    return ways / np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-300)


def _around(
    place: NDArray[np.float64], ways: NDArray[np.float64], larger: float, sizes: tuple[Vector, ...]
) -> Candidates:
    """Candidates in each direction, just clear of the place, then farther off, then so of the next size."""
    each = [(larger * size, larger * _GAP * far) for size in sizes for far in _FARTHER]
    shift = [ways * (np.abs(ways) @ half + gap)[:, :, None] for half, gap in each]
    half = [np.broadcast_to(half, ways.shape) for half, _ in each]
    return Candidates(
        np.tile(place, (1, len(each), 1)), np.concatenate(shift, axis=1), np.concatenate(half, axis=1)
    )


@njit(cache=True, nogil=True)
def _chosen(
    centres: Points, half: Points, counts: NDArray[np.intp], taken: Points, edge: Vector
) -> NDArray[np.intp]:
    """Take for each label in turn the first free candidate, or else the one that is least in the way.

    Room is the distance to the nearest of what is `taken`, in half sizes of the label, and that to another
    label, in the sum of both; a place beyond the `edge` has a tenth of it. One that covers another label
    comes after all others, and one that covers that of the scale or of an end last of all.
    """
    chosen = np.empty(len(counts), np.intp)
    first = 0
    for label in range(len(counts)):
        best, most = first, -np.inf
        for candidate in range(first, first + counts[label]):
            (x, y), (wide, high) = centres[candidate], half[candidate]
            room = apart = np.inf
            for k in range(len(taken)):
                room = min(room, max(abs(x - taken[k, 0]) / wide, abs(y - taken[k, 1]) / high))
            for k in range(label):
                other, size = centres[chosen[k]], half[chosen[k]]
                gap = max(abs(x - other[0]) / (wide + size[0]), abs(y - other[1]) / (high + size[1]))
                apart = min(apart, gap - 1.0 if gap < 1.0 and k < _FIRST else gap)
            room = min(room, apart)
            if abs(x) > edge[0] - wide or abs(y) > edge[1] - high:
                room = 0.1 * min(room, 1.0)
            if apart < 1.0:
                room = apart - 1.0
            if room > most:
                best, most = candidate, room
            if room >= 1.0:
                best = candidate
                break
        chosen[label] = best
        first += counts[label]
    return chosen
