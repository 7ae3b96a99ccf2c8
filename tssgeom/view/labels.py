"""Places for labels on the screen: near what they name, off the route and off one another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
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
    """Where one label may go, the best first: near `place` and `shift` away from it on the screen."""

    place: Points
    """[m, 3] [m]."""
    shift: Vector
    """[m, 2] in heights of the view."""


def label_places(camera: Camera, frame: Drawn, arcs: Arcs) -> Points:
    """Places [2 + k, 3] from which Rerun hangs the labels of both ends and of the k pieces [m]."""
    candidates = [*_at_ends(camera, frame), *_at_pieces(camera, frame, arcs)]
    bar, _ = camera.scale_bar(camera.room_below)
    taken = camera.project(np.vstack([frame.position[::_COARSE], bar]))
    return np.vstack(_chosen(camera, candidates, taken))


def _at_ends(camera: Camera, frame: Drawn) -> list[Candidates]:
    reach = min(0.1 * camera.half_width, 0.5 * frame.s[-1])
    ends, inner = frame.position[[0, -1]], frame.at(np.array([reach, frame.s[-1] - reach]))
    onwards = _unit(camera.project(ends) - camera.project(inner))
    return [_around(end, _turned(way)) for end, way in zip(ends, onwards, strict=True)]


def _at_pieces(camera: Camera, frame: Drawn, arcs: Arcs) -> list[Candidates]:
    """Candidates on the outer side of each bend, on the inner side, and beside other parts of the piece."""
    part = np.array(_ALONG_PIECE)
    s = arcs.s_start[:, None] + arcs.length[:, None] * part
    reach = np.minimum(0.25 * arcs.length, 0.15 * camera.half_width)[:, None]
    before, here, after = (frame.at((s + step).ravel()) for step in (-reach, 0.0, reach))
    seen = [camera.project(places) for places in (before, here, after)]
    outward = _outward(_unit(seen[2] - seen[0]), seen[2] + seen[0] - 2 * seen[1])
    places, ways = here.reshape(-1, len(part), 3), outward.reshape(-1, len(part), 2)
    return [
        _around(np.tile(place, (2, 1)), np.vstack([way, -way]))
        for place, way in zip(places, ways, strict=True)
    ]


def _outward(along: Vector, bend: Vector) -> Vector:
    """Return unit vectors [n, 2] square to `along` and away from where it bends to."""
    left = np.column_stack([-along[:, 1], along[:, 0]])
    inward = np.sum(left * bend, axis=1) > 1e-6
    return np.where(inward[:, None], -left, left)


def _turned(way: Vector) -> Vector:
    """Return copies of a direction, turned by all of `_TURNS` [m, 2]."""
    start = math.atan2(way[1], way[0])
    return np.column_stack([np.cos(start + _TURNS), np.sin(start + _TURNS)])


def _unit(ways: Vector) -> Vector:
    return ways / np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-300)


def _around(place: Points, ways: Vector) -> Candidates:
    """Candidates in each direction, just clear of the place, and then the same farther off."""
    shift = ways * (np.abs(ways) @ _HALF_SIZE + _GAP)[:, None]
    places = np.broadcast_to(place, (len(ways), 3))
    return Candidates(np.vstack([places, places]), np.vstack([shift, _FARTHER * shift]))


def _chosen(camera: Camera, labels: Sequence[Candidates], taken: Vector) -> list[Points]:
    """Take for each label in turn the first free candidate, or else the one that is least in the way."""
    chosen, centres = [], np.empty((0, 2))
    for label in labels:
        here = camera.project(label.place) + label.shift
        room = np.minimum(_room(here, taken), 0.5 * _room(here, centres))
        room = np.where(_inside(here), room, 0.1 * room)
        best = int(np.argmax(room >= 1.0)) if (room >= 1.0).any() else int(np.argmax(room))
        centres = np.vstack([centres, here[best]])
        chosen.append(camera.label_anchor(label.place[[best]], label.shift[[best]]))
    return chosen


def _inside(centres: Vector) -> NDArray[np.bool_]:
    return np.all(np.abs(centres) <= _EDGE - _HALF_SIZE, axis=1)


def _room(centres: Vector, others: Vector) -> Vector:
    """Distance from each centre to the nearest of `others`, in half sizes of a label."""
    apart = np.abs(centres[:, None] - others[None]) / _HALF_SIZE
    return apart.max(axis=2).min(axis=1, initial=np.inf)
