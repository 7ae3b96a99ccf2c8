"""Slow twins of a chain of bars and its sweeps, as on a fixed route; docs/model.md (40)-(47)."""

from typing import NamedTuple

import numpy as np

from tssgeom.core.constants_tendon import SOLVER

PULLED, STUCK, RELEASED = 1, 0, -1


class Chain(NamedTuple):
    """The linear laws of n + 2 bars and the friction of the n + 1 contacts between them, for one step."""

    trial: np.ndarray
    """[n+2] Tension of each bar if no contact moved, negative where it would be slack [N]."""
    stiffness: np.ndarray
    """[n+2] 0 where the tension is given (force drive, dead weight) and at rigid ends [N/m]."""
    low: np.ndarray
    """[n+1] Least T[i+1] over T[i], but for the force of friction [1]."""
    high: np.ndarray
    """[n+1] Greatest T[i+1] over T[i], but for the force of friction [1]."""
    force: np.ndarray
    """[n+1] T[i+1] lies between low·T[i] − force and high·T[i] + force [N]."""
    drag: np.ndarray
    """[n+1] Friction for each metre moved in this step [N/m]."""
    bristle: np.ndarray
    """[n+1] Friction for each metre that a contact gives before it slides, inf where it does not [N/m]."""
    kept: np.ndarray
    """[n+1] Friction before the step, of a contact that gives [N]."""
    rigid_in: bool
    """Whether the proximal end moves by exactly `shift`."""
    rigid_out: bool
    """Whether the distal end is fixed."""
    shift: float
    """Movement of a rigid proximal end in this step [m]."""


def carry(chain, tension, slip):
    """Carry tension[0] to the distal end as on a fixed route; return the stretch gained [m] and its slope."""
    trial, stiffness, low, high, force = chain.trial, chain.stiffness, chain.low, chain.high, chain.force
    gained, gain, share = 0.0, 0.0, 1.0
    if stiffness[0] > 0.0:
        gained, gain = (tension[0] - trial[0]) / stiffness[0], 1.0 / stiffness[0]
    for i in range(slip.size):
        lower, upper = low[i] * tension[i] - force[i], high[i] * tension[i] + force[i]
        here = max(trial[i + 1], 0.0)
        slip[i] = STUCK
        if here < lower:
            here, slip[i], share = lower, PULLED, share * low[i]
        elif here > upper:
            here, slip[i], share = upper, RELEASED, share * high[i]
        else:
            share = 0.0
        tension[i + 1] = here
        if stiffness[i + 1] > 0.0:
            gained += (here - trial[i + 1]) / stiffness[i + 1]
            gain += share / stiffness[i + 1]
    return gained, gain


def range_of_drive(weight, low, high, force):
    """Return the proximal tensions between which a dead weight stays where it is [N]; docs/model.md (47)."""
    least, most = weight, weight
    for i in range(low.size - 1, -1, -1):
        least = max(least - force[i], 0.0) / high[i]
        most = (most + force[i]) / low[i]
    return least, most


def find_drive(chain, least, most, tension, slip):
    """Sweep with the tension between `least` and `most` that gains the shift; return what is gained [m]."""
    shift, below, above = chain.shift, least, most
    tension[0] = min(max(chain.trial[0], least), most)
    for _ in range(SOLVER.trials):
        gained, gain = carry(chain, tension, slip)
        below, above = (below, tension[0]) if gained > shift else (tension[0], above)
        new = tension[0] - (gained - shift) / max(gain, 1e-3 / chain.stiffness[1])
        if (new <= below and below == least) or (new >= above and above == most):
            new = min(max(new, least), most)
        elif not below < new < above:
            new = 2.0 * below + 1.0 if above == np.inf else 0.5 * (below + above)
        if abs(new - tension[0]) <= 1e-13 * tension[0]:
            break
        tension[0] = new
    return carry(chain, tension, slip)[0]


def guess(chain, hanging, tension, slip, tight):
    """Set slip and tight as they would be on a fixed route; exact there, for force and for position."""
    trial, shift = chain.trial, chain.shift
    tight[:] = True
    if not chain.rigid_in and chain.stiffness[0] == 0.0:
        tension[0] = trial[0]
        carry(chain, tension, slip)
        return
    least, most = 0.0, np.inf
    if hanging:
        least, most = range_of_drive(trial[slip.size], chain.low, chain.high, chain.force)
    gained = find_drive(chain, least, most, tension, slip)
    if tension[0] >= most:
        slip[:] = PULLED
    elif hanging and 0.0 < tension[0] <= least:
        slip[:] = RELEASED
    elif tension[0] <= 0.0 and gained > shift:
        tight[0] = False  # more is given than the tendon can take back: it hangs loose at the drive
