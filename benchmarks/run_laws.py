"""What a measured set gives to a fit, and the laws of hysteresis that a user would fit to it instead.

A law gives columns to combine linearly at given nonlinear parameters; rate has no part in any operator.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tssgeom.arrays import Matrix, Vector

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"

Mask = NDArray[np.bool_]


Kind = Literal["drive", "response", "gain", "time", "number"]


@dataclass(frozen=True, slots=True)
class Response:
    """One channel that is predicted from the channels that are given."""

    column: str
    drive: str
    """The channel that moves it, with hysteresis."""
    others: tuple[str, ...] = ()
    """Channels that are given beside the drive; a peer takes them linearly."""
    resists: bool = False
    """Whether it is a force that changes sign with the drive's direction (a stop), not a motion (a play)."""
    zeroed: bool = False
    """Whether drive and response count from the first row of each run, so that no offset is to be fitted."""


@dataclass(frozen=True, slots=True)
class Case:
    """One or several runs of one rig.

    Rows of a run follow each other in time. Those that are neither fitted nor held out belong to a run-up
    that only sets the state.
    """

    source: str
    """Name of the set."""
    name: str
    columns: Mapping[str, Vector]
    """[n] each, SI; the unit ends the name."""
    run: NDArray[np.int_]
    """[n] Number of the run of each row, from 0 and rising."""
    fitted: Mask
    """[n]"""
    held_out: Mask
    """[n]"""
    responses: tuple[Response, ...]
    known: Mapping[str, float] = field(default_factory=dict[str, float])
    """What is known of the rig, SI; the unit ends the name."""
    period: float | None = None
    """Of the drive [s], where fitted and held-out cycles repeat each other."""

    def runs(self) -> Iterator[slice]:
        """Yield the rows of each run."""
        ends = np.flatnonzero(np.diff(self.run)) + 1
        for start, end in zip((0, *ends), (*ends, len(self.run)), strict=True):
            yield slice(int(start), int(end))


def mean_cycle_error(case: Case, column: str) -> float:
    """Return the rms difference of held-out rows from the mean of the fitted cycles at the same phase.

    It is the error of a method that repeats the fitted cycle: no fit to the drive alone does much better.
    NaN where a held-out row has no fitted cycle before it.
    """
    if case.period is None:
        return np.nan
    errors = list[Vector]()
    for rows in case.runs():
        time, values = case.columns["time_s"][rows], case.columns[column][rows]
        fitted, held_out = case.fitted[rows], case.held_out[rows]
        if not (fitted.any() and held_out.any()):
            return np.nan
        low, high = time[fitted][[0, -1]]
        near = 0.5 * (time[1] - time[0])
        backs = np.arange(1, int((time[-1] - low) / case.period) + 2)
        at = time[held_out][:, None] - backs * case.period
        inside = (at >= low - near) & (at <= high + near)
        known = np.where(inside, np.interp(at, time, values), 0.0).sum(axis=1) / inside.sum(axis=1)
        errors.append(values[held_out] - known)
    return float(np.sqrt(np.mean(np.square(np.concatenate(errors)))))


class Estimate(NamedTuple):
    """A parameter in SI, and the half width of its 95 % interval (NaN: at a bound)."""

    name: str
    kind: Kind
    """What it is a quantity of; a gain is response over drive."""
    value: float
    half_width: float


@dataclass(frozen=True, slots=True)
class Prediction:
    """A response as a method predicts it, and the method's parameters."""

    values: Vector
    """[n] SI."""
    parameters: tuple[Estimate, ...] = field(default=())


_STEP = 0.2  # of the yield displacement; a longer change of the drive is cut up


def play(drive: Vector, half_width: float) -> Vector:
    """Return what lags the drive by at most `half_width`; it starts at the drive's first value."""
    lagging = np.empty_like(drive)
    state = float(drive[0])
    for i, value in enumerate(drive.tolist()):
        state = min(max(state, value - half_width), value + half_width)
        lagging[i] = state
    return lagging


def stop(drive: Vector, half_width: float) -> Vector:
    """Return the drive less its play: an elastic body that slides at `half_width`."""
    return drive - play(drive, half_width)


def dead_zone(values: Vector, half_width: float) -> Vector:
    """Return what exceeds the clearance on either side."""
    return values - np.clip(values, -half_width, half_width)


def bouc_wen(drive: Vector, yield_at: float, share: float, power: float) -> Vector:
    """Return the hysteretic variable z, from -1 to 1, of a drive u.

    dz = (1 - |z|^n (share sgn(z du) + 1 - share)) du / yield_at, where `share` is β/(β + γ) of the usual
    notation and n is `power`.
    """
    states = np.empty_like(drive)
    state = 0.0
    changes = (np.diff(drive, prepend=drive[0]) / yield_at).tolist()
    for i, change in enumerate(changes):
        count = math.ceil(abs(change) / _STEP)
        part = change / max(count, 1)
        for _ in range(min(count, 100)):
            against = share if state * part > 0.0 else -share
            state += part * (1.0 - abs(state) ** power * (against + 1.0 - share))
            state = min(max(state, -1.0), 1.0)
        states[i] = state
    return states


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
