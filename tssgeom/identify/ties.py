"""What the readings cannot tell apart, and what does not show in them at all.

Source: docs/model.md (116), and the table of ties there.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tssgeom.effects import KINDS
from tssgeom.effects import Tie as Gauge
from tssgeom.identify.finding import Tie
from tssgeom.identify.problem import Fit
from tssgeom.identify.search import Look, Screen
from tssgeom.identify.selection import CLOSE, Selection, Step, Tried, name_of
from tssgeom.rig import Rig

_ALIKE = 0.995  # cosine of two signatures from which no fit parts them
_FAINT = 5.0  # standard deviations that an effect of typical size has to show
_ABSORBED = 0.2  # of a signature that friction and compliance leave, where they are its tie
_MOVED = 3.0  # standard errors by which friction or compliance has to move to be told
_LEAST_MOVE = 0.01  # and the share of them
_GAINS = ("tension_in_gain", "tension_out_gain")


@dataclass(frozen=True, slots=True)
class Tied:
    """A tie with what breaks it."""

    tie: Tie
    breaks: str
    """The experiment in words; empty where the menu has to find one."""


def close_rivals(now: Step) -> list[Tried]:
    """Return the runners-up that the readings do not part from the best."""
    best = now.tried[0]
    top = max(one.delta_bic for one in now.tried)
    return [one for one in now.tried if one is not best and top - one.delta_bic < CLOSE and now.passes(one)]


def ties_of(chosen: Selection) -> list[Tied]:
    """Return the ties of what was found, then those that hold whatever was found."""
    out = list[Tied]()
    named = [name_of(effect) for effect in chosen.fit.at.effects]
    for now in chosen.steps:
        if now.tried and now.tried[0].name in named:
            rivals = [one.name for one in close_rivals(now) if one.name not in named]
            if rivals:
                out.append(_profile(now.tried[0].name, rivals))
    if len(set(named) & set(_GAINS)) == 1:
        out.append(_of_force_scale(named))
    held = {frozenset(tied.tie.names) for tied in out}
    return out + [tied for tied in _of_signatures(chosen.steps[-1]) if frozenset(tied.tie.names) not in held]


def _profile(name: str, rivals: Sequence[str]) -> Tied:
    gauge = _gauge(name, rivals[0])
    names = (name, *rivals)
    if gauge is None:
        return Tied(Tie(names, "profile", f"these readings part them by less than {CLOSE:g} in BIC"), "")
    return Tied(Tie(names, gauge.gauge, f"the same where {gauge.where}"), gauge.breaks)


def _of_force_scale(named: Iterable[str]) -> Tied:
    first = next(name for name in named if name in _GAINS)
    other = _GAINS[1 - _GAINS.index(first)]
    why = "the same, with the compliance, if pretension and load were set by these cells and not known apart"
    return Tied(Tie((first, other), "G1", why), "hang a known weight on each load cell")


def _gauge(name: str, other: str) -> Gauge | None:
    """Return the known tie of two effects, whichever tells of it."""
    for one, two in ((name, other), (other, name)):
        for gauge in KINDS[one].ties:
            if two in gauge.partners:
                return gauge
    return None


def _of_signatures(now: Step) -> list[Tied]:
    """Return known ties that these readings leave standing, by the signatures of the effects."""
    best = _by_name(now.screen)
    small = {one.name for one in now.tried if one.delta_bic > now.needed(one) and one.size <= 1.0}
    out = list[Tied]()
    for name, look in best.items():
        for gauge in KINDS[name].ties:
            others = [other for other in gauge.partners if other in best and _alike(look, best[other])]
            if others:
                out.append(
                    Tied(Tie((name, *others), gauge.gauge, f"the same where {gauge.where}"), gauge.breaks)
                )
            elif _absorbed(look, name in small) and (own := _of_rig(gauge.partners)):
                out.append(
                    Tied(Tie((name, *own), gauge.gauge, f"the same where {gauge.where}"), gauge.breaks)
                )
    seen = dict[frozenset[str], Tied]()
    for tied in out:
        seen.setdefault(frozenset(tied.tie.names), tied)
    return list(seen.values())


def _by_name(view: Screen) -> dict[str, Look]:
    """Return the variant of each effect that shows most."""
    best: dict[str, Look] = {}
    for look in view.looks:
        if look.variant.name not in best or look.size > best[look.variant.name].size:
            best[look.variant.name] = look
    return best


def _of_rig(partners: Sequence[str]) -> list[str]:
    return [name for name in partners if name in ("rig.friction.coefficient", "rig.tendon.compliance_per_N")]


def _alike(one: Look, other: Look) -> bool:
    lengths = float(np.linalg.norm(one.column) * np.linalg.norm(other.column))
    return lengths > 0.0 and abs(float(one.column @ other.column)) > _ALIKE * lengths


def _absorbed(look: Look, small: bool) -> bool:
    """Whether a refit of friction and compliance takes a signature up, but for what is too small to count."""
    return look.raw > _FAINT and (small or (look.size < _FAINT and look.size < _ABSORBED * look.raw))


def unobservable(view: Screen, absent: Mapping[str, str], named: Sequence[str]) -> dict[str, str]:
    """Return effects without a signature in these readings, and why."""
    out = dict(absent)
    for name, look in _by_name(view).items():
        if name in named or look.size >= _FAINT:
            continue
        own = [gauge for gauge in KINDS[name].ties if _of_rig(gauge.partners)]
        if look.raw > _FAINT and own:
            what = " and ".join(part.removeprefix("rig.") for part in _of_rig(own[0].partners))
            out[name] = f"at typical size a refit of {what} takes it up ({own[0].gauge}); {own[0].breaks}"
        else:
            out[name] = (
                f"at typical size it changes the readings by {look.size:.1f} standard deviations in all"
            )
    return out


def base_ties(fit: Fit, rig: Rig) -> tuple[str, list[Tied]]:
    """Return what a refit of friction and compliance may stand for, in words, and as ties."""
    spread = np.sqrt(np.diag(fit.covariance))
    words, ties = list[str](), list[Tied]()
    friction = math.log(fit.at.friction / max(rig.friction.coefficient, 1e-6))
    give = math.log(fit.at.compliance / rig.tendon.compliance_per_N)
    if abs(friction) > max(_MOVED * spread[0], _LEAST_MOVE):
        words.append(
            f"friction is {fit.at.friction:.4g} and not {rig.friction.coefficient:.4g}, which an angle gain "
            f"of {math.exp(friction):.3f} of the shape sensor would look like (G3): only another sensor tells"
        )
        names = ("rig.friction.coefficient", "angle gain of the shape sensor")
        ties.append(
            Tied(Tie(names, "G3", "both scale friction times angle"), "measure a route with another sensor")
        )
    if abs(give) > max(_MOVED * spread[1], _LEAST_MOVE):
        words.append(
            f"compliance is {fit.at.compliance:.4g} 1/N and not {rig.tendon.compliance_per_N:.4g} 1/N, "
            f"which a scale of {math.exp(give):.3f} of encoder or route length, or a sheath that gives way, "
            "would look like (G2): a straight tendon with a dead weight tells"
        )
        names = (
            "rig.tendon.compliance_per_N",
            "scale of the encoder",
            "length of the route",
            "give of the sheath",
        )
        ties.append(Tied(Tie(names, "G2", "all scale the stretch"), "a straight tendon with a dead weight"))
    return "; ".join(words), ties
