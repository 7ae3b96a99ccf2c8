"""The verdict: none, an effect, a tie, or unknown.

Source: docs/model.md (113), (114).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tssgeom.identify.detection_limits import guards, leftover
from tssgeom.identify.finding import Verdict
from tssgeom.identify.held_out import HeldOut
from tssgeom.identify.problem import Fit, Problem
from tssgeom.identify.selection import Selection, name_of
from tssgeom.identify.ties import close_rivals

_LEFT = 0.65  # of the guard, rms: what may be left of any channel
_SHARE = 0.3  # of what was left before: more means that no name explains it
_HELD = 0.8  # of the held-out gap: more means that the name does not carry over
_WIDE = 2.0  # times the noise: a held-out gap that no right name leaves
_HELD_SHARE = 0.2  # of it before: less is a name that is right but not to the last digit
_BENT = 5.5  # standard deviations that a cell may be bent beyond its specification


@dataclass(frozen=True, slots=True)
class Judged:
    """A verdict and what it rests on."""

    verdict: Verdict
    reason: str
    """Why unknown, in words; else empty."""
    bent: bool
    """Whether it is unknown only since a load cell is bent beyond its specification."""
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
    reason = _unknown(chosen, (before, after), (gap, ratio))
    bent = "" if reason else _bent(chosen, names)
    if reason or bent:
        return Judged("unknown", reason or bent, bool(bent), ratio)
    if not chosen.fit.at.effects:
        return Judged("none", "", False, ratio)
    named = {name_of(effect) for effect in chosen.fit.at.effects}
    tied = any(
        now.tried and now.tried[0].name in named and {one.name for one in close_rivals(now)} - named
        for now in chosen.steps
    )
    return Judged("tie" if tied else "effect", "", False, ratio)


def _unknown(chosen: Selection, left: tuple[float, float], held: tuple[float, float]) -> str:
    (before, after), (gap, ratio) = left, held
    if after > _LEFT and after > _SHARE * before:
        return f"what is left is {after:.2g} of what the sensors could fake, {before:.2g} before"
    if chosen.fit.at.effects and (ratio > _HELD or (gap > _WIDE and ratio > _HELD_SHARE)):
        return f"on what was held out, the gap is {ratio:.2f} of what it was"
    return ""


def _bent(chosen: Selection, names: tuple[str, ...]) -> str:
    """Say which cell bends far beyond its specification, and how far; empty where none does."""
    size = np.abs(chosen.problem.weighing.shared(chosen.fit.left))
    bends = [(float(v), name) for name, v in zip(names, size, strict=True) if name.startswith("bend ")]
    worst, name = max(bends, default=(0.0, ""))
    if worst <= _BENT:
        return ""
    return f"{name.split(' of ', 1)[1]} is bent {worst:.0f} times as far as specified"
