"""Slow twin of the laws of bars and contacts, and of the equilibrium of one step; docs/model.md (50)-(58)."""

import math
from typing import NamedTuple

import numpy as np

from tests.core.twins.tendon_chain import Chain, range_of_drive
from tests.core.twins.tendon_equilibrium import equilibrium
from tssgeom.core.constants import ROUNDING
from tssgeom.core.constants_tendon import BAR, SOLVER
from tssgeom.core.constants_tendon_rows import HELD, LAW, MEMORY, PLANT

_PATIENCE = SOLVER.from_before, SOLVER.from_guess


class Plant(NamedTuple):
    """What stays the same during a run; b = n + 2 bars, k = n + 1 contacts."""

    soft: np.ndarray  # [b] stretch per tension [m/N]
    toe: np.ndarray  # [b] stretch of the toe [m]
    toe_scale: np.ndarray  # [b] N
    saved: np.ndarray  # [b] path saved when taut [m]
    saved_scale: float  # N
    clearance: float  # path saved for each radian when taut [m/rad]
    creep_soft: np.ndarray  # [b] creep per tension in the end [m/N]
    creep_time: float  # s
    warm: np.ndarray  # [b] m/K
    rest: np.ndarray  # [b] stretch under the pretension, before the run and on its first route [m]
    pulling: np.ndarray  # [k] exponent of the cone, before load, wear and speed
    releasing: np.ndarray  # [k]
    fitting: np.ndarray  # [k] exponent whatever load, wear and speed
    low: np.ndarray  # [k] exp of the exponents, where nothing changes them
    high: np.ndarray  # [k]
    force: np.ndarray  # [k] N
    load_friction: float  # N
    drag: np.ndarray  # [k] N·s/m
    load_exponent: float
    load_reference: float  # N
    wear_gain: float
    wear_travel: float  # m
    speed_gain: float
    speed_reference: float  # m/s
    presliding: np.ndarray  # m, of each contact
    presliding_reference: float  # N
    backlash: float  # m
    pretension: float  # N
    load: float  # N/m
    curved: bool  # stretch is no straight line over tension
    by_rate: bool  # friction depends on the speed of sliding
    varied: bool  # the cone depends on tension, travel or speed
    swift: bool  # nothing but the drive moves the tendon: one sweep gives the answer


class Memory(NamedTuple):
    """What one sample leaves to the next, b bars and k contacts; each step writes into these arrays."""

    tension: np.ndarray  # [b] N
    displacement: np.ndarray  # [k] displacement of each contact since the pretensioned state [m]
    speed: np.ndarray  # [k] of the last step [m/s]
    travel: np.ndarray  # [k] path slid so far, either way [m]
    creep: np.ndarray  # [b] m
    slip: np.ndarray  # [k] int8: +1 slid on a pull, 0 stuck, −1 slid on a release
    before_load: np.ndarray  # [1] tension before the friction of the load [N]
    drive: np.ndarray
    """[6] last drive [N or m], warmth [K], position past the backlash [m], lag [m] and position before it
    [m], rate [m/s].

    Its clock is left out."""


def unpacked(plant):
    """Return the twin of a `plant.Plant`."""
    bars = LAW._fields[: LAW.pulling]
    rows = {
        name: plant.rows[i, : None if name in bars else -1]
        for i, name in enumerate(LAW._fields)
        if name in Plant._fields
    }
    numbers = {name: plant.number(i) for i, name in enumerate(PLANT._fields) if name in Plant._fields}
    return Plant(**rows, **numbers, load_friction=float(plant.rows[LAW.force, -1]))


def remembered(block):
    """Return the twin of a memory, and the rest of its bars."""
    rows = block[: -len(HELD)].reshape(len(MEMORY), -1)
    memory = Memory(
        tension=rows[MEMORY.tension].copy(),
        displacement=rows[MEMORY.displacement, :-1].copy(),
        speed=rows[MEMORY.speed, :-1].copy(),
        travel=rows[MEMORY.travel, :-1].copy(),
        creep=rows[MEMORY.creep].copy(),
        slip=rows[MEMORY.slip, :-1].astype(np.int8),
        before_load=rows[MEMORY.travel, -1:].copy(),
        drive=block[-len(HELD) : -1].copy(),
    )
    return memory, rows[MEMORY.rest].copy()


def stretched(tension, soft, toe, toe_scale, saved, saved_scale):
    """Return stretch [m] of a taut bar and its slope [m/N]; docs/model.md (50)."""
    stretch, slope = soft * tension, soft
    if toe != 0.0:
        rest = math.exp(-tension / toe_scale)
        stretch += toe * (1.0 - rest)
        slope += toe * rest / toe_scale
    if saved != 0.0:
        rest = math.exp(-tension / saved_scale)
        stretch += saved * (1.0 - rest)
        slope += saved * rest / saved_scale
    return stretch, slope


def stretch_of(plant, j, tension):
    """Return the stretch of bar j [m]; docs/model.md (50)."""
    soft, toe, toe_scale = plant.soft[j], plant.toe[j], plant.toe_scale[j]
    return stretched(tension, soft, toe, toe_scale, plant.saved[j], plant.saved_scale)[0]


def load_factor(load, exponent, reference):
    """Return what the tension at a contact makes of the friction there [1]; docs/model.md (52)."""
    if exponent == 0.0:
        return 1.0
    return math.exp(exponent * math.log(max(load, BAR.least_load) / reference))


def worn(plant, travel, pulling, releasing):
    """Set the exponents of the cone after wear by the travel so far; docs/model.md (52)."""
    for i in range(travel.size):
        factor = 1.0 - plant.wear_gain * math.expm1(-travel[i] / plant.wear_travel)
        pulling[i], releasing[i] = plant.pulling[i] * factor, plant.releasing[i] * factor


def creep_weights(x):
    """Return weights of old creep, old and new tension after x time constants; docs/model.md (57)."""
    kept = math.exp(-x)
    mean = -math.expm1(-x) / x
    return kept, mean - kept, 1.0 - mean


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


def _bristles(plant, tension):
    """Return the stiffness of contacts that give way before they slide, and their friction; (279)."""
    if not np.any(plant.presliding):
        return np.full(plant.force.size, np.inf), np.zeros(plant.force.size)
    exponent = 0.5 * (plant.pulling + plant.releasing) + plant.fitting
    limit = exponent * plant.presliding_reference + plant.force
    return limit / plant.presliding, tension[:-1] - tension[1:]


def workspace(plant):
    """Return arrays that steps write into: exponents and sides of the cone, and room for `balanced`."""
    k = plant.force.size
    cone = (plant.pulling.copy(), plant.releasing.copy(), plant.low.copy(), plant.high.copy())
    wide, narrow = np.empty((4, k + 1)), np.empty((2, k))
    return cone, (wide[0], wide[1], wide[2], plant.force.copy(), narrow[0], wide[3], narrow[1])


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
    bristle, kept = _bristles(plant, memory.tension)
    chain = Chain(trial, stiffness, low, high, force, drag, bristle, kept, rigid_in, rigid_out, shift)
    tension, w, residual = about, moved, np.inf
    change, slip, solves = np.inf, memory.slip, 0
    one_pass = not (plant.curved or plant.varied)
    for done in range(1 if one_pass else SOLVER.trials):
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
            if not least * (1.0 - ROUNDING.relative) <= target <= most * (1.0 + ROUNDING.relative):
                return np.inf, solves
        w, tension, slip, more, residual = equilibrium(chain, hanging, slip, _PATIENCE)
        solves += more
        change = np.max(np.abs(tension - about))
        if one_pass or (change <= 0.1 * SOLVER.accepted and residual <= SOLVER.accepted):
            break
        if done < SOLVER.full_passes:
            about[:], moved[:] = tension, w
        else:  # it swings from side to side of a bend in some law
            about[:], moved[:] = 0.5 * (about + tension), 0.5 * (moved + w)
    if not residual <= SOLVER.accepted:
        return np.inf, solves
    _keep(plant, memory, weights, tension, w, slip, span)
    return 0.0 if one_pass else change, solves


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
