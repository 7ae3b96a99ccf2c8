"""The camera of a view: the longest axis of a route across the screen, its proximal end on the left."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.view.samples import round_down

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
