"""Routes whose every point and angle is known, for the benchmarks to draw noisy points from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from tssgeom.arrays import Points, Vector
from tssgeom.route import synthetic
from tssgeom.route.synthetic import Course, chain

_CELLS = 800  # arcs that stand for one random route
_HARMONICS = 4
_GRID = 4001


@dataclass(frozen=True, slots=True)
class Truth:
    """One route, known exactly."""

    place: Callable[[Vector], Points]
    """Places [n, 3] at arc lengths [n] [m]."""
    s: Vector
    """Arc lengths between which φ is linear, or so fine that it might be [m]."""
    phi: Vector
    """Accumulated curve angle there [rad]."""
    course: Course | None
    """The pieces, where the route is piecewise constant."""

    @property
    def length(self) -> float:
        """Length of the route [m]."""
        return float(self.s[-1])

    @property
    def total_angle(self) -> float:
        """Accumulated curve angle of the whole route, Φ [rad]."""
        return float(self.phi[-1])


def arc_places(course: Course) -> Callable[[Vector], Points]:
    """Places at arc lengths [n] [m] along a chain of arcs, all at once."""
    joints, axes = synthetic.frames(course)
    begin = np.concatenate(([0.0], np.cumsum(course.length)))

    def place(s: Vector) -> Points:
        piece = np.clip(np.searchsorted(begin, s, side="right") - 1, 0, len(course.length) - 1)
        t, bend = s - begin[piece], course.bend[piece]
        turn = np.linalg.norm(bend, axis=1) * t / np.pi
        aside = 0.5 * (t * np.sinc(0.5 * turn)) ** 2
        local = np.column_stack((t * np.sinc(turn), aside[:, None] * bend))
        return joints[piece] + np.einsum("ni,nij->nj", local, axes[piece])

    return place


def of_arcs(course: Course, *, piecewise: bool) -> Truth:
    """Truth of a chain of arcs; `piecewise` where its arcs are the pieces that a fit should find."""
    s = np.concatenate(([0.0], np.cumsum(course.length)))
    turns = np.hypot(*course.bend.T) * course.length
    phi = np.concatenate(([0.0], np.cumsum(turns)))
    return Truth(arc_places(course), s, phi, course if piecewise else None)


def _pieces(length: list[float], kappa: list[float], plane: list[float]) -> Truth:
    return of_arcs(chain(np.array(length), np.array(kappa), np.array(plane)), piecewise=True)


def _line() -> Truth:
    return _pieces([0.5], [0.0], [0.0])


def _half_circle() -> Truth:
    return _pieces([0.5], [2 * np.pi], [0.0])


def _setup_a() -> Truth:
    return of_arcs(synthetic.setup_a(), piecewise=True)


def _six() -> Truth:
    """From straight to 40/m, in three bending planes."""
    planes = [0.0, 0.0, 0.0, 1.2, 0.0, 2.5]
    return _pieces([0.08, 0.10, 0.06, 0.05, 0.12, 0.09], [0.0, 12.0, 0.0, 40.0, 8.0, 20.0], planes)


def _seven() -> Truth:
    """Every piece in a bending plane of its own, two of them straight."""
    planes = [0.0, 1.2, 0.0, -0.8, 2.0, 0.5, 0.0]
    return _pieces(
        [0.07, 0.09, 0.05, 0.08, 0.06, 0.10, 0.05], [5.0, 25.0, 0.0, 15.0, 40.0, 10.0, 0.0], planes
    )


def _helix() -> Truth:
    radius, pitch, length = 0.03, 0.04, 0.42
    c = pitch / (2 * np.pi)
    s = np.linspace(0.0, length, _GRID)
    return Truth(lambda at: synthetic.helix(radius, pitch, at), s, radius / (radius**2 + c**2) * s, None)


def _clothoid() -> Truth:
    """Curvature from 0 to 20/m over half a metre: Φ = 5 rad."""
    edges = np.linspace(0.0, 0.5, _GRID)
    course = chain(np.diff(edges), 40.0 * 0.5 * (edges[1:] + edges[:-1]))
    return Truth(arc_places(course), edges, 20.0 * edges**2, None)


def _colon() -> Truth:
    return of_arcs(synthetic.colon(), piecewise=False)


def _harmonics(rng: np.random.Generator) -> Truth:
    """Draw half a metre with a few random harmonics in each component of the curvature vector."""
    t = (np.arange(_CELLS) + 0.5) / _CELLS
    wave = np.arange(_HARMONICS)[:, None] * np.pi * t
    size = 12.0 / np.sqrt(_HARMONICS) * rng.standard_normal((2, _HARMONICS))
    phase = rng.uniform(0.0, 2 * np.pi, (2, _HARMONICS))
    bend = np.einsum("ck,ckt->tc", size, np.cos(wave + phase[:, :, None]))
    return of_arcs(Course(np.full(_CELLS, 0.5 / _CELLS), bend), piecewise=False)


_FIXED: dict[str, Callable[[], Truth]] = {
    "line": _line,
    "half circle": _half_circle,
    "setup A": _setup_a,
    "6 pieces": _six,
    "7 pieces": _seven,
    "helix": _helix,
    "clothoid": _clothoid,
    "colon": _colon,
}
PIECEWISE = ("line", "half circle", "setup A", "6 pieces", "7 pieces")
SMOOTH = ("helix", "clothoid", "colon", "harmonics")


@cache
def _fixed(name: str) -> Truth:
    return _FIXED[name]()


def truth(name: str, rng: np.random.Generator) -> Truth:
    """Return the named route; "harmonics" is a new one at each call, drawn from `rng`."""
    return _harmonics(rng) if name == "harmonics" else _fixed(name)
