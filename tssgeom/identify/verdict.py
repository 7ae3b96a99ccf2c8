"""The verdict: none, an effect, a tie, or unknown; and its sentence.

Source: docs/model.md (113), (114).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tssgeom.identify.finding import Candidate, Estimate, Misfit, Verdict
from tssgeom.identify.fit import Fit, Problem
from tssgeom.identify.law_fit import LawFit
from tssgeom.identify.law_words import law_words
from tssgeom.identify.misfit import MISFIT, UNINFORMATIVE, HeldOut, held_out_change
from tssgeom.identify.screening import detection_limits, leftover
from tssgeom.identify.selection import Selection, close_candidates, name_of


@dataclass(frozen=True, slots=True)
class VerdictLimits:
    """When the verdict is unknown.

    Frozen on the development seeds of `benchmarks.discovery`.
    """

    left: float = 0.65
    """Of the detection limit: rms that may be left of any channel [1]; chosen on development seeds."""
    share: float = 0.3
    """Of the misfit before: a larger rest has no name [1]; chosen on development seeds."""
    held_share: float = 0.2
    """Of the held-out misfit before: a smaller rest is a right name [1]; chosen on development seeds."""
    held: float = 0.8
    """Of the held-out misfit before: with a larger rest the name does not carry over [1]; chosen."""
    wide: float = 2.0
    """Held-out misfit in units of the noise that no right name leaves [1]; chosen on development seeds."""
    bent: float = 5.5
    """S.d. that a cell may be bent beyond its specification [1]; chosen on development seeds."""


VERDICT = VerdictLimits()


@dataclass(frozen=True, slots=True)
class Judgement:
    """A verdict and what it rests on."""

    verdict: Verdict
    reason: str
    """Why unknown, or what remains, in words; else empty."""
    bent: bool
    """Whether it is unknown only since a load cell is bent beyond its specification."""
    held_ratio: float
    """[1]; NaN without held-out runs or misfit."""


def judged(
    first: tuple[Problem, Fit], chosen: Selection, names: tuple[str, ...], held: HeldOut | None
) -> Judgement:
    """Say what the selection amounts to; docs/model.md (113), (114)."""
    problem, base = first
    limits = detection_limits(problem.stack, problem.rig)
    before = max(leftover(problem, base, limits).values())
    after = max(leftover(chosen.problem, chosen.fit, limits).values())
    ratio = math.nan if held is None else held.ratio(chosen.fit.at)
    misfit = 0.0 if held is None else held.misfit(chosen.fit.at)
    reason = _unknown(chosen, (before, after), (misfit, ratio))
    bent = "" if reason else _bent(chosen, names)
    if reason or bent:
        return Judgement("unknown", reason or bent, bool(bent), ratio)
    if not chosen.fit.at.effects:
        return Judgement("none", "", False, ratio)
    named = {name_of(effect) for effect in chosen.fit.at.effects}
    tied = any(
        now.tried and now.tried[0].name in named and {one.name for one in close_candidates(now)} - named
        for now in chosen.steps
    )
    return Judgement("tie" if tied else "effect", "", False, ratio)


_HELD = "of the disagreement on what was not fitted"


def judged_laws(fit: LawFit, left: float, held_ratio: float) -> Judgement:
    """Say what laws and formulae together amount to; `left` is over the detection limit [1]; (191)."""
    if held_ratio > VERDICT.held:
        return Judgement(
            "unknown", f"the best laws leave {100.0 * held_ratio:.0f} % {_HELD}", False, held_ratio
        )
    remains = f"{left:.2g} times the detection limit of the sensors" if left > VERDICT.left else ""
    partly = (bool(remains) or held_ratio > VERDICT.share) and not held_ratio < VERDICT.held_share
    verdict: Verdict = "law" if fit.terms else "partial" if partly else "effect"
    return Judgement(verdict, remains, False, held_ratio)


def _unknown(chosen: Selection, left: tuple[float, float], held: tuple[float, float]) -> str:
    (before, after), (misfit, ratio) = left, held
    if after > VERDICT.left and after > VERDICT.share * before:
        return (
            f"with the best effects of the library {after:.2g} times the detection limit of the sensors is "
            f"left, {before:.2g} times without"
        )
    if chosen.fit.at.effects and (
        ratio > VERDICT.held or (misfit > VERDICT.wide and ratio > VERDICT.held_share)
    ):
        return f"the best name leaves {100.0 * ratio:.0f} % of the misfit of the held-out runs"
    return ""


def _bent(chosen: Selection, names: tuple[str, ...]) -> str:
    """Say which cell bends far beyond its specification, and how far; empty where none does."""
    size = np.abs(chosen.problem.whitening.shared(chosen.fit.left))
    bends = [(float(v), name) for name, v in zip(names, size, strict=True) if name.startswith("bend ")]
    worst, name = max(bends, default=(0.0, ""))
    if worst <= VERDICT.bent:
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
        return f"Something is missing that has no name here: {judged.reason}."
    parts = " and ".join(_effect(one) for one in effects if one.law is None)
    learnt = "; ".join(law_words(one) for one in effects if one.law is not None)
    text = f"The model lacks {parts}" if parts else "The model lacks a law that no formula of the library has"
    if learnt:
        text += f"{' and a law of its own' if parts else ''}: {learnt}"
    if judged.verdict == "tie":
        text += f", or {', '.join(tied)}, which these readings cannot separate"
    remains = f"; on the fitted runs {judged.reason} remains" if judged.reason else ""
    return f"{text}{_held_out_words(*held_out_change(misfit))}{remains}."


def remainder(left: float) -> str:
    """Say what is left with the chosen effects, in units of the noise [1]."""
    return f"Something remains that has no name here: {left:.2g} times the noise."


def _nothing_missing(base: Mapping[str, Estimate], misfit: Misfit) -> str:
    numbers = f"friction {number(base['friction'])} and compliance {number(base['compliance_per_N'])}"
    _, held = held_out_change(misfit)
    if held > UNINFORMATIVE:
        return (
            f"No effect is missing on the fitted runs: {numbers} leave no more than the sensors explain "
            f"there, but {held:.2g} times the noise on the held-out runs."
        )
    return f"No effect is missing: {numbers} leave no more than the sensors explain."


def _held_out_words(before: float, after: float) -> str:
    """Return how the misfit of the held-out runs changes [1]; empty where there are none."""
    if math.isnan(before):
        return ""
    if max(before, after) <= UNINFORMATIVE:
        return "; the held-out runs have no misfit, with it or without"
    change = f"from {before:.3g} to {after:.2g} times the noise"
    if after < MISFIT.same * before:
        closed = math.floor(100.0 * (1.0 - after / before))
        return f"; it closes {closed} % of the disagreement on runs that were not fitted ({change})"
    grows = "grows" if MISFIT.same * after > before else "stays"
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
    digits = 1 - math.floor(math.log10(half / scale)) if half > 0.0 else 3
    if abs(estimate.value / scale) >= 1e-2 and 0 <= digits <= 6:
        return f"{estimate.value / scale:.{digits}f} ± {half / scale:.{digits}f}{unit}"
    return f"{estimate.value / scale:.3g} ± {half / scale:.1g}{unit}"


def why_not(one: Candidate, less: float, needed: float, rise: float) -> str:
    """Return why a candidate was passed over.

    Parameters
    ----------
    one
        The candidate.
    less
        By how much its evidence is below that of the best [1].
    needed
        What its ΔBIC has to exceed [1].
    rise
        Of χ² of the held-out runs [1].
    """
    evidence = one.evidence
    if evidence.delta_bic < needed:
        return f"its ΔBIC of {evidence.delta_bic:.1f} is below the {needed:.1f} that clean campaigns reach."
    if evidence.size_over_limit <= 1.0:
        return f"it changes no channel by more than {evidence.size_over_limit:.2g} of the detection limit."
    if evidence.delta_bic - rise < needed:
        return "the held-out runs contradict it."
    return f"its ΔBIC, held-out runs included, is {less:.1f} below the best."
