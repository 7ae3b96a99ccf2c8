"""What is said for each candidate: gain, threshold, size, held-out gap, and its numbers with intervals.

Source: docs/model.md (110)-(112), (115).
"""

from __future__ import annotations

import math

import numpy as np

from tssgeom.identify.finding import Candidate, Estimate, Evidence
from tssgeom.identify.held_out import HeldOut
from tssgeom.identify.problem import Fit, Free, Point
from tssgeom.identify.selection import Step, Tried, name_of

NORMAL = 1.959964
"""Standard deviations to either side of a 95 % interval."""


def evidence_of(now: Step, one: Tried, held: HeldOut | None) -> Evidence:
    """Return what is said for a candidate."""
    ratio = math.nan if held is None else held.ratio(one.fit.at)
    return Evidence(one.delta_bic, now.needed(one), one.size, ratio)


def estimates(fit: Fit, which: int) -> dict[str, Estimate]:
    """Return the fitted numbers of one effect, with intervals; docs/model.md (115)."""
    spread = np.sqrt(np.diag(fit.covariance))[2:] * math.sqrt(max(fit.chi2 / len(fit.left), 1.0))
    out = {}
    for free, sd in zip(fit.at.free, spread, strict=True):
        if free.effect == which:
            out[free.key] = _estimate(fit.at, free, float(sd))
    return out


def _estimate(at: Point, free: Free, sd: float) -> Estimate:
    effect = at.effects[free.effect]
    value = float(getattr(effect, free.key))
    u = free.u(value)
    low, high = (free.value(u + sign * NORMAL * sd) for sign in (-1.0, 1.0))
    return Estimate(value, effect.parameters[free.key].unit, min(low, value), max(high, value))


def candidate(now: Step, one: Tried, held: HeldOut | None, why_not: str) -> Candidate:
    """Return a candidate with its evidence."""
    which = len(one.fit.at.effects) - 1
    effect = one.fit.at.effects[which]
    return Candidate(
        (name_of(effect),), (effect,), (estimates(one.fit, which),), evidence_of(now, one, held), why_not
    )
