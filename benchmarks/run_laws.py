"""Laws of one drive with hysteresis, as columns to combine linearly at given nonlinear parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Literal, NamedTuple

import numpy as np

from benchmarks.hysteresis import bouc_wen, dead_zone, play, stop
from benchmarks.run_cases import Mask, Response
from tssgeom.arrays import Matrix, Vector

_SEED = 20181
_PLAYS = 6
_LAG = 0.3  # s either way


@dataclass(frozen=True, slots=True)
class Data:
    """Drive and response of a case; the drive in units of its half range, n rows."""

    drive: Vector
    time: Vector
    runs: tuple[slice, ...]
    others: Matrix
    """[n, m] Other given channels that vary, each from -1 to 1."""
    fitted: Mask
    resists: bool
    zeroed: bool

    def each(self, operator: Callable[[Vector], Vector], drive: Vector | None = None) -> Vector:
        """Apply an operator to every run by itself."""
        values = self.drive if drive is None else drive
        return np.concatenate([operator(values[rows]) for rows in self.runs])

    def offset(self) -> list[Vector]:
        """Return the column of a free offset, unless zero is known."""
        return [] if self.zeroed else [np.ones(len(self.drive))]

    def later(self, lag: float) -> Vector:
        """Return the drive as it is `lag` after each row [s]."""
        return np.concatenate([np.interp(self.time[k] + lag, self.time[k], self.drive[k]) for k in self.runs])


Columns = Callable[[Data, Vector], list[Vector]]
Kind = Literal["drive", "response", "gain", "time", "number"]


class Nonlinear(NamedTuple):
    """A nonlinear parameter and its bounds, lengths in half ranges of the drive."""

    name: str
    low: float
    high: float
    kind: Kind = "drive"


class Law(NamedTuple):
    """A law: columns to combine linearly, given its nonlinear parameters."""

    columns: Columns
    gains: tuple[str, ...]
    """Names of the first columns' factors, response over drive; the other factors are nuisances."""
    nonlinear: tuple[Nonlinear, ...] = ()
    starts: tuple[tuple[float, ...], ...] = ((),)
    one_sign: bool = False
    """Whether the gains must have one sign in common."""
    slides: bool = False
    """Whether gain times the first nonlinear parameter is the force at which it slides."""
    needs: Callable[[Response], bool] = lambda _: True


def _gain(data: Data, _: Vector) -> list[Vector]:
    return [data.drive, *data.offset(), *data.others.T]


def _play(data: Data, theta: Vector) -> list[Vector]:
    operator = stop if data.resists else play
    return [data.each(partial(operator, half_width=theta[0])), *data.offset(), *data.others.T]


def _play_later(data: Data, theta: Vector) -> list[Vector]:
    moved = data.later(theta[1])
    return [data.each(partial(play, half_width=theta[0]), moved), *data.offset(), *data.others.T]


def _capstan(data: Data, theta: Vector) -> list[Vector]:
    """Scale all by exp(α d), where d runs from -1 (released) to 1 (pulled) over the play."""
    width, exponent = theta
    lagging = data.each(partial(play, half_width=width))
    factor = np.exp(exponent * (data.drive - lagging) / width)
    scaled = [lagging, *data.others.T]
    return [*(factor * each for each in scaled), factor - 1.0, *data.offset()]


def _prandtl(data: Data, _: Vector) -> list[Vector]:
    widths = 2.0 ** -np.arange(_PLAYS)
    if not data.resists:
        widths = np.append(widths[1:], 0.0)
    operator = stop if data.resists else play
    parts = [data.each(partial(operator, half_width=width)) for width in widths]
    return [*parts, *data.offset(), *data.others.T]


def _bouc_wen(data: Data, theta: Vector) -> list[Vector]:
    yield_at, share, power = theta
    state = data.each(partial(bouc_wen, yield_at=yield_at, share=share, power=power))
    return [data.drive, state, *data.offset(), *data.others.T]


def _stop_alone(data: Data, theta: Vector) -> list[Vector]:
    return [data.each(partial(stop, half_width=theta[0]))]


def _stop_backlash(data: Data, theta: Vector) -> list[Vector]:
    """Put clearance before the spring; its end slides where it is compressed by `theta[0]`."""
    clearance = theta[1]
    return [dead_zone(data.each(partial(stop, half_width=theta[0] + clearance)), clearance)]


def _bouc_wen_starts() -> tuple[tuple[float, ...], ...]:
    rng = np.random.default_rng(_SEED)
    return tuple((math.exp(rng.uniform(-4.0, 0.0)), 0.5, math.exp(rng.uniform(-0.5, 0.7))) for _ in range(8))


def _grid(*values: Sequence[float]) -> tuple[tuple[float, ...], ...]:
    return tuple(product(*values))


def _without_offset(response: Response) -> bool:
    return response.resists and response.zeroed


def _lags(response: Response) -> bool:
    return response.column == "bending_angle_rad"


_WIDTHS = tuple(float(width) for width in np.geomspace(0.003, 0.7, 9))
_WIDTH = Nonlinear("w", 1e-4, 1.0)
LAWS: dict[str, Law] = {
    "gain only": Law(_gain, ("gain",)),
    "play": Law(_play, ("gain",), (_WIDTH,), _grid(_WIDTHS)),
    "play, later": Law(
        _play_later,
        ("gain",),
        (_WIDTH, Nonlinear("lag", -_LAG, _LAG, "time")),
        _grid(_WIDTHS, (-0.2, 0.0, 0.2)),
        needs=_lags,
    ),
    "play + capstan": Law(
        _capstan,
        ("gain",),
        (Nonlinear("w", 1e-3, 1.0), Nonlinear("exponent", -3.0, 3.0, "number")),
        _grid(_WIDTHS, (-0.4, 0.4)),
    ),
    "Prandtl–Ishlinskii": Law(_prandtl, tuple(f"p{k}" for k in range(1, _PLAYS + 1)), one_sign=True),
    "Bouc–Wen": Law(
        _bouc_wen,
        ("gain",),
        (
            Nonlinear("yield", 1e-3, 3.0),
            Nonlinear("share", 0.0, 1.0, "number"),
            Nonlinear("n", 0.3, 8.0, "number"),
        ),
        _bouc_wen_starts(),
    ),
    "stop": Law(_stop_alone, ("stiffness",), (_WIDTH,), _grid(_WIDTHS), slides=True, needs=_without_offset),
    "stop + backlash": Law(
        _stop_backlash,
        ("stiffness",),
        (_WIDTH, Nonlinear("clearance", 0.0, 0.5)),
        _grid(_WIDTHS, (0.01, 0.05, 0.1)),
        slides=True,
        needs=_without_offset,
    ),
}
