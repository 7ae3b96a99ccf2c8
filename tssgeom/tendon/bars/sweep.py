"""One sample on a fixed route where nothing but the drive moves the tendon: exact in one sweep.

The tension goes from contact to contact as far as the cone makes it; a position finds its tension by Newton's
method on the sum of all stretches. Source: docs/model.md (3), (50)-(54), (64).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from tssgeom.tendon.bars.plant import load_factor, stretch_of, stretched, worn


class SweepTolerances(NamedTuple):
    """How exactly one sweep over the contacts of a fixed route finds a position."""

    trials: int = 80
    """Tensions tried for a position [1]; derived: bisection alone would need some 60."""
    close: float = 1e-14
    """Distance from a position that ends the search [m]; chosen: rounding of a metre, with room."""
    accepted: float = 1e-10
    """Greatest distance from a position that is returned [m]; chosen: an atom."""
    load: float = 1e-7
    """Change of an exponent by the load that ends its iteration [1]; chosen: the next error is its square."""
    turns: int = 20
    """Most iterations of an exponent by the load [1]; chosen: Newton's method needs a few."""


SWEEP = SweepTolerances()
"""Used wherever a fixed route is swept."""


@njit(cache=True, nogil=True, error_model="numpy")
def _side(near, old, exponent, fixed, force, sign, law):
    """Return the tension behind a contact that slides, and its slope, with the load that it has itself.

    `sign` is −1 on a pull, +1 on a release; `law` is (exponent, reference) of the load; docs/model.md (52).
    """
    power, reference = law
    here, m = old, exponent * load_factor(0.5 * (near + old), power, reference)
    for _ in range(SWEEP.turns):
        ratio = math.exp(sign * (m + fixed))
        here = max(ratio * near + sign * force, 0.0)
        load = 0.5 * (near + here)
        wanted = exponent * load_factor(load, power, reference)
        bend = sign * 0.5 * power * wanted * ratio * near / max(load, 1e-9)  # d wanted / d m
        change = (wanted - m) / (1.0 - bend)
        m += change
        if abs(change) <= SWEEP.load:
            break
    ratio = math.exp(sign * (m + fixed))
    share = 0.5 * power * m * ratio * near / max(0.5 * near + 0.5 * here, 1e-9)
    return max(ratio * near + sign * force, 0.0), (ratio + sign * share) / (1.0 - sign * share)


@njit(cache=True, nogil=True, error_model="numpy")
def _sweep(plant, old, start, rest, cone, tension, slip):
    """Carry the tension `start` to the distal end; return where the drive is then [m], and slope [m/N]."""
    pulling, releasing, low, high = cone
    soft, toe, toe_scale, saved, saved_scale = (
        plant.soft,
        plant.toe,
        plant.toe_scale,
        plant.saved,
        plant.saved_scale,
    )
    fitting, force, power = plant.fitting, plant.force, plant.load_exponent
    law = (power, plant.load_reference)
    tension[0] = start
    stretch, slope = stretched(start, soft[0], toe[0], toe_scale[0], saved[0], saved_scale)
    shift, share, near = stretch - rest[0], 1.0, start
    for i in range(low.size):
        here = old[i + 1]
        lower, upper = low[i] * near - force[i], high[i] * near + force[i]
        down, up = low[i], high[i]
        if power != 0.0:
            factor = load_factor(0.5 * (near + here), power, law[1])
            lower = math.exp(-pulling[i] * factor - fitting[i]) * near - force[i]
            upper = math.exp(releasing[i] * factor + fitting[i]) * near + force[i]
            if here < lower:
                lower, down = _side(near, here, pulling[i], fitting[i], force[i], -1.0, law)
            elif here > upper:
                upper, up = _side(near, here, releasing[i], fitting[i], force[i], 1.0, law)
        if here < lower:
            here, slip[i], share = lower, 1, share * down
        elif here > upper:
            here, slip[i], share = upper, -1, share * up
        else:
            slip[i], share = 0, 0.0
        tension[i + 1], near = here, here
        stretch, rise = stretched(here, soft[i + 1], toe[i + 1], toe_scale[i + 1], saved[i + 1], saved_scale)
        shift += stretch - rest[i + 1]
        slope += share * rise
    return shift, slope


@njit(cache=True, nogil=True, error_model="numpy")
def _sliding_from(plant, tension, cone, pull):
    """Return the drive's tension at which the first contact begins to slide [N]."""
    pulling, releasing, low, high = cone
    load = 0.5 * (tension[0] + tension[1])
    factor = load_factor(load, plant.load_exponent, plant.load_reference)
    if pull:
        ratio = low[0] if plant.load_exponent == 0.0 else math.exp(-pulling[0] * factor - plant.fitting[0])
        return (tension[1] + plant.force[0]) / ratio * (1.0 + 1e-12)
    ratio = high[0] if plant.load_exponent == 0.0 else math.exp(releasing[0] * factor + plant.fitting[0])
    return max(tension[1] - plant.force[0], 0.0) / ratio * (1.0 - 1e-12)


@njit(cache=True, nogil=True, error_model="numpy")
def _at_position(plant, old, target, rest, cone, tension, slip):
    """Sweep with the tension that puts the drive at `target`; return how far off it is [m]."""
    start = old[0]
    shift, slope = _sweep(plant, old, start, rest, cone, tension, slip)
    if abs(shift - target) <= SWEEP.close or (start == 0.0 and shift > target):
        return 0.0
    below, above = (start, np.inf) if shift < target else (0.0, start)
    if slope <= 0.0:
        start = _sliding_from(plant, old, cone, shift < target)
        shift, slope = _sweep(plant, old, start, rest, cone, tension, slip)
    for _ in range(SWEEP.trials):
        if abs(shift - target) <= SWEEP.close:
            return 0.0
        below, above = (max(below, start), above) if shift < target else (below, min(above, start))
        new = start - (shift - target) / slope if slope > 0.0 else -1.0
        if new <= 0.0 and below == 0.0 and start > 0.0 and shift > target:
            new = 0.0  # perhaps more is given than the tendon takes back
        elif not below < new < above:
            new = 2.0 * below + 1.0 if above == np.inf else 0.5 * (below + above)
        if new == start or above - below <= 1e-15 * below:
            break
        start = new
        shift, slope = _sweep(plant, old, start, rest, cone, tension, slip)
        if start == 0.0 and shift >= target:
            return 0.0
    return abs(shift - target)


@njit(cache=True, nogil=True, error_model="numpy")
def swept(plant, memory, by_force, target, span, rest, cone, tension):
    """Bring the memory to a new drive, a tension [N] or a position [m]; return how far it is off [m]."""
    off = 0.0
    pulling, releasing, low, high = cone
    if plant.wear_gain != 0.0:
        worn(plant, memory.travel, pulling, releasing)
        for i in range(low.size):
            low[i] = math.exp(-pulling[i] - plant.fitting[i])
            high[i] = math.exp(releasing[i] + plant.fitting[i])
    if by_force:
        _sweep(plant, memory.tension, target, rest, cone, tension, memory.slip)
    else:
        off = _at_position(plant, memory.tension, target, rest, cone, tension, memory.slip)
    last = tension.size - 1
    memory.tension[last] = tension[last]
    here = stretch_of(plant, last, tension[last]) - rest[last]
    soft, toe, toe_scale, saved, saved_scale = (
        plant.soft,
        plant.toe,
        plant.toe_scale,
        plant.saved,
        plant.saved_scale,
    )
    for i in range(last - 1, -1, -1):
        moved = here - memory.displacement[i]
        memory.displacement[i] = here
        memory.travel[i] += abs(moved)
        memory.speed[i] = moved / span
        memory.tension[i] = tension[i]
        here += stretched(tension[i], soft[i], toe[i], toe_scale[i], saved[i], saved_scale)[0] - rest[i]
    return off
