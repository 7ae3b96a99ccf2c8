"""Places for labels on the screen: near what they name, off the route and off one another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tssgeom.arrays import Points, Vector
from tssgeom.shape.arcs import Arcs
from tssgeom.view.camera import Camera
from tssgeom.view.drawn import Drawn

_HALF_SIZE = np.array([0.13, 0.025])
_GAP = 0.025
"""Half of the size of a label and its distance from the route, as parts of the view's height."""
_EDGE = np.array([0.8, 0.5])
"""Distance from the middle of the view to its right and upper edge."""
_FARTHER = 1.9
_ALONG_PIECE = (0.5, 0.3, 0.7)
"""Parts of a piece beside which its label may stand, in order of preference."""
_TURNS = np.radians([0.0, 45.0, -45.0, 90.0, -90.0, 135.0, -135.0])
"""Directions of the label of an end, counted from the way on which the route would go on."""
_COARSE = 4
"""Every so many nodes are enough to see where a label is in the way."""


@dataclass(frozen=True, slots=True)
class Candidates:
    """Where n labels may go, m places for each, the best first: near `place`, `shift` away on the screen."""

    place: NDArray[np.float64]
    """[n, m, 3] [m]."""
    shift: NDArray[np.float64]
    """[n, m, 2] in heights of the view."""


def label_places(camera: Camera, frame: Drawn, arcs: Arcs, larger: float = 1.0) -> Points:
    """Places [2 + k, 3] from which Rerun hangs the labels of both ends and of the k pieces [m].

    In a low view text is `larger` beside the route than in one of common height.
    """
    half = larger * _HALF_SIZE
    groups = [
        _around(*_at_ends(camera, frame), half, larger * _GAP),
        _around(*_at_pieces(camera, frame, arcs), half, larger * _GAP),
    ]
    place = np.concatenate([group.place.reshape(-1, 3) for group in groups])
    shift = np.concatenate([group.shift.reshape(-1, 2) for group in groups])
    counts = np.repeat([group.shift.shape[1] for group in groups], [len(group.shift) for group in groups])
    bar, _ = camera.scale_bar(camera.room_below)
    taken = camera.project(np.vstack([frame.position[::_COARSE], bar]))
    chosen = _chosen(camera.project(place) + shift, counts, taken, half, _EDGE - half)
    return camera.label_anchor(place[chosen], shift[chosen])


def _at_ends(camera: Camera, frame: Drawn) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the places [2, m, 3] beside both ends, and the directions [2, m, 2] from there."""
    reach = min(0.1 * camera.half_width, 0.5 * frame.s[-1])
    ends, inner = frame.position[[0, -1]], frame.at(np.array([reach, frame.s[-1] - reach]))
    onwards = _unit(camera.project(ends) - camera.project(inner))
    turned = np.arctan2(onwards[:, 1], onwards[:, 0])[:, None] + _TURNS
    ways = np.stack([np.cos(turned), np.sin(turned)], axis=2)
    return np.repeat(ends[:, None], len(_TURNS), axis=1), ways


def _at_pieces(camera: Camera, frame: Drawn, arcs: Arcs) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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


def _around(place: NDArray[np.float64], ways: NDArray[np.float64], half: Vector, gap: float) -> Candidates:
    """Candidates in each direction, just clear of the place, and then the same farther off."""
    shift = ways * (np.abs(ways) @ half + gap)[:, :, None]
    return Candidates(np.tile(place, (1, 2, 1)), np.concatenate([shift, _FARTHER * shift], axis=1))


@njit(cache=True, nogil=True)
def _chosen(
    centres: Points, counts: NDArray[np.intp], taken: Points, half: Vector, edge: Vector
) -> NDArray[np.intp]:
    """Take for each label in turn the first free candidate, or else the one that is least in the way.

    Room is the distance to the nearest of what is `taken`, and half of that to another label, in half sizes
    of a label; a place beyond the `edge` has a tenth of it.
    """
    chosen = np.empty(len(counts), np.intp)
    first = 0
    for label in range(len(counts)):
        best, most = first, -1.0
        for candidate in range(first, first + counts[label]):
            x, y = centres[candidate]
            room = np.inf
            for k in range(len(taken)):
                room = min(room, max(abs(x - taken[k, 0]) / half[0], abs(y - taken[k, 1]) / half[1]))
            for k in range(label):
                other = centres[chosen[k]]
                room = min(room, 0.5 * max(abs(x - other[0]) / half[0], abs(y - other[1]) / half[1]))
            if abs(x) > edge[0] or abs(y) > edge[1]:
                room *= 0.1
            if room > most:
                best, most = candidate, room
            if room >= 1.0:
                best = candidate
                break
        chosen[label] = best
        first += counts[label]
    return chosen
