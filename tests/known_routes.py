"""Routes with known truth, and the cells of the benchmark: a cell is one route sensed in one way.

Every trial of a cell draws its points anew, the same at each call.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np

from tests.random_courses import CELLS, RANDOM
from tssgeom.arrays import Points, Vector
from tssgeom.route import synthetic
from tssgeom.route.synthetic import Course, chain

_HARMONICS = 4
_GRID = 4001


@dataclass(frozen=True, slots=True)
class Truth:
    """One route, known exactly."""

    position: Callable[[Vector], Points]
    """Points [n, 3] at arc lengths [n] [m]."""
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


def arc_positions(course: Course) -> Callable[[Vector], Points]:
    """Points at arc lengths [n] [m] along a chain of arcs, all at once."""
    joints, axes = synthetic.frames(course)
    begin = np.concatenate(([0.0], np.cumsum(course.length)))

    def position(s: Vector) -> Points:
        piece = np.clip(np.searchsorted(begin, s, side="right") - 1, 0, len(course.length) - 1)
        t, bend = s - begin[piece], course.bend[piece]
        turn = np.linalg.norm(bend, axis=1) * t / np.pi
        aside = 0.5 * (t * np.sinc(0.5 * turn)) ** 2
        local = np.column_stack((t * np.sinc(turn), aside[:, None] * bend))
        return joints[piece] + np.einsum("ni,nij->nj", local, axes[piece])

    return position


def of_arcs(course: Course, *, piecewise: bool) -> Truth:
    """Truth of a chain of arcs; `piecewise` where its arcs are the pieces that a fit should find."""
    s = np.concatenate(([0.0], np.cumsum(course.length)))
    turns = np.hypot(*course.bend.T) * course.length
    phi = np.concatenate(([0.0], np.cumsum(turns)))
    return Truth(arc_positions(course), s, phi, course if piecewise else None)


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
    return Truth(arc_positions(course), edges, 20.0 * edges**2, None)


def _colon() -> Truth:
    return of_arcs(synthetic.colon(), piecewise=False)


def harmonic_course(rng: np.random.Generator) -> Course:
    """Draw half a metre with a few random harmonics in each component of the curvature vector."""
    t = (np.arange(CELLS) + 0.5) / CELLS
    wave = np.arange(_HARMONICS)[:, None] * np.pi * t
    size = 12.0 / np.sqrt(_HARMONICS) * rng.standard_normal((2, _HARMONICS))
    phase = rng.uniform(0.0, 2 * np.pi, (2, _HARMONICS))
    bend = np.einsum("ck,ckt->tc", size, np.cos(wave + phase[:, :, None]))
    return Course(np.full(CELLS, 0.5 / CELLS), bend)


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
    """Return the named route; random ones are new at each call, from `rng`."""
    course = {"harmonics": harmonic_course, **RANDOM}.get(name)
    return _fixed(name) if course is None else of_arcs(course(rng), piecewise=False)


Stations = Literal["known", "even", "jitter", "random"]

_JITTER = 0.2  # of the spacing
_OUTLIER = 20.0  # standard deviations of one coordinate
_COUNTS = (8, 15, 30, 200, 1000)
_NOISES = (5e-5, 1e-4, 1e-3, 2e-3)
_NOISE = 5e-4  # where only the number of points changes [m]


@dataclass(frozen=True, slots=True)
class Cell:
    """One route, sensed in one way."""

    group: str
    route: str
    n: int
    noise: float
    """True standard deviation of each coordinate [m]."""
    stations: Stations = "known"
    """Even and known ("known"); unknown and even, jittered by a fifth of the spacing, or uniformly random."""
    noise_known: bool = True
    """Whether the noise is known to the estimators of this project."""
    outliers: float = 0.0
    """Share of the inner points that lie 20 standard deviations off [1]."""
    gap: float = 0.0
    """Share of missing points, in two stretches [1]."""
    shared: tuple[float, float] = (0.0, 0.0)
    """Size of errors that neighbours share, and how far along the route they do, over its length [1]."""

    @property
    def name(self) -> str:
        """What distinguishes this cell in its group."""
        parts = [f"{self.route:11}", f"N {self.n:<4}", f"{self.noise * 1e3:g} mm".ljust(7), self.stations]
        if self.outliers:
            parts.append(f"{100 * self.outliers:g} % outliers")
        if self.gap:
            parts.append(f"{100 * self.gap:g} % missing")
        if self.shared[0]:
            parts.append(f"{1e3 * self.shared[0]:g} ‰ over {100 * self.shared[1]:g} %")
        return " ".join(parts)

    @property
    def title(self) -> str:
        """Name with the group, which `--cell` searches."""
        return f"{self.group}: {self.name}"


@dataclass(frozen=True, slots=True)
class Draw:
    """Points of one trial."""

    truth: Truth
    points: Points
    """Noisy points; a row of NaN is a missing point [m]."""
    station: Vector
    """True arc length of each point [m]."""
    good: np.ndarray
    """Which points are neither missing nor outliers."""


def draw(cell: Cell, trial: int) -> Draw:
    """Draw one trial, the same at every call and whatever else is run."""
    rng = np.random.default_rng([zlib.crc32(cell.title.encode()), trial])
    route = truth(cell.route, rng)
    station = _stations(cell, rng) * route.length
    points = route.position(station) + cell.noise * rng.standard_normal((cell.n, 3))
    if cell.shared[0]:
        points += _shared_errors(cell, station / route.length, rng) * route.length
    outlier = rng.choice(np.arange(1, cell.n - 1), round(cell.outliers * cell.n), replace=False)
    points[outlier] += _OUTLIER * cell.noise * _directions(len(outlier), rng)
    missing = _missing(cell, rng)
    points[missing] = np.nan
    good = np.ones(cell.n, dtype=bool)
    good[outlier], good[missing] = False, False
    return Draw(route, points, station, good)


def _shared_errors(cell: Cell, station: Vector, rng: np.random.Generator) -> Points:
    """Errors of a Gaussian process along the route, over its length."""
    size, reach = cell.shared
    alike = np.exp(-0.5 * ((station[:, None] - station) / reach) ** 2) + 1e-8 * np.eye(cell.n)
    return size * np.linalg.cholesky(alike) @ rng.standard_normal((cell.n, 3))


def _stations(cell: Cell, rng: np.random.Generator) -> Vector:
    """Stations as a share of the length, the first 0 and the last 1."""
    s = np.linspace(0.0, 1.0, cell.n)
    if cell.stations == "jitter":
        s[1:-1] += _JITTER / (cell.n - 1) * rng.standard_normal(cell.n - 2)
    elif cell.stations == "random":
        s[1:-1] = rng.uniform(0.0, 1.0, cell.n - 2)
    return np.sort(np.clip(s, 0.0, 1.0))


def _directions(n: int, rng: np.random.Generator) -> Points:
    way = rng.standard_normal((n, 3))
    return way / np.linalg.norm(way, axis=1)[:, None]


def _missing(cell: Cell, rng: np.random.Generator) -> np.ndarray:
    """Two stretches of points, one in each half of the route."""
    size = round(0.5 * cell.gap * cell.n)
    starts = np.array([rng.uniform(0.05, 0.45), rng.uniform(0.5, 0.9)]) * (cell.n - size - 2)
    return (starts.astype(int)[:, None] + 1 + np.arange(size)).ravel()


def _sizes_and_noises(group: str, route: str, stations: Stations) -> Iterator[Cell]:
    for n in _COUNTS:
        yield Cell(group, route, n, _NOISE, stations)
    for noise in _NOISES:
        yield Cell(group, route, 200, noise, stations)


def _even_and_random(group: str, route: str) -> Iterator[Cell]:
    yield Cell(group, route, 200, _NOISE, "even")
    yield Cell(group, route, 200, _NOISE, "random")


def _unknown_noise(group: str, route: str) -> Iterator[Cell]:
    for n in (30, 200):
        yield Cell(group, route, n, _NOISE, "known", noise_known=False)
        yield Cell(group, route, n, _NOISE, "jitter", noise_known=False)


def _spoilt(route: str) -> Iterator[Cell]:
    ways: tuple[Stations, ...] = ("known", "jitter")
    for stations in ways:
        for outliers in (0.01, 0.05):
            yield Cell("outliers", route, 200, _NOISE, stations, outliers=outliers)
        yield Cell("gaps", route, 200, _NOISE, stations, gap=0.2)


def _new_routes() -> Iterator[Cell]:
    for route in ("pieces", "harmonics"):
        for n in (5, 8, 12, 20, 40):
            for noise in (2e-5, 2e-4, 2e-3):
                yield Cell("few points", route, n, noise, "jitter", noise_known=False)
    for n in (5, 8, 12, 20):
        for known in (True, False):
            group = f"alternating arcs, noise {'known' if known else 'unknown'}"
            yield Cell(group, "alternating", n, 2e-4, "jitter", noise_known=known)
    for n in (20, 60, 150):
        for noise in (5e-5, 2e-4, 1e-3):
            yield Cell("weakly bent", "slopes", n, noise, "jitter", noise_known=False)


def _correlated() -> Iterator[Cell]:
    for route in ("half circle", "7 pieces", "colon", "harmonics"):
        for shared in ((1e-3, 0.02), (1e-3, 0.08)):
            yield Cell("correlated errors", route, 150, 5e-5, "even", noise_known=False, shared=shared)


def catalogue() -> tuple[Cell, ...]:
    """Every cell of the full run, group after group."""
    cells: list[Cell] = []
    for kind, routes in (("piecewise", PIECEWISE), ("smooth", SMOOTH)):
        for route in routes:
            cells += _sizes_and_noises(f"{kind}, stations known", route, "known")
            cells += _sizes_and_noises(f"{kind}, stations unknown", route, "jitter")
            cells += _even_and_random(f"{kind}, stations unknown", route)
            cells += _unknown_noise(f"{kind}, noise unknown", route)
    for route in ("half circle", "7 pieces", "colon", "harmonics"):
        cells += _spoilt(route)
    cells += [*_new_routes(), *_correlated()]
    groups = list(dict.fromkeys(cell.group for cell in cells))
    return tuple(sorted(cells, key=lambda cell: groups.index(cell.group)))


def quick() -> tuple[Cell, ...]:
    """Return the few cells of the quick run."""
    return (
        Cell("quick", "line", 200, _NOISE),
        Cell("quick", "half circle", 30, _NOISE, "jitter"),
        Cell("quick", "setup A", 200, _NOISE),
        Cell("quick", "6 pieces", 200, _NOISE),
        Cell("quick", "7 pieces", 200, _NOISE, "jitter", noise_known=False),
        Cell("quick", "colon", 200, _NOISE),
        Cell("quick", "harmonics", 200, _NOISE, "jitter", noise_known=False),
        Cell("quick", "slopes", 60, 2e-4, "jitter", noise_known=False),
    )
