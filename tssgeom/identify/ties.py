"""What the readings cannot separate, what does not show in them, and the next experiment that would.

Source: docs/model.md (116), (117), and the table of ties there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.core.constants import CHANCE
from tssgeom.effects import KINDS
from tssgeom.effects import Tie as Gauge
from tssgeom.errors import TssgeomError
from tssgeom.identify.finding import Experiment, Tie
from tssgeom.identify.fit import Fit, Problem, columns, unshared
from tssgeom.identify.prediction import Stack, simulated, stacked
from tssgeom.identify.readings import Reading
from tssgeom.identify.screening import ScoreTest, Screening
from tssgeom.identify.selection import Selection, Step, close_candidates, name_of, separable_from
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs


@dataclass(frozen=True, slots=True)
class TieLimits:
    """When two effects are the same to the readings.

    Frozen on the development seeds of `benchmarks.discovery`.
    """

    alike: float = 0.995
    """Cosine of two signatures from which no fit separates them [1]; chosen on development seeds."""
    absorbed: float = 0.2
    """Of a signature: share that friction and compliance leave at most where they are its tie [1]; chosen."""


TIES = TieLimits()
MOST_REPORTED = 1e4
"""ΔBIC beyond which a greater one is not reported [1]; arrangement."""
_LISTED = 3  # experiments that are listed at most; arrangement

_GAINS = ("tension_in_gain", "tension_out_gain")


@dataclass(frozen=True, slots=True)
class Tied:
    """A tie with what breaks it."""

    tie: Tie
    breaks: str
    """The experiment in words; empty where the menu has to find one."""


def ties_of(chosen: Selection) -> list[Tied]:
    """Return the ties of what was chosen, then those that hold whatever was chosen."""
    out = list[Tied]()
    named = [name_of(effect) for effect in chosen.fit.at.effects]
    for now in chosen.steps:
        if now.tried and now.tried[0].name in named:
            close = [one.name for one in close_candidates(now) if one.name not in named]
            if close:
                out.append(_profile(now.tried[0].name, close))
    if len(set(named) & set(_GAINS)) == 1:
        out.append(_of_force_scale(named))
    held = {frozenset(tied.tie.names) for tied in out}
    return out + [tied for tied in _of_signatures(chosen.steps[-1]) if frozenset(tied.tie.names) not in held]


def _profile(name: str, others: Sequence[str]) -> Tied:
    gauge = _gauge(name, others[0])
    names = (name, *others)
    if gauge is None:
        why = f"these readings separate them by less than {separable_from():g} in BIC"
        return Tied(Tie(names, "profile", why), "")
    return Tied(Tie(names, gauge.gauge, f"the same where {gauge.where}"), gauge.breaks)


def _of_force_scale(named: Iterable[str]) -> Tied:
    first = next(name for name in named if name in _GAINS)
    other = _GAINS[1 - _GAINS.index(first)]
    why = "the same, with the compliance, if pretension and load were set by these cells and not known apart"
    return Tied(Tie((first, other), "G1", why), "hang a known weight on each load cell")


def _gauge(name: str, other: str) -> Gauge | None:
    """Return the known tie of two effects, whichever lists it."""
    for one, two in ((name, other), (other, name)):
        for gauge in KINDS[one].ties:
            if two in gauge.partners:
                return gauge
    return None


def _of_signatures(now: Step) -> list[Tied]:
    """Return known ties that these readings leave standing, by the signatures of the effects."""
    best = _by_name(now.screening)
    small = {one.name for one in now.tried if one.delta_bic > now.needed(one) and one.size <= 1.0}
    out = list[Tied]()
    for name, test in best.items():
        for gauge in KINDS[name].ties:
            others = [other for other in gauge.partners if other in best and _alike(test, best[other])]
            if others:
                out.append(
                    Tied(Tie((name, *others), gauge.gauge, f"the same where {gauge.where}"), gauge.breaks)
                )
            elif _absorbed(test, name in small) and (own := _of_rig(gauge.partners)):
                out.append(
                    Tied(Tie((name, *own), gauge.gauge, f"the same where {gauge.where}"), gauge.breaks)
                )
    unique = dict[frozenset[str], Tied]()
    for tied in out:
        unique.setdefault(frozenset(tied.tie.names), tied)
    return list(unique.values())


def _by_name(view: Screening) -> dict[str, ScoreTest]:
    """Return the variant of each effect that shows most."""
    best: dict[str, ScoreTest] = {}
    for test in view.tests:
        if test.variant.name not in best or test.size > best[test.variant.name].size:
            best[test.variant.name] = test
    return best


def _of_rig(partners: Sequence[str]) -> list[str]:
    return [name for name in partners if name in ("rig.friction.coefficient", "rig.tendon.compliance_per_N")]


def _alike(one: ScoreTest, other: ScoreTest) -> bool:
    lengths = float(np.linalg.norm(one.column) * np.linalg.norm(other.column))
    return lengths > 0.0 and abs(float(one.column @ other.column)) > TIES.alike * lengths  # (116)


def _absorbed(test: ScoreTest, small: bool) -> bool:
    """Whether a refit of friction and compliance takes a signature up, but for what is too small to count."""
    return test.raw > CHANCE.rare and (
        small or (test.size < CHANCE.rare and test.size < TIES.absorbed * test.raw)
    )


def unobservable(view: Screening, absent: Mapping[str, str], named: Sequence[str]) -> dict[str, str]:
    """Return effects without a signature in these readings, and why."""
    out = dict(absent)
    for name, test in _by_name(view).items():
        if name in named or test.size >= CHANCE.rare:
            continue
        own = [gauge for gauge in KINDS[name].ties if _of_rig(gauge.partners)]
        if test.raw > CHANCE.rare and own:
            what = " and ".join(part.removeprefix("rig.") for part in _of_rig(own[0].partners))
            out[name] = f"at typical size a refit of {what} takes it up ({own[0].gauge}); {own[0].breaks}"
        else:
            out[name] = (
                f"at typical size it changes the readings by {test.size:.1f} standard deviations in all"
            )
    return out


def base_ties(fit: Fit, rig: Rig) -> tuple[str, list[Tied]]:
    """Return what a refit of friction and compliance may stand for, in words, and as ties."""
    spread = np.sqrt(np.diag(fit.covariance))
    words, ties = list[str](), list[Tied]()
    friction = math.log(fit.at.friction / max(rig.friction.coefficient, 1e-6))
    give = math.log(fit.at.compliance / rig.tendon.compliance_per_N)
    if abs(friction) > max(CHANCE.clear * spread[0], PLAUSIBLE.negligible):
        words.append(
            f"friction is {fit.at.friction:.4g} and not {rig.friction.coefficient:.4g}, which an angle gain "
            f"of {math.exp(friction):.3f} of the shape sensor would give as well (G3): "
            "only another sensor separates them"
        )
        names = ("rig.friction.coefficient", "angle gain of the shape sensor")
        ties.append(
            Tied(Tie(names, "G3", "both scale friction times angle"), "measure a route with another sensor")
        )
    if abs(give) > max(CHANCE.clear * spread[1], PLAUSIBLE.negligible):
        words.append(
            f"compliance is {fit.at.compliance:.4g} 1/N and not {rig.tendon.compliance_per_N:.4g} 1/N, "
            f"which a scale of {math.exp(give):.3f} of encoder or route length, or a sheath that gives way, "
            "would give as well (G2): a straight tendon with a dead weight separates them"
        )
        names = (
            "rig.tendon.compliance_per_N",
            "scale of the encoder",
            "length of the route",
            "give of the sheath",
        )
        ties.append(Tied(Tie(names, "G2", "all scale the stretch"), "a straight tendon with a dead weight"))
    return "; ".join(words), ties


_HELD_S = 60.0


@dataclass(frozen=True, slots=True)
class Plan:
    """One way to run the rig once more."""

    words: str
    changed: Callable[[Reading], Reading]


def _with_drive(reading: Reading, time: Vector, drive: Vector) -> Reading:
    """Return a reading on another course, its temperature held."""
    given = {"time_s": time, reading.drive: drive}
    if "temperature_C" in reading.given:
        given["temperature_C"] = np.interp(time, reading.time, reading.given["temperature_C"])
    measured = {name: np.zeros(len(time)) for name in reading.measured}
    return replace(reading, given=given, measured=measured)


def _faster(reading: Reading) -> Reading:
    return _with_drive(reading, 0.1 * reading.time, reading.given[reading.drive])


def _slower(reading: Reading) -> Reading:
    return _with_drive(reading, 10.0 * reading.time, reading.given[reading.drive])


def _held(reading: Reading) -> Reading:
    """Hold at the highest point."""
    time, drive = reading.time, reading.given[reading.drive]
    top = int(np.argmax(drive)) + 1
    hold = np.linspace(0.0, _HELD_S, 61)[1:]
    later = np.concatenate([time[:top], time[top - 1] + hold, time[top:] + _HELD_S])
    return _with_drive(
        reading, later, np.concatenate([drive[:top], np.full(60, drive[top - 1]), drive[top:]])
    )


def _cycled(reading: Reading) -> Reading:
    time, drive = reading.time, reading.given[reading.drive]
    span = time[-1] - time[0] + float(np.median(np.diff(time)))
    return _with_drive(reading, np.concatenate([time + k * span for k in range(5)]), np.tile(drive, 5))


def _pulled(reading: Reading) -> Reading:
    return _with_drive(reading, reading.time, 2.0 * reading.given[reading.drive])


def _on(bent: Callable[[Arcs], Arcs]) -> Callable[[Reading], Reading]:
    def changed(reading: Reading) -> Reading:
        route = replace(reading.route, name="new route", arcs=bent(reading.route.arcs))
        return replace(reading, route=route)

    return changed


def _straight(arcs: Arcs) -> Arcs:
    return Arcs.exact(arcs.length, 0.05 * arcs.angle)


def _end_unbent(arcs: Arcs) -> Arcs:
    """Put all of the angle into the middle half, so that both ends are straight and radii differ."""
    length, angle = arcs.total_length, arcs.total_angle
    return Arcs.exact(length * np.array([0.25, 0.5, 0.25]), angle * np.array([0.0, 1.0, 0.0]))


def _sharp(arcs: Arcs) -> Arcs:
    """Put the same angle into three sharp bends."""
    length, angle = arcs.total_length, arcs.total_angle
    return Arcs.exact(
        length * np.array([0.1, 0.1, 0.3, 0.1, 0.2, 0.1, 0.1]),
        angle * np.array([0.0, 0.4, 0.0, 0.3, 0.0, 0.3, 0.0]),
    )


OTHER_ROUTES: tuple[tuple[str, Callable[[Arcs], Arcs]], ...] = (
    ("lay the sheath nearly straight", _straight),
    ("lay the sheath with both ends straight and all bends in its middle", _end_unbent),
    ("lay the sheath with the same angle in three sharp bends", _sharp),
)
"""What the sheath of a run can be bent to, in words."""

MENU = (
    Plan("repeat a run ten times faster", _faster),
    Plan("repeat a run ten times slower", _slower),
    Plan(f"hold for {_HELD_S:g} s at the highest tension of a run", _held),
    Plan("repeat a run with five times the cycles", _cycled),
    Plan("repeat a run with twice the stroke", _pulled),
    *(Plan(f"{words}, and repeat a run", _on(bent)) for words, bent in OTHER_ROUTES),
)
"""What can be measured next with what is there."""


def best_plans(
    problem: Problem, first: Fit, others: Sequence[Fit], names: tuple[str, ...]
) -> list[Experiment]:
    """Return the changes of the plan that best separate a model from those it is tied with."""
    result = []
    for plan in MENU:
        gains = [_expected(problem, first, other, plan) for other in others]
        if min(gains) > 0.0:
            result.append(Experiment(plan.words, min(gains), names))
    result.sort(key=lambda one: -one.expected_delta_bic)
    return result[:_LISTED]


def _expected(problem: Problem, first: Fit, other: Fit, plan: Plan) -> float:
    """Return how much worse the other model would fit one changed run if the first is right; (117)."""
    reading = plan.changed(problem.stack.readings[0])
    stack: Stack = stacked([reading])
    plain = unshared(stack.noise)
    try:
        truth = simulated(stack, first.at.rig(problem.rig), first.at.effects)
        new = Problem(stack, plain, problem.rig, truth)
        left = new.left(other.at)
        slope = columns(new, other.at, left)
    except TssgeomError:
        return 0.0
    off = plain.whitened(left)
    known = np.linalg.inv(other.covariance)
    step = np.linalg.solve(slope.T @ slope + known, slope.T @ off)
    rest = off - slope @ step
    return float(min(rest @ rest + step @ known @ step, MOST_REPORTED))
