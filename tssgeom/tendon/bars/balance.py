"""The equilibrium of all contacts for one step, with or without effects, on any route.

It is solved with the laws of bars and contacts made straight about the last pass. Displacements are absolute,
so that nothing drifts in a hold. Source: docs/model.md (40)-(47), (50)-(58).
"""

import math

import numpy as np
from numba import njit

from tssgeom.tendon.bars.equilibrium import PATIENCE, TOLERANCES, equilibrium
from tssgeom.tendon.bars.fixed_route import Chain, range_of_drive
from tssgeom.tendon.bars.plant import creep_weights, load_factor, stretched, worn


@njit(cache=True, nogil=True, error_model="numpy")
def _given(plant, memory, warmth, weights, target, rest, given):
    """Set the stretch that each bar would have if no contact moved [m]; docs/model.md (51), (58)."""
    kept, old, _ = weights
    position, warm, creep_soft = memory.displacement, plant.warm, plant.creep_soft
    creep, tension, last = memory.creep, memory.tension, given.size - 1
    for j in range(last + 1):
        left = position[j - 1] if j > 0 else target
        right = position[j] if j < last else 0.0
        given[j] = left - right + rest[j] - warm[j] * warmth
        if creep_soft[j] != 0.0:
            given[j] += creep_soft[j] * (plant.pretension - old * tension[j]) - kept * creep[j]


@njit(cache=True, nogil=True, error_model="numpy")
def _offer(plant, given, share, about, trial, stiffness):
    """Set the straight law of each bar about the tensions `about`; docs/model.md (50), (57)."""
    soft, toe, toe_scale, saved, saved_scale = (
        plant.soft,
        plant.toe,
        plant.toe_scale,
        plant.saved,
        plant.saved_scale,
    )
    creep_soft = plant.creep_soft
    for j in range(given.size):
        stretch, slope = stretched(about[j], soft[j], toe[j], toe_scale[j], saved[j], saved_scale)
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
def workspace(plant):
    """Return arrays that steps write into: exponents and sides of the cone, and room for `balanced`."""
    k = plant.force.size
    cone = (plant.pulling.copy(), plant.releasing.copy(), plant.low.copy(), plant.high.copy())
    wide, narrow = np.empty((4, k + 1)), np.empty((2, k))
    return cone, (wide[0], wide[1], wide[2], plant.force.copy(), narrow[0], wide[3], narrow[1])


@njit(cache=True, nogil=True, error_model="numpy")
def balanced(plant, memory, by_force, target, weight, warmth, span, rest, cone, room):
    """Bring the memory to a new drive; return how much the last pass changed any tension [N], and solves.

    `weight` is the tension of a dead weight [N]. A change of infinity means that there is no equilibrium; the
    memory is then as before.
    """
    given, trial, stiffness, force, drag, about, moved = room
    pulling, releasing, low, high = cone
    last = low.size
    weights = creep_weights(span / plant.creep_time)
    hanging = plant.load == 0.0
    rigid_in = not by_force and plant.soft[0] == 0.0 and plant.toe[0] == 0.0
    rigid_out = plant.load == np.inf and plant.soft[last] == 0.0 and plant.toe[last] == 0.0
    shift = target - memory.displacement[0] if rigid_in else 0.0
    _given(plant, memory, warmth, weights, 0.0 if by_force else target, rest, given)
    about[:] = memory.tension
    moved[:] = memory.speed * span
    drag[:] = plant.drag / span
    if plant.wear_gain != 0.0:
        worn(plant, memory.travel, pulling, releasing)
    chain = Chain(trial, stiffness, low, high, force, drag, rigid_in, rigid_out, shift)
    tension, w, residual = about, moved, np.inf
    change, slip, solves = np.inf, memory.slip, 0
    one_pass = not (plant.curved or plant.varied)
    for done in range(1 if one_pass else TOLERANCES.passes):
        _offer(plant, given, weights[2], about, trial, stiffness)
        if by_force:
            trial[0], stiffness[0] = target, 0.0
        elif rigid_in:
            trial[0], stiffness[0] = memory.tension[0], 0.0
        if hanging:
            trial[last], stiffness[last] = weight, 0.0
        elif rigid_out:
            trial[last], stiffness[last] = memory.tension[last], 0.0
        if plant.varied:
            _cone(plant, (pulling, releasing), about, moved, span, low, high, force, drag)
        if by_force and hanging:  # docs/model.md (47)
            least, most = range_of_drive(weight, low, high, force)
            if not least * (1.0 - TOLERANCES.dead_weight) <= target <= most * (1.0 + TOLERANCES.dead_weight):
                return np.inf, solves
        w, tension, slip, more, residual = equilibrium(chain, hanging, slip, PATIENCE)
        solves += more
        change = np.max(np.abs(tension - about))
        if one_pass or (change <= TOLERANCES.converged and residual <= TOLERANCES.accepted):
            break
        if done < TOLERANCES.full_passes:
            about[:], moved[:] = tension, w
        else:  # it swings from side to side of a bend in some law
            about[:], moved[:] = 0.5 * (about + tension), 0.5 * (moved + w)
    if not residual <= TOLERANCES.accepted:
        return np.inf, solves
    _keep(plant, memory, weights, tension, w, slip, span)
    return 0.0 if one_pass else change, solves


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
        memory.displacement[i] += moved[i]
        memory.travel[i] += abs(moved[i])
        memory.speed[i] = moved[i] / span
        memory.slip[i] = slip[i]
