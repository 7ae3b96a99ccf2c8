"""Results of the fit of a machine: estimates, numbers that are tied, and the residuals of each channel."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import stdtrit

from tssgeom.arrays import Vector
from tssgeom.channel_names import unit_of
from tssgeom.core.constants import CHANCE
from tssgeom.identify.finding import LawCurve
from tssgeom.identify.fit_quality import ChannelFit, failures, is_identified, misfits, unexplained, whiteness
from tssgeom.identify.machine_bends import Valley
from tssgeom.identify.machine_held_out import NOTHING_HELD_OUT, HeldOut, contradictions
from tssgeom.identify.machine_law_bands import law_band
from tssgeom.identify.machine_parameters import route_numbers
from tssgeom.identify.machine_posterior import Posterior, posterior_of
from tssgeom.identify.machine_problem import FitState, Problem
from tssgeom.identify.machine_run import MachineRun
from tssgeom.identify.rig_errors import of_machine
from tssgeom.result import Result
from tssgeom.rig import Rig, with_values
from tssgeom.statistics import NORMAL_95, root_mean_square
from tssgeom.tendon.machine import routed
from tssgeom.uncertain import CERTAIN, RigErrors


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
    at_bound: bool = False
    """Whether a number of the rig went as far from what was assumed as a fit goes."""
    middle: float = math.nan
    """What was assumed: the middle of `assumed`."""

    @property
    def bounds(self) -> tuple[float | None, float | None]:
        """What it is at least and at most, where it is not identified but beyond what was assumed; (336)."""
        if self.identified:
            return None, None
        return self.low if self.low > self.middle else None, self.high if self.high < self.middle else None


@dataclass(frozen=True, slots=True, repr=False)
class MachineCalibration(Result):
    """Estimates of a machine from its runs."""

    estimates: tuple[MachineEstimate, ...]
    """Every number that was fitted."""
    friction_angle: MachineEstimate
    """μΦ of the first route, what friction takes from a tendon that slides all along [1]."""
    bends: tuple[MachineEstimate, ...]
    """Share of the angle in each of equal parts of a sheath, proximal to distal [1]; none where the rig or a
    shape has them."""
    tied: tuple[str, ...]
    """What is known only together, a sentence each."""
    channels: tuple[ChannelFit, ...]
    """How well each channel is met."""
    held: HeldOut
    """What is held out, and how a fit without it predicts it."""
    rig: Rig
    """The rig at the lowest point of (181): of what is not identified near what was assumed, but with the
    products and ratios that are."""
    values: tuple[Mapping[tuple[str, str], float], ...]
    """Of each run its zeros and its start, by kind and key, as `machine_prediction.predicted` takes them."""
    runs: tuple[MachineRun, ...]
    """The runs on their routes."""
    fitted: tuple[Mapping[str, Vector], ...]
    """What the model gives in each channel of each run."""
    warnings: tuple[str, ...]
    """What to know of the runs, a sentence each."""
    errors: RigErrors = CERTAIN
    """Of the numbers of the rig, as `write_rig` takes them."""
    laws: Mapping[str, LawCurve] = field(default_factory=dict)
    """By name: free laws that were fitted; docs/model.md (311)."""

    @property
    def held_out(self) -> Mapping[str, tuple[float, float]]:
        """By channel: rms on samples that are held out, and on those that are fitted without them."""
        return self.held.rms

    @property
    def failures(self) -> tuple[str, ...]:
        """Why the estimates are not to be used, a sentence each; none where the fit passes its test."""
        friction = next(each for each in self.estimates if each.key == "friction.coefficient")
        known = friction.value if friction.identified else None
        bounds = [each.name for each in self.estimates if each.at_bound]
        fitted = {f"{name} {k}": v for k, run in enumerate(self.fitted) for name, v in run.items()}
        why = (*failures(known, self.channels, bounds, fitted), *contradictions(self.held))
        of_rig = (each.identified for each in self.estimates if each.key)
        if any(of_rig) or self.friction_angle.identified or self.tied:
            return why
        return (
            *why,
            "the runs identify no number of the rig: move the drive farther, or measure more channels",
        )


def calibration_of(
    problem: Problem,
    state: FitState,
    held: HeldOut = NOTHING_HELD_OUT,
    notes: Sequence[str] = (),
    *,
    normal: bool = False,
    valley: Valley | None = None,
) -> MachineCalibration:
    """Return the estimates of a fit, with the covariance of Gauss and Newton; docs/model.md (181)-(183).

    Unless the posterior is to be taken for `normal`, it is followed along its widest numbers; (261). Where
    bends are not known their `valley` was.
    """
    effective = sum(len(each) for each in state.left) / float(np.mean(state.inflation))
    quantile = float(stdtrit(max(effective - len(state.u), 2.0), 0.975))
    problem, state, posterior = posterior_of(problem, state, quantile, normal=normal, valley=valley)
    estimates = tuple(_estimates(problem, posterior))
    bends = tuple(_bends(problem, posterior))
    values = {each.key: each.value for each in (*estimates, *bends) if each.key}
    channels = tuple(_channel_fits(problem, state))
    return MachineCalibration(
        estimates,
        _friction_angle(problem, posterior),
        bends,
        tuple(_ties(problem, posterior)),
        channels,
        held,
        problem.with_laws(with_values(problem.rig, values), posterior.u),
        tuple(problem.of_run(state.u, k) for k in range(len(problem.runs))),
        problem.runs,
        tuple(problem.answers(state.channels)),
        (*notes, *(note for run in problem.runs for note in run.notes), *misfits(channels)),
        replace(of_machine(problem, posterior), unexplained=unexplained(channels)),
        {} if normal else {law.name: law_band(problem, state, law) for law in problem.laws},
    )


def _estimates(problem: Problem, posterior: Posterior) -> Iterator[MachineEstimate]:
    u, alone = posterior.u, np.eye(len(posterior.u))
    for j, each in enumerate(problem.parameters):
        if each.kind == "share":
            continue
        sd, *ends = posterior.of(alone[j])
        value, low, high = (each.value(x) for x in (u[j], *ends))
        prior = (each.value(-NORMAL_95), each.value(NORMAL_95))
        key = each.key if each.kind == "rig" else ""
        bound = bool(key) and abs(u[j]) >= CHANCE.rare
        known, middle = is_identified(sd), each.value(0.0)
        yield MachineEstimate(each.name, each.unit, value, low, high, known, prior, key, bound, middle)


def _bends(problem: Problem, posterior: Posterior) -> Iterator[MachineEstimate]:
    """Yield the shares of the angle with the intervals that they have together; docs/model.md (287)."""
    at = [j for j, each in enumerate(problem.parameters) if each.kind == "share"]
    if not at:
        return
    u, sd = posterior.u, np.array([problem.parameters[j].prior.sd for j in at])
    weights = np.array([problem.parameters[j].value(u[j]) for j in at])
    shares = weights / weights.sum()
    slopes, assumed = (np.diag(sd) - sd * each for each in (shares, np.full(len(at), 1.0 / len(at))))
    for k, (j, share) in enumerate(zip(at, shares, strict=True)):
        along = np.zeros(len(u))
        along[at] = slopes[k]
        (error, *ends), wide = posterior.of(along), float(np.linalg.norm(assumed[k]))
        low, high = (min(share * math.exp(end - float(along @ u)), 1.0) for end in ends)
        least, most = (min(math.exp(way * NORMAL_95 * wide) / len(at), 1.0) for way in (-1.0, 1.0))
        name, known = f"share of Φ in part {k + 1} of {len(at)}", is_identified(error, wide)
        yield MachineEstimate(name, "1", share, low, high, known, (least, most), problem.parameters[j].key)


def _friction_angle(problem: Problem, posterior: Posterior) -> MachineEstimate:
    """Return μΦ with the interval that the runs give it, whether or not they part μ from Φ."""
    keys = ("friction.coefficient", "route.angle_rad", "route.angle_gain")
    first = ("route", str(route_numbers(problem.runs)[0][0]))
    at = [
        j
        for j, each in enumerate(problem.parameters)
        if (each.kind == "rig" and each.key in keys and each.prior.log) or (each.kind, each.key) == first
    ]
    u, share = posterior.u, np.zeros(len(posterior.u))
    share[at] = [problem.parameters[j].prior.sd for j in at]
    values = {(each.kind, each.key): each.value(u[j]) for j in at for each in (problem.parameters[j],)}
    rig = with_values(problem.rig, {key: value for (kind, key), value in values.items() if kind == "rig"})
    route = problem.runs[0].routes[0].scaled(angle=values.get(first, 1.0))
    value = rig.friction.coefficient * routed(route, rig).total_angle
    middle = value * math.exp(-float(share @ u))
    (sd, *ends), before = posterior.of(share), float(np.linalg.norm(share))
    low, high = (value * math.exp(end - float(share @ u)) for end in ends)
    assumed = (middle * math.exp(-NORMAL_95 * before), middle * math.exp(NORMAL_95 * before))
    known = is_identified(sd, before)
    return MachineEstimate("μΦ", "1", value, low, high, known, assumed, middle=middle)


def _ties(problem: Problem, posterior: Posterior) -> Iterator[str]:
    """Say which numbers of the rig are known only as a product or a ratio; docs/model.md (183)."""
    u, covariance, alone = posterior.u, posterior.covariance, np.eye(len(posterior.u))
    wide = [
        j
        for j, each in enumerate(problem.parameters)
        if each.kind == "rig" and each.prior.log and not is_identified(posterior.of(alone[j])[0])
    ]
    for a, b in itertools.combinations(wide, 2):
        one, other = problem.parameters[a], problem.parameters[b]
        sign = -1.0 if covariance[a, b] > 0.0 else 1.0
        both = one.prior.sd * alone[a] + sign * other.prior.sd * alone[b]
        sd, *ends = posterior.of(both)
        if not is_identified(sd, float(np.linalg.norm(both)) / math.sqrt(2.0)):  # as one of them would be
            continue
        mid = one.value(u[a]) * other.value(u[b]) ** sign
        low, high = (mid * math.exp(end - float(both @ u)) for end in ends)
        word = "product" if sign > 0 else "ratio"
        yield f"{one.name} and {other.name} show only as a {word}: {mid:.4g} [{low:.4g}, {high:.4g}]"


def _channel_fits(problem: Problem, state: FitState) -> Iterator[ChannelFit]:
    for (k, name, at), left, inflation in zip(problem.rows, state.left, state.inflation, strict=True):
        values = problem.runs[k].measured[name][at]
        of = f"{name} of {problem.runs[k].name}" if len(problem.runs) > 1 else name
        yield ChannelFit(
            of,
            unit_of(name),
            root_mean_square(left),
            len(at),
            len(at) / float(inflation),
            problem.runs[k].noise[name],
            float(np.ptp(values)),
            whiteness(left),
        )
