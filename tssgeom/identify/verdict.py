"""The verdict: none, an effect, a tie, or unknown; and its sentence.

Source: docs/model.md (113), (114).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tssgeom.channel_names import unit_of
from tssgeom.core.constants import CHANCE
from tssgeom.effects import KINDS
from tssgeom.identify.finding import Candidate, Estimate, Misfit, Verdict
from tssgeom.identify.fit import Fit, Problem
from tssgeom.identify.law_fit import LawFit
from tssgeom.identify.misfit import (
    UNINFORMATIVE,
    HeldOut,
    HeldOutChange,
    held_out_change,
    shows_held_out_alone,
)
from tssgeom.identify.screening import leftover
from tssgeom.identify.selection import Selection, close_candidates, name_of
from tssgeom.identify.uneven_friction import uneven_words

OVER = {
    "tension_N": ("tension", "N"),
    "speed_m_per_s": ("speed of sliding", "m/s"),
    "curvature_per_m": ("curvature", "1/m"),
    "arc_length_m": ("arc length", "m"),
    "travel_m": ("path slid", "m"),
    "time_s": ("time since the run began", "s"),
    "position_m": ("proximal position", "m"),
    "joint_angle_rad": ("angle of the joint", "rad"),
}
"""What a law may be over, and its unit in SI; a channel stands for itself."""


def variable(name: str, over: str) -> tuple[str, str]:
    """Return what a law is over, by its name, and the unit of that in SI."""
    if name == "strain_over_time":
        return "time since a step of tension", "s"
    return OVER.get(over, ("a reading", unit_of(over)))


_DEPENDS = {
    "friction_over_tension": "friction depends on the tension",
    "friction_over_speed": "friction depends on the speed of sliding",
    "friction_over_curvature": "friction depends on the curvature",
    "friction_over_arc_length": "friction is uneven along the sheath",
    "friction_over_travel": "friction changes with the path slid",
    "friction_over_time": "friction changes with time",
    "friction_over_position": "friction, or the angle of the route, changes with the position",
    "strain_over_tension": "the tendon stretches by another law than a straight line",
    "stretch_at_end": "what lies outside the sheath stretches by another law",
    "load_over_position": "the load is no straight spring",
    "strain_over_time": "the tendon stretches late, its compliance grows",
    "sensor_curve": "a sensor is no straight line",
    "sensor_drift": "a sensor drifts in time",
    "sensor_gain_drift": "the gain of a sensor drifts in time",
    "sensor_lag": "the sensor of the drive is late",
}


@dataclass(frozen=True, slots=True)
class VerdictLimits:
    """When the verdict is unknown.

    Frozen on the development seeds of `benchmarks.discovery`.
    """

    left: float = 0.65
    """Of the detection limit: rms that may be left of any channel [1]; chosen on development seeds."""
    share: float = 0.1
    """Of what was left without any part: a larger rest has no name [1]; chosen on development seeds."""
    closed: float = 0.5
    """Of the misfit of held-out runs: parts that close less leave something without a name [1]; chosen."""


VERDICT = VerdictLimits()


@dataclass(frozen=True, slots=True)
class Judgement:
    """A verdict and what it rests on."""

    verdict: Verdict
    reason: str
    """Why unknown, or what remains, in words; else empty."""
    bent: bool
    """Whether it is unknown only since a load cell is bent beyond its specification."""


def judged(
    first: tuple[Problem, Fit], chosen: Selection, names: tuple[str, ...], held: HeldOut | None
) -> Judgement:
    """Say what the selection amounts to; docs/model.md (113), (114)."""
    before, after = left_by(*first, held), left_by(chosen.problem, chosen.fit, held)
    reason = why_unknown([name_of(effect) for effect in chosen.fit.at.effects], before, after)
    if not reason and not chosen.fit.at.effects and held is not None and not held.explained(first[1].at):
        reason = f"{after[-1]:.2g} {_LIMIT} is left on the runs that were not fitted"
    bent = "" if reason else _bent(chosen, names)
    if reason or bent:
        return Judgement("unknown", reason or bent, bool(bent))
    if not chosen.fit.at.effects:
        return Judgement("none", "", False)
    named = {name_of(effect) for effect in chosen.fit.at.effects}
    tied = any(
        now.tried and now.tried[0].name in named and {one.name for one in close_candidates(now)} - named
        for now in chosen.steps
    )
    little = held is not None and closes_little(held.before, held.misfit(chosen.fit.at))
    return Judgement("tie" if tied else "partial" if little else "effect", "", False)


def closes_little(before: float, after: float) -> bool:
    """Whether parts leave much of the misfit of held-out runs, which is before and after [1]; (113)."""
    return before > UNINFORMATIVE and after > max(UNINFORMATIVE, VERDICT.closed * before)


def judged_laws(problem: Problem, base: Fit, fit: LawFit, held: HeldOut | None) -> Judgement:
    """Say what laws and formulae together amount to; docs/model.md (191)."""
    point = fit.point
    after = left_by(problem, Fit(point, fit.chi2, fit.residual, fit.jacobian, fit.left), held)
    parts = [name_of(effect) for effect in fit.at.effects] + [term.mechanism.name for term in fit.terms]
    reason = why_unknown(parts, left_by(problem, base, held), after)
    if reason:
        return Judgement("unknown", reason, False)
    remains = f"{after[0]:.2g} {_LIMIT}" if after[0] > VERDICT.left else ""
    return Judgement("law" if fit.terms else "partial" if remains else "effect", remains, False)


_LIMIT = "times the detection limit of the sensors"


def left_by(problem: Problem, fit: Fit, held: HeldOut | None) -> tuple[float, ...]:
    """Return what a model leaves over the detection limits, of fitted and of held-out runs [1]; (113)."""
    of_fitted = leftover(problem, fit.left)
    return (of_fitted,) if held is None else (of_fitted, held.leftover(fit.at))


def why_unknown(parts: Sequence[str], before: Sequence[float], after: Sequence[float]) -> str:
    """Say how much is left where it is much, with parts on held-out runs too, and what helps; else empty."""
    left = f"{after[0]:.2g} {_LIMIT} is left"
    if not parts:
        return left if after[0] > 1.0 else ""
    much = [now > max(VERDICT.left, VERDICT.share * was) for was, now in zip(before, after, strict=True)]
    if not all(much):
        return ""
    return f"{' and '.join(parts)} help{'s' * (len(parts) == 1)}, but {left}, {before[0]:.2g} times without"


def _bent(chosen: Selection, names: tuple[str, ...]) -> str:
    """Say which cell bends far beyond its specification, and how far; empty where none does."""
    size = np.abs(chosen.problem.whitening.shared(chosen.fit.left))
    bends = [(float(v), name) for name, v in zip(names, size, strict=True) if name.startswith("bend ")]
    worst, name = max(bends, default=(0.0, ""))
    if worst <= CHANCE.never:
        return ""
    return f"{name.split(' of ', 1)[1]} is bent {worst:.0f} times as far as specified"


_UNIT_AT_END = re.compile(r"(_(m|rad|N|Ns|s))?(_per_\w+)?$")
_PREFIXES = ((1e-6, "µ"), (1e-3, "m"), (1.0, ""), (1e3, "k"))


def sentence(
    judged: Judgement,
    effects: Sequence[Candidate],
    base: Mapping[str, Estimate],
    tied: Sequence[str],
    misfit: Misfit,
) -> str:
    """Return the verdict in one sentence; its numbers of held-out runs are those of `misfit`."""
    if judged.verdict == "none":
        return _nothing_missing(base, misfit)
    if judged.verdict == "unknown":
        if shows_held_out_alone(misfit):
            _, held = held_out_change(misfit)
            return f"What is missing shows on the held-out runs alone, by {times(held)} the noise."
        return f"No effect of the library explains it: {judged.reason}."
    parts = " and ".join(_effect(one) for one in effects if one.law is None)
    learnt = "; ".join(law_words(one) for one in effects if one.law is not None)
    text = f"The model lacks {parts}" if parts else "The model lacks a law that no formula of the library has"
    if learnt:
        text += f"{' and a law of its own' if parts else ''}: {learnt}"
    if judged.verdict == "tie":
        text += f", or {', '.join(tied)}, which these readings cannot separate"
    remains = f"; on the fitted runs {judged.reason} remains" if judged.reason else ""
    return f"{text}{_held_out_words(*held_out_change(misfit))}{remains}."


def times(ratio: float) -> str:
    """Say how many times a misfit is of the noise, in two digits without a power of ten [1]."""
    return f"{float(f'{ratio:.2g}'):.15g} times"


def remainder(left: float) -> str:
    """Say what is left with the chosen effects, in units of the noise [1]."""
    return f"Something remains that has no name here: {times(left)} the noise."


def _nothing_missing(base: Mapping[str, Estimate], misfit: Misfit) -> str:
    numbers = f"friction {number(base['friction'])} and compliance {number(base['compliance_per_N'])}"
    _, held = held_out_change(misfit)
    if held > UNINFORMATIVE:
        return (
            f"No effect is missing on the fitted runs: {numbers} leave no more than the sensors explain "
            f"there, but {times(held)} the noise on the held-out runs."
        )
    return f"No effect is missing: {numbers} leave no more than the sensors explain."


def _held_out_words(before: float, after: float) -> str:
    """Return how the misfit of the held-out runs changes [1]; empty where there are none."""
    if math.isnan(before):
        return ""
    if max(before, after) <= UNINFORMATIVE:
        return "; the held-out runs have no misfit, with it or without"
    first, last = float(f"{before:.2g}"), float(f"{after:.2g}")
    change = f"from {before:.3g} to {times(after)} the noise"
    if last < first:
        closed = math.floor(100.0 * (1.0 - after / before))
        return f"; it closes {closed} % of the disagreement on runs that were not fitted ({change})"
    grows = "stays" if first == last else "grows"
    return f"; but with it the misfit on held-out runs {grows}, {change}"


def plain(name: str) -> str:
    """Write a name of the library or of a phase as words; a key of the rig file, with a point, stays."""
    return name if "." in name else name.replace("_", " ")


def parameter(key: str) -> str:
    """Write the name of a parameter without the unit at its end."""
    return plain(key if "." in key else _UNIT_AT_END.sub("", key))


def _effect(one: Candidate) -> str:
    numbers = ", ".join(f"{parameter(key)} {number(value)}" for key, value in one.parameters[0].items())
    choice = "".join(
        f", {key} {plain(getattr(one.effects[0], key))}"
        for key in ("channel", "end")
        if hasattr(one.effects[0], key)
    )
    key = getattr(one.effects[0], "key", "")
    return f"{one.names[0]} ({numbers}{choice}{f', {key}' if key else ''})"


def number(estimate: Estimate) -> str:
    """Return an estimate with the half of its interval, in a unit that reads well."""
    half = 0.5 * (estimate.high - estimate.low)
    scale, prefix = 1.0, ""
    if estimate.unit in ("m", "s") and estimate.value:
        for factor, letter in _PREFIXES:
            if abs(estimate.value) >= factor:
                scale, prefix = factor, letter
    unit = "" if estimate.unit == "1" else f" {prefix}{estimate.unit}"
    if not math.isfinite(half):
        return f"{estimate.value / scale:.3g}{unit}"
    digits = max(1 - math.floor(math.log10(half / scale)), 0) if half > 0.0 else 3
    if abs(estimate.value / scale) >= 1e-2 and digits <= 6:
        return f"{estimate.value / scale:.{digits}f} ± {half / scale:.{digits}f}{unit}"
    return f"{estimate.value / scale:.3g} ± {half / scale:.1g}{unit}"


def why_not(one: Candidate, less: float, needed: float, held: HeldOutChange) -> str:
    """Return why a candidate was passed over.

    Parameters
    ----------
    one
        The candidate.
    less
        By how much its evidence is below that of the best [1].
    needed
        What its ΔBIC has to exceed [1].
    held
        What it changes on the held-out runs.
    """
    evidence = one.evidence
    if evidence.delta_bic < needed:
        return f"its ΔBIC of {evidence.delta_bic:.1f} is below the {needed:.1f} that clean campaigns reach."
    if evidence.size_over_limit <= 1.0:
        return f"it changes no channel by more than {evidence.size_over_limit:.2g} of the detection limit."
    if evidence.delta_bic - held.rise < needed:
        return f"{held.worse or 'the held-out runs do not show it'}."
    return f"its ΔBIC, held-out runs included, is {less:.0f} below the best."


def law_words(one: Candidate) -> str:
    """Say in a clause what a part is, with the range of its law."""
    name = one.names[0]
    if one.law is None or name in KINDS:
        return ""
    law, own = one.law, one.effects[0]
    at = getattr(own, "channel", "") or (f"{getattr(own, 'of', '')} end" if name == "stretch_at_end" else "")
    what = _DEPENDS[name] + (f" ({at})" if at else "")
    if len(law.x) < 4:
        return what
    if name == "friction_over_arc_length" and (where := uneven_words(law)):
        return f"{what}: {where}"
    least, most = int(np.argmin(law.value)), int(np.argmax(law.value))
    unit = "" if law.unit == "1" else f" {law.unit}"
    first, last = sorted((least, most))
    over, si = variable(name, law.over)
    start, end = f"{law.x[first]:.3g} {si}", f"{law.x[last]:.3g} {si}"
    low, high = f"{law.value[first]:.3g}{unit}", f"{law.value[last]:.3g}{unit}"
    nearest = min(law.nearest, key=lambda each: each[1], default=("", 0.0))[0]
    near = f"; nearest formula {nearest}" if nearest else ""
    return f"{what}: from {low} at {start} to {high} at {end} ({over}{near})"
