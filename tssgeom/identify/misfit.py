"""How far measured and simulated lie apart: by phase, before and after, on fitted and on held-out runs.

Source: docs/model.md (112).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import ndtri

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.channel_names import unit_of, words_of
from tssgeom.core.constants import CHANCE
from tssgeom.errors import FitError
from tssgeom.identify.finding import PHASES, Misfit, Trace
from tssgeom.identify.fit import Point, Problem, Whitening, posed, whitening
from tssgeom.identify.fit_quality import inflation_of
from tssgeom.identify.prediction import FINE, Errors, errors_of, exact, stacked, total_sigma
from tssgeom.identify.readings import Reading
from tssgeom.identify.screening import leftover
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.rig import Rig
from tssgeom.statistics import NORMAL_95, root_mean_square
from tssgeom.tendon.bars.model import Model, RunTrace, begin, carry_on, prepare

_CHANCE = 0.025  # of a right part to be contradicted by any channel; derived: that of 1.96 s.d.
UNINFORMATIVE = math.sqrt(0.5)
"""Held-out misfit below which its ratio is no evidence [1]; derived: half of the noise variance."""


def phases(reading: Reading, slip_out: Vector) -> np.ndarray:
    """Return the phase of each sample, index into `PHASES` [n], by the drive and the last contact."""
    drive = reading.given[reading.drive]
    step = np.gradient(drive)
    moving = np.abs(step) > 2.0 * reading.noise[reading.drive]
    usual = float(np.median(np.abs(step[moving]))) if moving.any() else 0.0
    still = np.abs(step) <= PLAUSIBLE.slight * usual
    pulling = step > 0.0
    out = np.where(
        pulling,
        np.where(slip_out > 0, PHASES.index("pull"), PHASES.index("release_to_pull")),
        np.where(slip_out < 0, PHASES.index("release"), PHASES.index("pull_to_release")),
    )
    return np.where(still, PHASES.index("hold"), out)


@dataclass(frozen=True, slots=True)
class HeldOutChange:
    """What a part changes on the runs that nothing was fitted to."""

    rise: float
    """Of χ² [1]; infinite where these runs contradict the part."""
    worse: str = ""
    """Why, in a clause; empty where they do not."""


NO_CHANGE = HeldOutChange(0.0)


@dataclass(frozen=True, slots=True)
class HeldOut:
    """The runs that nothing was fitted to."""

    problem: Problem
    channels: Mapping[str, tuple[np.ndarray, Whitening]]
    """By channel: its rows, and what makes it independent where no other channel is known."""
    counted: np.ndarray
    """[rows] bool: readings that count."""
    noise: Mapping[str, float]
    """Rms of what the sensors explain, by channel [N, m]."""
    before: float
    """Misfit of the base model [1]."""
    simulated: dict[Point, Vector | None] = field(default_factory=dict, repr=False)
    """What models leave [rows] [N, m], by model: most are asked for more than once."""

    def misfit(self, at: Point) -> float:
        """Return the misfit that a model leaves [1]; infinite where it finds no equilibrium."""
        left = self._left(at)
        return math.inf if left is None else beyond_noise(_rms(self.problem, left, self.counted), self.noise)

    def change(self, base: Point, before: Point, after: Point) -> HeldOutChange:
        """Return what a part on top of a model changes; the base model may not be better either.

        A right part that moves whitened readings by the length d changes their χ² by -d² ± 2d, of all
        channels and of each by itself. Whatever d is, a rise by more than z² has the chance that is beyond z.
        Source: docs/model.md (119), (244), (245).
        """
        made = self._change(before, after)
        if not before.effects or math.isinf(made.rise):
            return made
        whole = self._change(base, after)
        return whole if math.isinf(whole.rise) else made

    def _change(self, before: Point, after: Point) -> HeldOutChange:
        old, new = self._left(before), self._left(after)
        if old is None:
            return NO_CHANGE
        if new is None:
            return HeldOutChange(math.inf, "the held-out runs have no equilibrium with it")
        for name, (rows, own) in self.channels.items():
            chance = _CHANCE / len(self.channels)
            if _is_worse(own.whitened(old[rows]), own.whitened(new[rows]), len(rows), chance):
                sizes = [root_mean_square(left[rows][self.counted[rows]]) for left in (old, new)]
                return HeldOutChange(math.inf, _worse(name, sizes))
        first, second = (_huber(self.problem.whitening.whitened(left)) for left in (old, new))
        if second - first > NORMAL_95**2 * max(1.0, first / self.problem.stack.size):
            return HeldOutChange(math.inf, "the held-out runs contradict it")
        return HeldOutChange(second - first)

    def rise(self, before: Point, after: Point) -> float:
        """Return by how much a part on top of a model changes χ² [1]; infinite where it is contradicted."""
        return self._change(before, after).rise

    def _left(self, at: Point) -> Vector | None:
        """Return measured less simulated [rows] [N, m]; None where a model finds no equilibrium."""
        if at not in self.simulated:
            try:
                self.simulated[at] = self.problem.left(at)
            except FitError:
                self.simulated[at] = None
        return self.simulated[at]

    def chi2(self, at: Point) -> float:
        """Return the whitened squares that a model leaves, outliers by Huber's loss; infinite as `misfit`."""
        left = self._left(at)
        return math.inf if left is None else _huber(self.problem.whitening.whitened(left))

    def explained(self, at: Point) -> bool:
        """Whether χ² is that of chance, or what a model leaves is not clearly beyond the detection limits."""
        beyond = self.chi2(at) / self.problem.stack.size - 1.0
        return (
            beyond < CHANCE.clear * math.sqrt(2.0 / self.problem.stack.size)
            or self.leftover(at) < CHANCE.clear
        )

    def leftover(self, at: Point) -> float:
        """Return what a model leaves of the worst channel over its limit [1]; infinite as `misfit`."""
        left = self._left(at)
        return math.inf if left is None else leftover(self.problem, left)

    def ratio(self, at: Point) -> float:
        """Return the misfit over that of the base model [1]; NaN where that shows none."""
        return self.misfit(at) / self.before if self.before > UNINFORMATIVE else math.nan


def _huber(whitened: Vector) -> float:
    """Return the sum of squares, outliers by Huber's loss."""
    off = np.abs(whitened)
    near = np.minimum(off, CHANCE.clear)
    return float(np.sum(near * (2.0 * off - near)))


def _is_worse(before: Vector, after: Vector, count: int, chance: float) -> bool:
    """Whether a channel is predicted worse beyond chance, by its whitened rest of so many readings; (245)."""
    first, second = _huber(before), _huber(after)
    variance = inflation_of(before[:count]) * first / count
    return second - first > float(ndtri(chance)) ** 2 * max(1.0, variance)


def _worse(channel: str, rms: Sequence[float]) -> str:
    """Say what contradicts a part: how much worse a channel is predicted, or that its rest is no noise."""
    unit = unit_of(channel)
    what = f"{words_of(channel)} of the held-out runs"
    if rms[1] <= rms[0]:
        return f"what it leaves of {what} is no error of that sensor"
    first, second = (f"{1e3 * each:.3g} mm" if unit == "m" else f"{each:.3g} {unit}" for each in rms)
    return f"{what} is predicted worse with it, within {second} rms instead of {first}"


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
    return HeldOut(problem, dict(_by_channel(problem, errors)), counted, noise, before)


def _by_channel(problem: Problem, errors: Errors) -> Iterator[tuple[str, tuple[np.ndarray, Whitening]]]:
    """Yield each channel with its rows and its own whitening; docs/model.md (244)."""
    for name in dict.fromkeys(block.channel for block in problem.stack.blocks):
        rows = np.concatenate([np.r_[each.rows] for each in problem.stack.blocks if each.channel == name])
        yield name, (rows, whitening(replace(errors, sigma=errors.sigma[rows], modes=errors.modes[rows])))


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


def shows_held_out_alone(misfit: Misfit) -> bool:
    """Whether the fitted runs leave no more than the noise where those held out leave clearly more."""
    fitted, held = (
        beyond_noise(misfit.after.get(group, {}), misfit.noise) for group in ("fitted", "held_out")
    )
    return fitted <= UNINFORMATIVE and held > CHANCE.clear


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
    stack = stacked(readings)
    sigma = stack.split(total_sigma(errors_of(stack, after.rig(rig), after.effects)))
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
        noise={name: _trace_rms(runs, name, "sigma") for name in measured_channels(runs)},
        before={"fitted": _left(fitted, "before"), "held_out": _left(held, "before")},
        after={"fitted": _left(fitted, "after"), "held_out": _left(held, "after")},
        by_phase={name: _by_phase(displayed, name) for name in measured_channels(displayed)},
    )


def measured_channels(runs: Sequence[Trace]) -> list[str]:
    """Return every channel that a run measured, each once."""
    return list(dict.fromkeys(name for trace in runs for name in trace.measured))


def _left(runs: Sequence[Trace], which: str) -> dict[str, float]:
    return {name: _trace_rms(runs, name, which) for name in measured_channels(runs)}


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
