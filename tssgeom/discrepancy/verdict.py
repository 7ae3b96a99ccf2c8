"""The verdict: none, an effect, a tie, or unknown.

Source: docs/model.md (113), (114).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tssgeom.discrepancy.finding import Verdict
from tssgeom.discrepancy.guards import guards, leftover
from tssgeom.discrepancy.heldout import HeldOut
from tssgeom.discrepancy.problem import Fit, Problem
from tssgeom.discrepancy.select import Selection, name_of
from tssgeom.discrepancy.ties import close_rivals

_LEFT = 0.5  # of the guard, rms: what may be left of any channel
_SHARE = 0.3  # of what was left before: more means that no name explains it
_HELD = 0.8  # of the held-out gap: more means that the name does not carry over
_WIDE = 2.0  # times the noise: a held-out gap that no right name leaves
_HELD_SHARE = 0.2  # of it before: less is a name that is right but not to the last digit
_BENT = 4.5  # standard deviations that a cell may be bent beyond its specification


@dataclass(frozen=True, slots=True)
class Judged:
    """A verdict and what it rests on."""

    verdict: Verdict
    reason: str
    """Why unknown, in words; else empty."""
    left_before: float
    """Worst channel, rms beyond noise over guard [1]."""
    left_after: float
    held_ratio: float
    """[1]; NaN where nothing was held out or showed no gap."""


def judged(
    first: tuple[Problem, Fit], chosen: Selection, names: tuple[str, ...], held: HeldOut | None
) -> Judged:
    """Say what the selection amounts to; docs/model.md (113), (114)."""
    problem, base = first
    guard = guards(problem.stack, problem.rig)
    before = max(leftover(problem, base, guard).values())
    after = max(leftover(chosen.problem, chosen.fit, guard).values())
    ratio = math.nan if held is None else held.ratio(chosen.fit.at)
    gap = 0.0 if held is None else held.gap(chosen.fit.at)
    reason = _unknown(chosen, (before, after), names, (gap, ratio))
    if reason:
        return Judged("unknown", reason, before, after, ratio)
    if not chosen.fit.at.effects:
        return Judged("none", "", before, after, ratio)
    named = {name_of(effect) for effect in chosen.fit.at.effects}
    tied = any(
        now.tried and now.tried[0].name in named and {one.name for one in close_rivals(now)} - named
        for now in chosen.steps
    )
    return Judged("tie" if tied else "effect", "", before, after, ratio)


def _unknown(
    chosen: Selection, left: tuple[float, float], names: tuple[str, ...], held: tuple[float, float]
) -> str:
    (before, after), (gap, ratio) = left, held
    if after > _LEFT and after > _SHARE * before:
        return f"what is left is {after:.2g} of what the sensors could fake, {before:.2g} before"
    if chosen.fit.at.effects and (ratio > _HELD or (gap > _WIDE and ratio > _HELD_SHARE)):
        return f"on what was held out, the gap is {ratio:.2f} of what it was"
    bent = _bent(chosen, names)
    if bent:
        return f"{bent[0]} is bent {bent[1]:.0f} times as far as specified"
    return ""


def _bent(chosen: Selection, names: tuple[str, ...]) -> tuple[str, float] | None:
    """Return the channel whose cell bends far beyond its specification, and how far."""
    size = np.abs(chosen.problem.weighing.shared(chosen.fit.left))
    worst: tuple[str, float] | None = None
    for name, value in zip(names, size, strict=True):
        if name.startswith("bend ") and value > max(_BENT, worst[1] if worst else 0.0):
            worst = (name.split(" of ", 1)[1], float(value))
    return worst
