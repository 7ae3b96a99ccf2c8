"""One sample where more than the drive moves the tendon: creep, heat, drag, speed, a dead weight.

The balance of all contacts is solved with the laws of bars and contacts made straight about the last pass.
Places are absolute, so that nothing drifts in a hold. Source: docs/model.md (40)-(47), (50)-(58).
"""

import math

import numpy as np
from numba import njit

from tssgeom.tendon.bars.equilibrium import PATIENCE, equilibrium
from tssgeom.tendon.bars.fixed_route import range_of_drive
from tssgeom.tendon.bars.laws import creep_weights, load_factor, stretched, worn

PASSES = 90
"""Passes over curved laws before a step is given up."""
_ROUNDING = 1e-9  # of a drive that just holds a dead weight [1]
_BOLD = 15  # of them go all the way, the others half of it
SETTLED = 1e-8
"""Greatest change of any tension in the last pass of a step [N]."""
ACCEPTED = 1e-7
"""Largest residual of an equilibrium that is returned [N]."""


@njit(cache=True, nogil=True, error_model="numpy")
def _given(plant, memory, warmth, weights, target, rest, given):
    """Set the stretch that each bar would have if no contact moved [m]; docs/model.md (51), (58)."""
    kept, old, _ = weights
    place, warm, creep_soft = memory.place, plant.warm, plant.creep_soft
    creep, tension, last = memory.creep, memory.tension, given.size - 1
    for j in range(last + 1):
        left = place[j - 1] if j > 0 else target
        right = place[j] if j < last else 0.0
        given[j] = left - right + rest[j] - warm[j] * warmth
        if creep_soft[j] != 0.0:
            given[j] += creep_soft[j] * (plant.pretension - old * tension[j]) - kept * creep[j]


@njit(cache=True, nogil=True, error_model="numpy")
def _offer(plant, given, share, about, trial, stiffness):
    """Set the straight law of each bar about the tensions `about`; docs/model.md (50), (57)."""
    soft, toe, toe_scale, gap, gap_scale = plant.soft, plant.toe, plant.toe_scale, plant.gap, plant.gap_scale
    creep_soft = plant.creep_soft
    for j in range(given.size):
        stretch, slope = stretched(about[j], soft[j], toe[j], toe_scale[j], gap[j], gap_scale)
        stretch += share * creep_soft[j] * about[j]
        slope += share * creep_soft[j]
        stiffness[j] = 1.0 / slope if slope > 0.0 else 0.0
        trial[j] = about[j] + stiffness[j] * (given[j] - stretch)


@njit(cache=True, nogil=True, error_model="numpy")
def _cone(plant, exponents, about, moved, span, low, high, force, drag):
    """Set the cone of each contact about the last pass's tensions and movements; docs/model.md (52)-(56)."""
    pulling, releasing = exponents
    fitting, base_force, base_drag = plant.fitting, plant.force, plant.drag
    gain, path = plant.speed_gain, plant.speed_reference * span
    for i in range(low.size):
        factor = load_factor(0.5 * (about[i] + about[i + 1]), plant.load_exponent, plant.load_reference)
        force[i], drag[i] = base_force[i], base_drag[i] / span
        if gain != 0.0:
            slid = abs(moved[i])
            exponent = pulling[i] if moved[i] >= 0.0 else releasing[i]
            slope = about[i + 1] * exponent * factor * max(gain, 0.0) / (path + slid)
            factor *= max(1.0 + gain * math.log1p(slid / path), 0.0)
            drag[i] += slope  # docs/model.md (56)
            force[i] -= slope * slid
        low[i] = math.exp(-pulling[i] * factor - fitting[i])
        high[i] = math.exp(releasing[i] * factor + fitting[i])


@njit(cache=True, nogil=True, error_model="numpy")
def balanced(plant, memory, by_force, target, warmth, span, rest, cone, room):
    """Bring the memory to a new drive; return how much the last pass changed any tension [N]."""
    given, trial, stiffness, force, drag, about, moved = room
    pulling, releasing, low, high = cone
    last = low.size
    weights = creep_weights(span / plant.creep_time)
    hanging = plant.load == 0.0
    rigid = (
        not by_force and plant.soft[0] == 0.0 and plant.toe[0] == 0.0,
        plant.load == np.inf and plant.soft[last] == 0.0 and plant.toe[last] == 0.0,
    )
    shift = target - memory.place[0] if rigid[0] else 0.0
    _given(plant, memory, warmth, weights, 0.0 if by_force else target, rest, given)
    about[:] = memory.tension
    moved[:] = memory.speed * span
    drag[:] = plant.drag / span
    if plant.wear_gain != 0.0:
        worn(plant, memory.travel, pulling, releasing)
    tension, w, residual = about, moved, np.inf
    change, slip, calm = np.inf, memory.slip, not (plant.curved or plant.varied)
    for done in range(1 if calm else PASSES):
        _offer(plant, given, weights[2], about, trial, stiffness)
        if by_force:
            trial[0], stiffness[0] = target, 0.0
        elif rigid[0]:
            trial[0], stiffness[0] = memory.tension[0], 0.0
        if hanging:
            trial[last], stiffness[last] = plant.pretension, 0.0
        elif rigid[1]:
            trial[last], stiffness[last] = memory.tension[last], 0.0
        if plant.varied:
            _cone(plant, (pulling, releasing), about, moved, span, low, high, force, drag)
        if by_force and hanging:  # docs/model.md (47)
            least, most = range_of_drive(plant.pretension, low, high, force)
            if not least * (1.0 - _ROUNDING) <= target <= most * (1.0 + _ROUNDING):
                return np.inf
        chain = (trial, stiffness, low, high, force, drag, rigid, shift)
        w, tension, slip, _, residual = equilibrium(chain, hanging, slip, PATIENCE)
        change = np.max(np.abs(tension - about))
        if calm or (change <= SETTLED and residual <= ACCEPTED):
            break
        if done < _BOLD:
            about[:], moved[:] = tension, w
        else:  # it swings from side to side of a bend in some law
            about[:], moved[:] = 0.5 * (about + tension), 0.5 * (moved + w)
    if not residual <= ACCEPTED:
        return np.inf
    _keep(plant, memory, weights, tension, w, slip, span)
    return 0.0 if calm else change


@njit(cache=True, nogil=True, error_model="numpy")
def _keep(plant, memory, weights, tension, moved, slip, span):
    """Write what the step did into the memory."""
    kept, old, new = weights
    for j in range(tension.size):
        if plant.creep_soft[j] != 0.0:  # docs/model.md (57)
            pulled = old * memory.tension[j] + new * tension[j]
            memory.creep[j] = kept * memory.creep[j] + plant.creep_soft[j] * pulled
        memory.tension[j] = tension[j]
    for i in range(moved.size):
        memory.place[i] += moved[i]
        memory.travel[i] += abs(moved[i])
        memory.speed[i] = moved[i] / span
        memory.slip[i] = slip[i]
