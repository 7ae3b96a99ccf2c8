"""How far measured and simulated lie apart: by phase, before and after, on fitted and on held-out runs.

Source: docs/model.md (112).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.core.constants import CHANCE
from tssgeom.errors import FitError
from tssgeom.identify.finding import PHASES, Misfit, Trace
from tssgeom.identify.fit import Point, Problem, posed
from tssgeom.identify.fit_quality import ROBUST
from tssgeom.identify.prediction import FINE, exact, stacked, total_sigma
from tssgeom.identify.readings import Reading
from tssgeom.identify.screening import leftover
from tssgeom.rig import Rig
from tssgeom.statistics import NORMAL_95, root_mean_square
from tssgeom.tendon.bars.model import Model, RunTrace, begin, carry_on, prepare


@dataclass(frozen=True, slots=True)
class MisfitSettings:
    """What counts as held.

    Frozen on the development seeds of `benchmarks.discovery`.
    """

    still: float = 0.05
    """Of the median step in motion: a slower drive is a hold [1]; chosen."""


MISFIT = MisfitSettings()
UNINFORMATIVE = math.sqrt(0.5)
"""Held-out misfit below which its ratio is no evidence [1]; derived: half of the noise variance."""


def phases(reading: Reading, slip_out: Vector) -> np.ndarray:
    """Return the phase of each sample, index into `PHASES` [n], by the drive and the last contact."""
    drive = reading.given[reading.drive]
    step = np.gradient(drive)
    moving = np.abs(step) > 2.0 * reading.noise[reading.drive]
    usual = float(np.median(np.abs(step[moving]))) if moving.any() else 0.0
    still = np.abs(step) <= MISFIT.still * usual
    pulling = step > 0.0
    out = np.where(
        pulling,
        np.where(slip_out > 0, PHASES.index("pull"), PHASES.index("release_to_pull")),
        np.where(slip_out < 0, PHASES.index("release"), PHASES.index("pull_to_release")),
    )
    return np.where(still, PHASES.index("hold"), out)


@dataclass(frozen=True, slots=True)
class HeldOut:
    """The runs that nothing was fitted to."""

    problem: Problem
    counted: np.ndarray
    """[rows] bool: readings that count."""
    noise: Mapping[str, float]
    """Rms of what the sensors explain, by channel [N, m]."""
    before: float
    """Misfit of the base model [1]."""

    def misfit(self, at: Point) -> float:
        """Return the misfit that a model leaves [1]; infinite where it finds no equilibrium."""
        try:
            left = self.problem.left(at)
        except FitError:
            return math.inf
        return beyond_noise(_rms(self.problem, left, self.counted), self.noise)

    def rise(self, before: Point, after: Point) -> float:
        """Return by how much a part on top of a model changes χ² [1]; docs/model.md (119).

        Infinite where it rises so far that the part is contradicted: a right part that moves the whitened
        readings by the length d changes χ² by -d² ± 2d. Whatever d is, a rise by more than 1.96² has a chance
        of 2.5 %.
        """
        first, second = self._chi2(before), self._chi2(after)
        if math.isinf(first):
            return 0.0
        most = NORMAL_95**2 * max(1.0, first / self.problem.stack.size)
        return math.inf if second - first > most else second - first

    def _chi2(self, at: Point) -> float:
        """Return the whitened squares that a model leaves, outliers by Huber's loss; infinite as `misfit`."""
        try:
            off = np.abs(self.problem.whitening.whitened(self.problem.left(at)))
        except FitError:
            return math.inf
        near = np.minimum(off, ROBUST.huber)
        return float(np.sum(near * (2.0 * off - near)))

    def explained(self, at: Point) -> bool:
        """Whether χ² is that of chance, or what a model leaves is not clearly beyond the detection limits."""
        beyond = self._chi2(at) / self.problem.stack.size - 1.0
        return (
            beyond < CHANCE.clear * math.sqrt(2.0 / self.problem.stack.size)
            or self.leftover(at) < CHANCE.clear
        )

    def leftover(self, at: Point) -> float:
        """Return what a model leaves of the worst channel over its limit [1]; infinite as `misfit`."""
        try:
            return leftover(self.problem, self.problem.left(at))
        except FitError:
            return math.inf

    def ratio(self, at: Point) -> float:
        """Return the misfit over that of the base model [1]; NaN where that shows none."""
        return self.misfit(at) / self.before if self.before > UNINFORMATIVE else math.nan


def held_out(runs: tuple[Reading, ...], rig: Rig, base: Point) -> HeldOut | None:
    """Prepare the runs that are held out; None where none is."""
    kept = [run for run in runs if run.held_out]
    if not kept:
        return None
    problem, errors = posed(stacked(kept), rig, base)
    sigma = total_sigma(errors)
    counted = _exact_rows(problem, sigma)
    noise = _rms(problem, sigma, counted)
    before = beyond_noise(_rms(problem, problem.left(base), counted), noise)
    return HeldOut(problem, counted, noise, before)


def _exact_rows(problem: Problem, sigma: Vector) -> np.ndarray:
    """Return which readings count, by run and channel [rows] bool."""
    out = np.zeros(len(sigma), dtype=bool)
    for block in problem.stack.blocks:
        out[block.rows] = exact(sigma[block.rows])
    return out


def _rms(problem: Problem, left: Vector, counted: np.ndarray) -> dict[str, float]:
    out = dict[str, list[Vector]]()
    for block in problem.stack.blocks:
        out.setdefault(block.channel, []).append(left[block.rows][counted[block.rows]])
    return {name: root_mean_square(np.concatenate(parts)) for name, parts in out.items()}


def beyond_noise(rms: Mapping[str, float], noise: Mapping[str, float]) -> float:
    """Return the misfit: root mean over channels of what is beyond the noise, in units of it; (112).

    NaN where no channel has noise.
    """
    squares = [max((rms[name] / noise[name]) ** 2 - 1.0, 0.0) for name in rms if noise.get(name, 0.0) > 0.0]
    return math.sqrt(sum(squares) / len(squares)) if squares else math.nan


def held_out_change(misfit: Misfit) -> tuple[float, float]:
    """Return the misfit of the runs that were held out, before and after [1]; NaN where there are none."""
    before, after = misfit.before.get("held_out", {}), misfit.after.get("held_out", {})
    return beyond_noise(before, misfit.noise), beyond_noise(after, misfit.noise)


@dataclass(frozen=True, slots=True)
class SimulatedRun:
    """A run as one model predicts it."""

    channels: Mapping[str, Vector]
    slip_out: Vector
    tension: Matrix
    """[n, nodes of the route] [N]; no rows where it was not asked for."""


def simulated_run(reading: Reading, rig: Rig, at: Point, *, profile: bool = False) -> SimulatedRun:
    """Return what a model makes of a run, with bars fine enough to be taken as exact."""
    model = prepare(
        reading.given, reading.route.arcs, at.rig(rig), at.effects, drive=reading.drive, bars=FINE
    )
    trace, _ = carry_on(model, begin(model), reading.given, profile=profile)
    tension = _on_nodes(model, trace, reading.route.s) if profile else np.zeros((0, len(reading.route.s)))
    return SimulatedRun({name: trace.channels[name] for name in reading.measured}, trace.slip_out, tension)


def _on_nodes(model: Model, trace: RunTrace, s: Vector) -> Matrix:
    """Return tension at the nodes of a route [n, nodes], between the middles of the bars."""
    middle = np.concatenate(([0.0], 0.5 * (model.edge[1:] + model.edge[:-1]), [1.0]))
    share = s / s[-1]
    right = np.clip(np.searchsorted(middle, share), 1, len(middle) - 1)
    weight = (share - middle[right - 1]) / (middle[right] - middle[right - 1])
    return trace.tension[:, right - 1] * (1.0 - weight) + trace.tension[:, right] * weight


def traces(readings: Sequence[Reading], rig: Rig, before: Point, after: Point) -> tuple[Trace, ...]:
    """Return every run with what the base model and the better one make of it."""
    _, errors = posed(stacked(readings), rig, after)
    sigma = stacked(readings).split(total_sigma(errors))
    return tuple(_trace(reading, rig, (before, after), sigma[k]) for k, reading in enumerate(readings))


def _trace(reading: Reading, rig: Rig, models: tuple[Point, Point], sigma: Mapping[str, Vector]) -> Trace:
    old, new = (simulated_run(reading, rig, at, profile=at is models[1]) for at in models)
    tension_in = new.channels.get("tension_in_N", reading.given.get("tension_in_N", new.tension[:, 0]))
    return Trace(
        run=reading.name,
        route=reading.route.name,
        held_out=reading.held_out,
        time=reading.time,
        phase=phases(reading, new.slip_out),
        tension_in=read_only(tension_in),
        measured=dict(reading.measured),
        before=dict(old.channels),
        after=dict(new.channels),
        sigma=dict(sigma),
        tension=read_only(new.tension),
    )


def misfits(runs: Sequence[Trace]) -> Misfit:
    """Return root mean squares of measured less simulated, by channel and phase."""
    fitted = [trace for trace in runs if not trace.held_out]
    held = [trace for trace in runs if trace.held_out]
    displayed = held or fitted
    return Misfit(
        noise={name: _trace_rms(runs, name, "sigma") for name in _channels(runs)},
        before={"fitted": _left(fitted, "before"), "held_out": _left(held, "before")},
        after={"fitted": _left(fitted, "after"), "held_out": _left(held, "after")},
        by_phase={name: _by_phase(displayed, name) for name in _channels(displayed)},
    )


def _channels(runs: Sequence[Trace]) -> list[str]:
    return list(dict.fromkeys(name for trace in runs for name in trace.measured))


def _left(runs: Sequence[Trace], which: str) -> dict[str, float]:
    return {name: _trace_rms(runs, name, which) for name in _channels(runs)}


def _parts(runs: Sequence[Trace], name: str, which: str) -> list[Vector]:
    parts = []
    for trace in runs:
        if name in trace.measured:
            value = getattr(trace, which)[name]
            left = value if which == "sigma" else trace.measured[name] - value
            parts.append(np.where(exact(trace.sigma[name]), left, np.nan))
    return parts


def _trace_rms(runs: Sequence[Trace], name: str, which: str) -> float:
    return float(np.sqrt(np.nanmean(np.square(np.concatenate(_parts(runs, name, which))))))


def _by_phase(runs: Sequence[Trace], name: str) -> dict[str, tuple[float, float]]:
    phase = np.concatenate([trace.phase for trace in runs if name in trace.measured])
    both = [np.square(np.concatenate(_parts(runs, name, which))) for which in ("before", "after")]
    out = {}
    for k, title in enumerate(PHASES):
        inside = (phase == k) & np.isfinite(both[0])
        if inside.any():
            out[title] = tuple(float(np.sqrt(np.mean(part[inside]))) for part in both)
    return out
