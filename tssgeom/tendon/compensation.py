"""The proximal command that makes the distal end go where it should: the model turned round.

Dead zones are jumped, so that the distal end answers at once after a reversal; docs/model.md (82), (83).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from scipy.optimize import brentq

from tssgeom.errors import SettingsError
from tssgeom.settings import Rig
from tssgeom.shape.arcs import Arcs
from tssgeom.tendon.state import TendonState, step, transmit

ACCURACY = 1e-10
"""Distal tension that counts as reached, relative to the greater of target and present tension [1]."""


@dataclass(frozen=True, slots=True)
class Command:
    """What the drive has to do, and the tendon once it has done it."""

    displacement_in: float
    """Position of the drive [m]."""
    tension_in: float
    """Tension at the proximal end [N]."""
    state: TendonState


def compensate(
    state: TendonState,
    arcs: Arcs,
    rig: Rig,
    *,
    tension_out: float | None = None,
    displacement_out: float | None = None,
) -> Command:
    """Return the least move of the drive after which the distal end is where it should be.

    Parameters
    ----------
    state
        Tension along the tendon before the move.
    arcs
        The route after the move.
    rig
        Tendon, friction and load.
    tension_out, displacement_out
        Wanted distal tension [N], or movement of the load since the pretensioned state [m]; one of them.

    Raises
    ------
    SettingsError
        Where not exactly one target is given, or where no proximal tension can reach it.
    FitError
        Where no equilibrium was found on a moving route.
    """
    target = _target(rig, tension_out, displacement_out)
    answer = _pulled_to(state.tension_in, state, arcs, rig)
    if _error(answer, target) != 0.0:
        answer = _reached(answer, state, arcs, rig, target)
    seen = transmit(answer, rig)
    return Command(seen.displacement_in, seen.tension_in, answer)


def _target(rig: Rig, tension_out: float | None, displacement_out: float | None) -> float:
    """Return the wanted distal tension [N]."""
    if (tension_out is None) == (displacement_out is None):
        raise SettingsError("a command needs one target: give tension_out [N] or displacement_out [m]")
    if tension_out is not None:
        target, said = tension_out, f"tension_out is {tension_out:g} N"
    else:
        stiffness = rig.load.stiffness_N_per_m
        if stiffness == 0.0:
            raise SettingsError("load.stiffness_N_per_m is 0: a dead weight's place has no tension: give it")
        target = rig.tendon.pretension_N + stiffness * (displacement_out or 0.0)  # docs/model.md (82)
        said = f"displacement_out is {displacement_out:g} m, a distal tension of {target:g} N"
    if not 0.0 <= target < math.inf:
        raise SettingsError(f"{said}: a tendon only pulls; choose a target with a finite tension >= 0 N")
    return target


def _reached(held: TendonState, state: TendonState, arcs: Arcs, rig: Rig, target: float) -> TendonState:
    """Return the state with the distal tension at the target, which it is not while the drive is held."""
    reach = rig.friction.coefficient * (held.route or arcs).total_angle
    sign = 1 if target > held.tension_out else -1
    far = target * math.exp(sign * reach)  # docs/model.md (83): exact where all slides
    answer = _pulled_to(far, state, arcs, rig)
    if _error(answer, target) == 0.0:
        return answer
    low, high = sorted((held.tension_in, far))  # not all slides one way where the route has moved too
    root: Any = brentq(
        lambda tension_in: _error(_pulled_to(tension_in, state, arcs, rig), target),
        low,
        high,
        xtol=1e-13 * max(high, 1.0),
    )
    return _pulled_to(float(root), state, arcs, rig)


def _pulled_to(tension_in: float, state: TendonState, arcs: Arcs, rig: Rig) -> TendonState:
    return step(state, arcs, rig, tension_in=tension_in)


def _error(state: TendonState, target: float) -> float:
    """Return distal tension less target [N], zero where that is rounding."""
    error = state.tension_out - target
    return 0.0 if abs(error) <= ACCURACY * max(state.tension_out, target) else error
