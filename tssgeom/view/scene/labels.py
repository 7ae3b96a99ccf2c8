"""The camera of a view, the longest axis of a route across the screen, and where labels stand in it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.route.pieces import Arcs
from tssgeom.view.samples import RouteSamples, round_down

_HALF_FIELD = math.radians(27.5)
"""Half of the vertical field of view of a spatial view [rad]."""
_BORDER = 1.25
ASPECT = 1.5
"""Width of the spatial view over its height, on a common screen."""
_TIE = np.array([1e-6, 1e-7, 1e-8])
"""Decides the direction across the screen of a route whose ends coincide or lie one above the other."""
_ASIDE = 0.05
"""How far beyond the right end of a route the axes of space stand [heights of the view]; chosen: they are off
a route that ends there, and inside the view."""
_TRIAD = 0.045
"""Length of the axes of space [heights of the view]; chosen: shorter than the room below a route."""
_LETTER = np.array([0.03, 0.042])
"""Size of a letter with its ground [heights of the view]."""
_SHORT = 0.45
"""Length of an axis on the picture below which its letter stands opposite the others; chosen: 27° off the
view."""
_LABEL_RISE = 0.025
"""Rerun writes a label below its point; lifted by this part of the view's height it sits on it."""


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera that shows the whole route."""

    target: Vector
    """Point in the middle of the screen [m]."""
    axes: Matrix
    """Unit vectors to the right of the screen, up the screen and towards the eye, one a row."""
    half_width: float
    """Half of the extent of the route across the screen [m]."""
    half_height: float
    """Half of its extent up the screen [m]."""
    half_depth: float
    """Half of its extent along the view [m]."""

    @property
    def across(self) -> Vector:
        """Unit vector to the right of the screen."""
        return self.axes[0]

    @property
    def up(self) -> Vector:
        """Unit vector up the screen."""
        return self.axes[1]

    @property
    def view_height(self) -> float:
        """Height of the view at the target [m]."""
        return 2 * _BORDER * max(self.half_height, self.half_width / ASPECT)

    @property
    def distance(self) -> float:
        """Distance from the eye to the target [m]."""
        return 0.5 * self.view_height / math.tan(_HALF_FIELD) + self.half_depth

    @property
    def eye(self) -> Vector:
        """Position of the eye [m]."""
        return self.target + self.distance * self.axes[2]

    @property
    def room_below(self) -> float:
        """Distance below the route at which a scale bar with its number fits [heights of the view]."""
        return min(0.08, 0.44 - self.half_height / self.view_height)

    def scale_bar(self, below: float) -> tuple[Points, str]:
        """Return the ends of a bar `below` the route [heights of the view], and its length as text."""
        length = round_down(0.3 * self.half_width)
        down = self.half_height + below * self.view_height
        left = self.target - self.half_width * self.across - down * self.up
        return np.array([left, left + length * self.across]), f"{1e3 * length:g} mm"

    def triad(self, below: float) -> tuple[Points, Points]:
        """Return axes x, y, z [3, 2, 3] `below` the route on the right, and where their letters stand."""
        down = self.half_height + below * self.view_height
        right = self.half_width + _ASIDE * self.view_height
        origin = self.target + right * self.across - down * self.up
        reach = _TRIAD * self.view_height * np.eye(3)
        letters = axis_letters(self.axes[:2].T, _TRIAD, 0.5 * _TRIAD, _LETTER) @ self.axes[:2]
        letters = self.view_height * letters
        origin = origin - min(0.0, float((letters @ self.up).min())) * self.up  # none reaches below
        return np.stack([np.broadcast_to(origin, (3, 3)), origin + reach], axis=1), origin + letters

    def project(self, points: Points) -> Vector:
        """Positions of points on the screen [n, 2], right and up from its middle, in heights of the view."""
        local = (points - self.target) @ self.axes.T
        return local[:, :2] / self._view_height_at(local[:, 2])

    def label_anchor(self, position: Points, shift: Vector, text_scale: float = 1.0) -> Points:
        """Point under which Rerun writes a label whose centre is `shift` away from `position` on the screen.

        `text_scale` is the size of text over its usual size, relative to the route.
        """
        lifted = shift + np.array([0.0, text_scale * _LABEL_RISE])
        depth = (position - self.target) @ self.axes[2]
        return position + self._view_height_at(depth) * lifted @ self.axes[:2]

    def _view_height_at(self, depth: Vector) -> Vector:
        """Height of the view [n, 1] nearer to the eye than the target by `depth` [m]."""
        return 2 * math.tan(_HALF_FIELD) * (self.distance - depth)[:, None]


def axis_letters(plane: Matrix, reach: float, beyond: float, size: Vector) -> Matrix:
    """Choose where the letters of x, y and z stand on a picture, from the origin of the axes.

    Parameters
    ----------
    plane
        [3, 2] Directions of the axes on the picture; an axis along the view is short.
    reach, beyond
        Length of an axis across the view, and distance of its letter beyond its end, in units of the picture.
    size
        [2] Size of a letter with the room about it.
    """
    letters = list[Vector]()
    for direction in plane:
        short = np.linalg.norm(direction) < _SHORT
        away = -plane.sum(axis=0) if short else direction
        away = away / max(float(np.linalg.norm(away)), 1e-9)
        at = reach * direction + beyond * away
        while any((np.abs(at - other) < size).all() for other in letters):
            at = at + 0.4 * beyond * away
        letters.append(at)
    return np.array(letters)


def camera(points: Points, forward: Vector) -> Camera:
    """Face the plane in which the points spread most.

    Parameters
    ----------
    points
        All positions that the route takes [m].
    forward
        Vector from the proximal to the distal end; to the right of the screen where possible [m].
    """
    across, up = _principal_axes(points)
    forward = forward / max(float(np.linalg.norm(forward)), 1e-300) + _TIE
    across = across if across @ forward >= 0 else -across
    up = up if up @ (0.1, 1.0, 1.5) >= 0 else -up
    axes = np.stack([across, up, np.cross(across, up)])
    low, high = (points @ axes.T).min(axis=0), (points @ axes.T).max(axis=0)
    half = 0.5 * (high - low)
    floor = max(0.02 * half[0], 1e-6)
    return Camera(0.5 * (low + high) @ axes, axes, *np.maximum(half, floor).tolist())


def _principal_axes(points: Points) -> tuple[Vector, Vector]:
    centred = points - points.mean(axis=0)
    _, directions = np.linalg.eigh(centred.T @ centred)
    return directions[:, 2], directions[:, 1]


_HALF_SIZE, _HALF_NUMBER, _HALF_SCALE = np.array([[0.13, 0.021], [0.03, 0.021], [0.045, 0.021]])
"""Half of the size of a label, of the number of a piece alone and of the length of the scale bar, as parts
of the view's height."""
_HALF_TIME, _HALF_LETTER = np.array([[0.065, 0.021], [0.015, 0.021]])
"""Half of the size of the time of a frame, and of a letter of the axes, in heights of the view."""
_MOST_LABELLED = 6
"""Pieces with a label of their own; chosen: more cover a view, and the table and the joints hold all."""
_FIRST = 3
"""Labels of the scale and of both ends, which come first."""
_CLEARANCE, _DISTANCES, _EDGE = 0.025, (1.0, 3.0), np.array([0.8, 0.49])
"""Distance of a label from the route, multiples of it at which one may stand, the nearest first, and right
and upper edge of the view from its middle; in heights of the view."""
_ALONG_PIECE = np.array([0.5, 0.3, 0.7, 0.15, 0.85])
"""Shares of a piece beside which its label may stand, in order of preference."""
_END_TURNS = np.radians([0.0, 45.0, -45.0, 90.0, -90.0, 135.0, -135.0])
"""Directions of the label of an end, from that in which the route ends, in order of preference [rad]."""
_NODE_STEP = 2  # between the nodes that a label has to avoid: each of them would be more than needed


@dataclass(frozen=True, slots=True)
class LabelPositions:
    """Positions of the labels of both ends and of the k pieces that have one."""

    position: Points
    """[2 + k, 3] Points under which Rerun writes them [m]."""
    whole: NDArray[np.bool_]
    """[2 + k] False where there is room only for the number of a piece."""


@dataclass(frozen=True, slots=True)
class Candidates:
    """For each of n labels m candidates, the best first: a point of the route, and a shift on the screen."""

    position: NDArray[np.float64]
    """[n, m, 3] The point of the route [m]."""
    shift: NDArray[np.float64]
    """[n, m, 2] From there to the middle of the label, in heights of the view."""
    half: NDArray[np.float64]
    """[n, m, 2] Half of the size of the label, in heights of the view."""


def labelled(arcs: Arcs) -> NDArray[np.intp]:
    """Return the pieces that have a label, in their order: those of the largest angles."""
    return np.sort(np.argsort(-arcs.angle, kind="stable")[:_MOST_LABELLED])


def label_positions(
    camera: Camera, frame: RouteSamples, arcs: Arcs, text_scale: float = 1.0
) -> LabelPositions:
    """Choose positions for the labels of both ends, then of the pieces; that of the scale is fixed.

    `text_scale` is the size of text over its usual size, relative to the route: larger in a low view.
    """
    groups = [
        _at_scale(camera, text_scale),
        _around(*_at_ends(camera, frame), text_scale, (_HALF_SIZE,)),
        _around(*_at_pieces(camera, frame, arcs), text_scale, (_HALF_SIZE, _HALF_NUMBER)),
    ]
    position = np.concatenate([group.position.reshape(-1, 3) for group in groups])
    shift = np.concatenate([group.shift.reshape(-1, 2) for group in groups])
    half = np.concatenate([group.half.reshape(-1, 2) for group in groups])
    counts = np.repeat([group.shift.shape[1] for group in groups], [len(group.shift) for group in groups])
    bar, _ = camera.scale_bar(camera.room_below)
    taken = camera.project(np.vstack([frame.position[::_NODE_STEP], bar]))
    taken = np.concatenate([taken, _at_foot(camera, text_scale)])
    chosen = _chosen(camera.project(position) + shift, half, counts, taken, _EDGE)[1:]
    whole = half[chosen, 0] == text_scale * _HALF_SIZE[0]
    return LabelPositions(camera.label_anchor(position[chosen], shift[chosen], text_scale), whole)


def scale_label(camera: Camera, text_scale: float = 1.0) -> tuple[Points, str, Points]:
    """Return the ends of the scale bar, its length as text, and the anchor of that text, right of the bar."""
    bar, text = camera.scale_bar(camera.room_below)
    only = _at_scale(camera, text_scale)
    return bar, text, camera.label_anchor(only.position[0], only.shift[0], text_scale)


def time_position(camera: Camera) -> Points:
    """Return where the time of a frame stands, in the middle below the route, [1, 3] [m]."""
    bar, _ = camera.scale_bar(camera.room_below)
    return (bar.mean(axis=0) + camera.half_width * camera.across)[None]


def _at_foot(camera: Camera, text_scale: float) -> NDArray[np.float64]:
    """Return the corners of the labels below the route that do not move: the time, and x, y and z."""
    _, letters = camera.triad(camera.room_below)
    corners = np.array([[x, y] for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0, 1.0)])
    pairs = ((time_position(camera), _HALF_TIME), (letters, _HALF_LETTER))
    return np.concatenate(
        [(camera.project(at)[:, None] + text_scale * half * corners).reshape(-1, 2) for at, half in pairs]
    )


def _at_scale(camera: Camera, text_scale: float) -> Candidates:
    """Return the one candidate for the length of the scale bar."""
    bar, _ = camera.scale_bar(camera.room_below)
    right = np.array([[[_HALF_SCALE[0] + 0.5 * _CLEARANCE, 0.0]]])
    return Candidates(bar[None, 1:], text_scale * right, text_scale * _HALF_SCALE[None, None])


def _at_ends(camera: Camera, frame: RouteSamples) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return both ends [2, m, 3], and the directions of their labels from there [2, m, 2]."""
    reach = min(0.1 * camera.half_width, 0.5 * frame.s[-1])
    ends, inner = frame.position[[0, -1]], frame.at(np.array([reach, frame.s[-1] - reach]))
    onwards = _unit(camera.project(ends) - camera.project(inner))
    turned = np.arctan2(onwards[:, 1], onwards[:, 0])[:, None] + _END_TURNS
    directions = np.stack([np.cos(turned), np.sin(turned)], axis=2)
    return np.repeat(ends[:, None], len(_END_TURNS), axis=1), directions


def _at_pieces(
    camera: Camera, frame: RouteSamples, arcs: Arcs
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points of each labelled piece, and directions to the outer, then the inner side of its bend."""
    chosen = labelled(arcs)
    length = arcs.length[chosen, None]
    s = arcs.s_start[chosen, None] + length * _ALONG_PIECE
    reach = np.minimum(0.25 * length, 0.15 * camera.half_width)
    steps = frame.at(np.concatenate([(s + step).ravel() for step in (-reach, 0.0, reach)]))
    before, here, after = camera.project(steps).reshape(3, -1, 2)
    outward = _outward(_unit(after - before), after + before - 2 * here).reshape(*s.shape, 2)
    middles = steps.reshape(3, *s.shape, 3)[1]
    return np.tile(middles, (1, 2, 1)), np.concatenate([outward, -outward], axis=1)


def _outward(along: Vector, bend: Vector) -> Vector:
    """Return unit vectors [n, 2] square to `along` and away from where it bends to."""
    left = np.column_stack([-along[:, 1], along[:, 0]])
    inward = np.sum(left * bend, axis=1) > 1e-6
    return np.where(inward[:, None], -left, left)


def _unit(directions: Vector) -> Vector:
    return directions / np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-300)


def _around(
    position: NDArray[np.float64],
    directions: NDArray[np.float64],
    text_scale: float,
    sizes: tuple[Vector, ...],
) -> Candidates:
    """Candidates in each direction, just clear of the route, then farther off, then so of the next size."""
    each = [
        (text_scale * size, text_scale * _CLEARANCE * distance) for size in sizes for distance in _DISTANCES
    ]
    shift = [directions * (np.abs(directions) @ half + clear)[:, :, None] for half, clear in each]
    half = [np.broadcast_to(half, directions.shape) for half, _ in each]
    return Candidates(
        np.tile(position, (1, len(each), 1)), np.concatenate(shift, axis=1), np.concatenate(half, axis=1)
    )


def _chosen(
    centres: Points, half: Points, counts: NDArray[np.intp], taken: Points, edge: Vector
) -> NDArray[np.intp]:
    """Choose for each label in turn the first free candidate, or else the one with the most room.

    Room is the distance to the nearest of the `taken` points, in half sizes of the label, and that to another
    label, in the sum of both half sizes; a candidate beyond the `edge` has a tenth of it. A candidate that
    covers another label comes after all others, and one that covers the scale or an end last of all.
    """
    free = _spacing(centres[:, None] - taken, half[:, None]).min(axis=1, initial=np.inf)
    beyond = np.asarray((np.abs(centres) > edge - half).any(axis=1))
    chosen = list[int]()
    ends = np.cumsum(counts)
    for first, end in zip(ends - counts, ends, strict=True):
        apart = _spacing(centres[first:end, None] - centres[chosen], half[first:end, None] + half[chosen])
        apart = np.where((apart < 1.0) & (np.arange(len(chosen)) < _FIRST), apart - 1.0, apart)
        to_labels = apart.min(axis=1, initial=np.inf)
        room = np.minimum(free[first:end], to_labels)
        room = np.where(beyond[first:end], 0.1 * np.minimum(room, 1.0), room)
        room = np.where(to_labels < 1.0, to_labels - 1.0, room)
        good = np.flatnonzero(room >= 1.0)
        chosen.append(int(first + (good[0] if len(good) else np.argmax(room))))
    return np.array(chosen)


def _spacing(between: NDArray[np.float64], half: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the larger component of distances on the screen [..., 2], in half sizes."""
    parts = np.abs(between) / half
    return np.maximum(parts[..., 0], parts[..., 1])
