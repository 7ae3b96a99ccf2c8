"""What is measured: every cell is one route seen in one way, and every trial of it a fresh draw of points."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from benchmarks.routes import PIECEWISE, SMOOTH, Truth, truth
from tssgeom.arrays import Points, Vector

Stations = Literal["known", "even", "jitter", "random"]

_JITTER = 0.2  # of the spacing
_OUTLIER = 20.0  # standard deviations of one coordinate
_COUNTS = (8, 15, 30, 200, 1000)
_NOISES = (5e-5, 1e-4, 1e-3, 2e-3)
_NOISE = 5e-4  # where only the number of points changes [m]


@dataclass(frozen=True, slots=True)
class Cell:
    """One route, seen in one way."""

    group: str
    route: str
    n: int
    noise: float
    """True standard deviation of each coordinate [m]."""
    stations: Stations = "known"
    """Even and told ("known"); not told and even, jittered by a fifth of the spacing, or uniformly random."""
    noise_known: bool = True
    """Whether the estimators of this project are told the noise."""
    outliers: float = 0.0
    """Share of the inner points that lie 20 standard deviations off [1]."""
    gap: float = 0.0
    """Share of the points that were not seen, in two stretches [1]."""

    @property
    def name(self) -> str:
        """What tells this cell from the others of its group."""
        parts = [f"{self.route:11}", f"N {self.n:<4}", f"{self.noise * 1e3:g} mm".ljust(7), self.stations]
        if self.outliers:
            parts.append(f"{100 * self.outliers:g} % outliers")
        if self.gap:
            parts.append(f"{100 * self.gap:g} % unseen")
        return " ".join(parts)

    @property
    def title(self) -> str:
        """Name with the group, which `--cell` looks into."""
        return f"{self.group}: {self.name}"


@dataclass(frozen=True, slots=True)
class Draw:
    """What one trial saw."""

    truth: Truth
    points: Points
    """Noisy points; a row of NaN was not seen [m]."""
    station: Vector
    """True arc length of each point [m]."""
    good: np.ndarray
    """Which points were seen and are no outliers."""


def draw(cell: Cell, trial: int) -> Draw:
    """Draw one trial, the same at every call and whatever else is run."""
    rng = np.random.default_rng([zlib.crc32(cell.title.encode()), trial])
    route = truth(cell.route, rng)
    station = _stations(cell, rng) * route.length
    points = route.place(station) + cell.noise * rng.standard_normal((cell.n, 3))
    stray = rng.choice(np.arange(1, cell.n - 1), round(cell.outliers * cell.n), replace=False)
    points[stray] += _OUTLIER * cell.noise * _directions(len(stray), rng)
    unseen = _unseen(cell, rng)
    points[unseen] = np.nan
    good = np.ones(cell.n, dtype=bool)
    good[stray], good[unseen] = False, False
    return Draw(route, points, station, good)


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


def _unseen(cell: Cell, rng: np.random.Generator) -> np.ndarray:
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
    )
