"""Calibration of any machine from any runs: Gauss-Newton on the model, with what was assumed as data.

Every number is counted in standard deviations of its prior. What the data do not narrow is said. Source:
docs/model.md (179)-(183).
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.stats import t as student

from tssgeom.arrays import Matrix, Vector
from tssgeom.errors import FitError, SettingsError
from tssgeom.identify.fit_quality import ChannelFit, failures, inflation_of, spread, whiteness
from tssgeom.identify.machine_run import MachineRun, Parameter, parameters_of, predicted, routed, thinned
from tssgeom.rig import Rig, with_values
from tssgeom.statistics import reading_noise
from tssgeom.uncertain import Uncertain


@dataclass(frozen=True, slots=True)
class MachineFitSettings:
    """How a machine is fitted. All are chosen."""

    bars: int = 6
    """Bars of each tendon while fitting; chosen: more are brought in by `fine`."""
    fine: int = 40
    """Bars of each tendon, to whose answer that of few bars is brought [1]; chosen."""
    most_of_all: int = 1200
    """Samples of all runs together; more are thinned, to no less than `least_of_each`; chosen."""
    least_of_each: int = 120
    """Samples of each run; chosen."""
    rounds: int = 2
    """Rounds in which weights and estimates converge; chosen."""
    iterations: int = 12
    """Steps of a round; chosen."""
    step: float = 2e-4
    """Of a prior's standard deviation: step of derivatives [1]; chosen: small and to one side for all, lest
    curvature seems to part what shows only as a product."""
    first_sigma: float = 0.02
    """Of the range of a channel: its standard deviation in the first round [1]; chosen."""
    close: float = 0.01
    """Fall of -ln of the posterior that ends a round [1]; chosen: a seventh of a standard deviation."""
    huber: float = 3.0
    """Standard deviations from which a residual counts less [1]; chosen, as `ROBUST.huber`."""
    unobserved: float = 0.5
    """Of the prior's standard deviation: a wider posterior means that the runs show nothing [1]; chosen."""
    tied: float = 0.35
    """Of the prior's: two numbers whose product is narrower, while neither is, are tied [1]; chosen."""
    most_at_start: int = 200
    """Samples of all runs together while the start is chosen, `least_at_start` each at least; chosen."""
    least_at_start: int = 50
    """Samples of each run while the start is chosen; chosen: a dozen a cycle."""
    starts: int = 3
    """Starts, the best of 27, from which short fits are made [1]; chosen."""
    start_steps: int = 4
    """Steps from each start before the best one is kept; chosen."""
    farthest: float = 4.0
    """Standard deviations of the prior that a number may go [1]; chosen: one in 16 000."""


FIT = MachineFitSettings()
_STARTS = tuple(itertools.product((0.0, -1.0, 1.0), repeat=3))


@dataclass(frozen=True, slots=True)
class MachineEstimate:
    """One number with its 95 % interval."""

    name: str
    unit: str
    value: float
    low: float
    high: float
    identified: bool
    """False: the runs do not narrow what was assumed of it."""
    assumed: tuple[float, float]
    """95 % interval that was assumed."""
    key: str = ""
    """Where it stands in the rig; empty for a number of one run."""


@dataclass(frozen=True, slots=True)
class MachineCalibration:
    """What runs say of a machine."""

    estimates: tuple[MachineEstimate, ...]
    friction_angle: MachineEstimate
    """μΦ of the first route, what friction takes from a tendon that slides all along [1]."""
    tied: tuple[str, ...]
    """What is known only together, a sentence each."""
    channels: tuple[ChannelFit, ...]
    held_out: Mapping[str, tuple[float, float]]
    """By channel: rms on samples that were held out, and on those that were fitted without them."""
    rig: Rig
    """The rig with what the runs identify, and of the rest what was assumed."""
    runs: tuple[MachineRun, ...]
    fitted: tuple[Mapping[str, Vector], ...]
    """What the model gives in each channel of each run."""
    warnings: tuple[str, ...]

    @property
    def failures(self) -> tuple[str, ...]:
        """Why the estimates are not to be used, a sentence each; none where the fit passes its test."""
        friction = next(each for each in self.estimates if each.key == "friction.coefficient")
        known = friction.value if friction.identified else None
        everything = {f"{k}": v for k, run in enumerate(self.fitted) for v in run.values()}
        return tuple(failures(known, self.channels, (), everything))


@dataclass(frozen=True, slots=True)
class _Problem:
    runs: tuple[MachineRun, ...]
    rig: Rig
    parameters: tuple[Parameter, ...]
    rows: tuple[tuple[int, str, np.ndarray], ...]
    """Run, channel, and the samples of it that are fitted."""
    bars: int
    too_few_bars: tuple[Mapping[str, Vector], ...] = ()
    """What more bars would add to the channels of each run; nothing where empty."""

    def corrected(self, u: Vector, channels: Sequence[Mapping[str, Vector]]) -> _Problem:
        """Return the problem with what more bars than its own would add at these numbers."""
        fine = replace(self, bars=FIT.fine).model(u)
        if fine is None:
            return self
        added = [
            {name: each[name] - few[name] for name in each} for each, few in zip(fine, channels, strict=True)
        ]
        return replace(self, too_few_bars=tuple(added))

    def answers(self, channels: Sequence[Mapping[str, Vector]]) -> list[Mapping[str, Vector]]:
        """Return the channels of each run with what more bars would add."""
        if not self.too_few_bars:
            return list(channels)
        pairs = zip(channels, self.too_few_bars, strict=True)
        return [{name: values + added[name] for name, values in few.items()} for few, added in pairs]

    def measured(self) -> list[Vector]:
        return [self.runs[k].measured[channel][at] for k, channel, at in self.rows]

    def model(self, u: Vector, only: int | None = None) -> list[Mapping[str, Vector]] | None:
        """Return the channels of each run, or of one; None where the machine has no equilibrium."""
        try:
            values = {
                each.key: each.value(x) for each, x in zip(self.parameters, u, strict=True) if each.run < 0
            }
            rig = with_values(self.rig, values)
            which = range(len(self.runs)) if only is None else [only]
            return [predicted(self.runs[k], rig, self.of_run(u, k), self.bars) for k in which]
        except (FitError, SettingsError, FloatingPointError):
            return None

    def of_run(self, u: Vector, k: int) -> dict[tuple[str, str], float]:
        pairs = zip(self.parameters, u, strict=True)
        return {(each.kind, each.key): each.value(x) for each, x in pairs if each.run == k}

    def left(self, channels: Sequence[Mapping[str, Vector]]) -> list[Vector]:
        """Return measured less simulated of each block of rows."""
        given = self.answers(channels)
        return [self.runs[k].measured[name][at] - given[k][name][at] for k, name, at in self.rows]

    def jacobian(self, u: Vector, channels: Sequence[Mapping[str, Vector]], left: Sequence[Vector]) -> Matrix:
        """Return derivatives of what is left by every number [rows, parameters]."""
        edges = np.cumsum([0, *(len(each) for each in left)])
        out = np.zeros((edges[-1], len(u)))
        for j, parameter in enumerate(self.parameters):
            if parameter.kind == "zero":
                for b, (k, name, _) in enumerate(self.rows):
                    if (k, name) == (parameter.run, parameter.key):
                        out[edges[b] : edges[b + 1], j] = -parameter.prior.sd
        simulated = [j for j, each in enumerate(self.parameters) if each.kind != "zero"]
        with ThreadPoolExecutor(min(len(simulated), os.cpu_count() or 1)) as pool:
            for j, there in zip(simulated, pool.map(partial(self._beside, u), simulated), strict=True):
                step, moved, only = there
                for b, (k, name, at) in enumerate(self.rows):
                    if moved is not None and (only < 0 or k == only):
                        other = moved[k if only < 0 else 0]
                        out[edges[b] : edges[b + 1], j] = (channels[k][name][at] - other[name][at]) / step
        return out

    def _beside(self, u: Vector, j: int) -> tuple[float, list[Mapping[str, Vector]] | None, int]:
        """Return a step of one number, the channels after it, and the run that it belongs to, or −1."""
        only, step = self.parameters[j].run, FIT.step
        for way in (step, -step):
            moved = u.copy()
            moved[j] += way
            channels = self.model(moved, None if only < 0 else only)
            if channels is not None:
                return way, channels, only
        return step, None, only


@dataclass(slots=True)
class _State:
    u: Vector
    channels: list[Mapping[str, Vector]]
    left: list[Vector]
    weight: list[Vector]
    inflation: Vector
    objective: float


def calibrate_machine(
    runs: Sequence[MachineRun],
    rig: Rig,
    uncertain: Sequence[Uncertain] = (),
    *,
    progress: Callable[[str, float], object] = lambda step, share: None,
) -> MachineCalibration:
    """Fit what is not certain of a machine to runs of it.

    Parameters
    ----------
    runs
        Runs of the same machine, each on its routes.
    rig
        The machine, with the centre of what is assumed where a number is not certain.
    uncertain
        What is not certain of the rig; friction and compliance never are.
    progress
        Called with each step and the share of the work that is done [1].

    Raises
    ------
    FitError
        Where the model has no equilibrium at what is assumed.
    """
    each = max(FIT.least_of_each, FIT.most_of_all // len(runs))
    runs = [thinned(run, each) for run in runs]
    parameters = tuple(parameters_of(runs, rig, uncertain))
    fitted_rows = _rows(runs, held_out=False)
    problem = _Problem(tuple(runs), rig, parameters, fitted_rows, FIT.bars)
    progress("start", 0.0)
    start = _start(problem)
    problem, state = _fit(
        problem, start, lambda share: progress("fit without the last cycles", 0.1 + 0.6 * share)
    )
    held = {}
    if any(run.held_out.any() for run in runs):
        held = _held_out(problem, state)
        progress("fit of all cycles", 0.7)
        problem, state = _again(replace(problem, rows=_rows(runs, held_out=None)), state)
    return _calibration(problem, state, held)


def _rows(runs: Sequence[MachineRun], held_out: bool | None) -> tuple[tuple[int, str, np.ndarray], ...]:
    """Return run, channel and samples of each block; held-out ones where asked for, all where None."""
    out = []
    for k, run in enumerate(runs):
        for name, values in run.measured.items():
            wanted = np.isfinite(values)
            if held_out is not None:
                wanted &= run.held_out == held_out
            out.append((k, name, np.flatnonzero(wanted)))
    return tuple((k, name, at) for k, name, at in out if len(at))


def _start(problem: _Problem) -> Vector:
    """Return where the fit starts: the best of a few corners of what is assumed, after a short fit each."""
    free = [j for j, each in enumerate(problem.parameters) if each.kind == "rig" and each.prior.sd > 0.25]
    few = max(FIT.least_at_start, FIT.most_at_start // len(problem.runs))
    runs = tuple(thinned(run, few) for run in problem.runs)
    rows = _rows(runs, held_out=None)
    short = _Problem(runs, problem.rig, problem.parameters, rows, FIT.bars)
    weight = _first_weights(short)
    starts = list[tuple[float, Vector]]()
    for corner in _STARTS if free else _STARTS[:1]:
        u = np.zeros(len(problem.parameters))
        u[free] = [corner[j % 3] for j in range(len(free))]
        channels = short.model(u)
        if channels is not None:
            starts.append((_objective(short.left(channels), weight, u), u))
    if not starts:
        raise FitError("the machine has no equilibrium at what the rig says of it: check units and radii")
    nearest = sorted(starts, key=lambda start: start[0])[: FIT.starts]
    inflation = np.ones(len(rows))
    states = [_round(short, u, weight, inflation, FIT.start_steps) for _, u in nearest]
    return min(states, key=lambda state: state.objective).u


def _first_weights(problem: _Problem) -> list[Vector]:
    return [
        np.full(len(values), 1.0 / max(FIT.first_sigma * float(np.ptp(values)), 1e-9))
        for values in problem.measured()
    ]


def _fit(problem: _Problem, start: Vector, progress: Callable[[float], object]) -> tuple[_Problem, _State]:
    """Fit, weigh each channel by what is left and by how long its errors last, and fit again."""
    weight, inflation = _first_weights(problem), np.ones(len(problem.rows))
    state = _round(problem, start, weight, inflation, FIT.iterations)
    for k in range(FIT.rounds):
        progress((k + 1) / (FIT.rounds + 1))
        problem, state = _again(problem, state)
    return problem, state


def _again(problem: _Problem, state: _State) -> tuple[_Problem, _State]:
    """Fit once more, with more bars and with the weights that follow from what is left."""
    problem = problem.corrected(state.u, state.channels)
    weight, inflation = _weights(problem.left(state.channels))
    return problem, _round(problem, state.u, weight, inflation, FIT.iterations)


def _weights(left: Sequence[Vector]) -> tuple[list[Vector], Vector]:
    """Return the weight of every row, and how many readings are worth one; docs/model.md (72), (181)."""
    weights, inflations = [], []
    for each in left:
        sigma = spread(each)
        inflation = inflation_of(each / sigma)
        far = np.maximum(np.abs(each) / sigma, 1e-12)
        weights.append(np.sqrt(np.minimum(1.0, FIT.huber / far) / inflation) / sigma)
        inflations.append(inflation)
    return weights, np.array(inflations)


def _round(problem: _Problem, start: Vector, weight: list[Vector], inflation: Vector, steps: int) -> _State:
    """Take Levenberg-Marquardt steps until the squared error stands."""
    u, damping = start.copy(), 1e-3
    channels = problem.model(u)
    if channels is None:
        raise FitError("the machine has no equilibrium at the start of the fit")
    left = problem.left(channels)
    objective = _objective(left, weight, u)
    for _ in range(steps):
        slope = problem.jacobian(u, channels, left) * np.concatenate(weight)[:, None]
        pull = slope.T @ (np.concatenate(weight) * np.concatenate(left)) + u
        normal = slope.T @ slope + np.eye(len(u))
        fall = 0.0
        for _ in range(8):
            step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), pull)
            tried = np.clip(u + step, -FIT.farthest, FIT.farthest)
            there = problem.model(tried)
            value = math.inf if there is None else _objective(problem.left(there), weight, tried)
            if there is not None and value < objective:
                fall, damping = objective - value, 0.2 * damping
                u, channels, left, objective = tried, there, problem.left(there), value
                break
            damping = max(4.0 * damping, 1e-3)
        if fall <= FIT.close * max(1.0, 0.01 * objective):
            break
    return _State(u, channels, left, weight, inflation, objective)


def _objective(left: Sequence[Vector], weight: Sequence[Vector], u: Vector) -> float:
    return 0.5 * sum(float(np.sum((w * r) ** 2)) for w, r in zip(weight, left, strict=True)) + 0.5 * float(
        u @ u
    )


def _held_out(problem: _Problem, state: _State) -> dict[str, tuple[float, float]]:
    """Return by channel the rms on what was held out, and on what was fitted."""
    away, given = _rows(problem.runs, held_out=True), problem.answers(state.channels)
    squares: dict[str, list[list[Vector]]] = {}
    for side, rows in enumerate((away, problem.rows)):
        for k, name, at in rows:
            off = problem.runs[k].measured[name][at] - given[k][name][at]
            squares.setdefault(name, [[], []])[side].append(off**2)
    rms = {
        name: tuple(float(np.sqrt(np.mean(np.concatenate(side)))) if side else math.nan for side in sides)
        for name, sides in squares.items()
    }
    return {name: (away, fitted) for name, (away, fitted) in rms.items() if math.isfinite(away)}


def _calibration(
    problem: _Problem, state: _State, held: Mapping[str, tuple[float, float]]
) -> MachineCalibration:
    slope = problem.jacobian(state.u, state.channels, state.left) * np.concatenate(state.weight)[:, None]
    covariance = np.asarray(np.linalg.inv(slope.T @ slope + np.eye(len(state.u))), dtype=np.float64)
    effective = sum(len(each) for each in state.left) / float(np.mean(state.inflation))
    quantile = float(student.ppf(0.975, max(effective - len(state.u), 2.0)))
    estimates = tuple(_estimates(problem, state.u, covariance, quantile))
    by_key = {each.key: each for each in estimates if each.key}
    values = {
        each.key: by_key[each.key].value if by_key[each.key].identified else each.value(0.0)
        for each in problem.parameters
        if each.kind == "rig"
    }
    return MachineCalibration(
        estimates,
        _friction_angle(problem, state.u, covariance, quantile),
        tuple(_ties(problem, state.u, covariance, quantile)),
        tuple(_channel_fits(problem, state)),
        held,
        with_values(problem.rig, values),
        problem.runs,
        tuple(problem.answers(state.channels)),
        tuple(note for run in problem.runs for note in run.notes),
    )


def _estimates(
    problem: _Problem, u: Vector, covariance: Matrix, quantile: float
) -> Iterator[MachineEstimate]:
    for j, each in enumerate(problem.parameters):
        sd = math.sqrt(covariance[j, j])
        value, low, high = (each.value(x) for x in (u[j], u[j] - quantile * sd, u[j] + quantile * sd))
        prior = (each.value(-1.96), each.value(1.96))
        key = each.key if each.kind == "rig" else ""
        yield MachineEstimate(each.name, each.unit, value, low, high, sd < FIT.unobserved, prior, key)


def _friction_angle(problem: _Problem, u: Vector, covariance: Matrix, quantile: float) -> MachineEstimate:
    """Return μΦ with the interval that the runs give it, whether or not they part μ from Φ."""
    keys = ("friction.coefficient", "route.angle_rad", "route.angle_gain")
    at = [j for j, each in enumerate(problem.parameters) if each.key in keys and each.prior.log]
    share = np.array([problem.parameters[j].prior.sd for j in at])
    rig = with_values(problem.rig, {problem.parameters[j].key: problem.parameters[j].value(u[j]) for j in at})
    value = rig.friction.coefficient * routed(problem.runs[0].routes[0], rig).total_angle
    sd, before = math.sqrt(float(share @ covariance[np.ix_(at, at)] @ share)), float(np.linalg.norm(share))
    low, high = value * math.exp(-quantile * sd), value * math.exp(quantile * sd)
    assumed = (value * math.exp(-1.96 * before), value * math.exp(1.96 * before))
    return MachineEstimate("μΦ", "1", value, low, high, sd < FIT.unobserved * before, assumed)


def _ties(problem: _Problem, u: Vector, covariance: Matrix, quantile: float) -> Iterator[str]:
    """Say which numbers of the rig are known only as a product or a ratio; docs/model.md (183)."""
    wide = [
        j
        for j, each in enumerate(problem.parameters)
        if each.kind == "rig" and each.prior.log and covariance[j, j] >= FIT.unobserved**2
    ]
    for a, b in itertools.combinations(wide, 2):
        one, other = problem.parameters[a], problem.parameters[b]
        sign = -1.0 if covariance[a, b] > 0.0 else 1.0
        both = np.array([one.prior.sd, sign * other.prior.sd])
        block = covariance[np.ix_([a, b], [a, b])]
        sd = math.sqrt(max(float(both @ block @ both), 0.0))
        if sd >= FIT.tied * float(np.linalg.norm(both)):
            continue
        middle = math.log(one.value(u[a])) + sign * math.log(other.value(u[b]))
        low, mid, high = (math.exp(middle + x * quantile * sd) for x in (-1, 0, 1))
        word = "product" if sign > 0 else "ratio"
        yield f"{one.name} and {other.name} show only as a {word}: {mid:.4g} [{low:.4g}, {high:.4g}]"


def _channel_fits(problem: _Problem, state: _State) -> Iterator[ChannelFit]:
    for (k, name, at), left, inflation in zip(problem.rows, state.left, state.inflation, strict=True):
        values = problem.runs[k].measured[name][at]
        of = f"{name} of {problem.runs[k].name}" if len(problem.runs) > 1 else name
        yield ChannelFit(
            of,
            name.rpartition("_")[2],
            float(np.sqrt(np.mean(left**2))),
            len(at),
            len(at) / float(inflation),
            reading_noise(values),
            float(np.ptp(values)),
            whiteness(left),
        )
