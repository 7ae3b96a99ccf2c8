"""Slow twin of the march through a run; docs/model.md (3), (50)-(65)."""

import math

import numpy as np

from tests.core.twins.tendon_laws import balanced, load_factor, stretch_of, stretched, workspace, worn
from tssgeom.core.constants_tendon import BAR, SOLVER, SWEEP

_AFTER_A_TURN = np.array([0.02, 0.06, 0.15, 0.35, 0.65, 1.0])


def _side(near, old, exponent, fixed, force, sign, law):
    """Return the tension behind a contact that slides, and its slope, with the load that it has itself.

    `sign` is −1 on a pull, +1 on a release; `law` is (exponent, reference) of the load; docs/model.md (52).
    """
    power, reference = law
    here, m = old, exponent * load_factor(0.5 * (near + old), power, reference)
    for _ in range(SOLVER.trials):
        ratio = math.exp(sign * (m + fixed))
        here = max(ratio * near + sign * force, 0.0)
        load = 0.5 * (near + here)
        factor = load_factor(load, power, reference)
        rise = power * factor / load if load > BAR.least_load else 0.0
        wanted = exponent * factor
        bend = sign * 0.5 * exponent * rise * ratio * near  # d wanted / d m
        change = (wanted - m) / (1.0 - bend)
        m += change
        if abs(change) <= math.sqrt(SWEEP.close):
            break
    ratio = math.exp(sign * (m + fixed))
    share = 0.5 * exponent * rise * ratio * near
    return max(ratio * near + sign * force, 0.0), (ratio + sign * share) / (1.0 - sign * share)


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
    for _ in range(SOLVER.trials):
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


def _cuts(before, now, parts, by_rate):
    """Return where to cut a step, as shares of it; docs/model.md (65)."""
    if by_rate and (abs(now) < 0.5 * abs(before) or now * before < 0.0):
        first = _AFTER_A_TURN / parts
        return np.concatenate((first, np.arange(2, parts + 1) / parts))
    return np.arange(1, parts + 1) / parts


def march(plant, memory, by_force, spans, drive, warmth, parts, out, profile):
    """Go through the samples; fill `out` [6, m] and, where it has rows, `profile` [m, b].

    `spans` [m] is the time since the sample before [s], `drive` [m] N or m, `warmth` [m] K since the run
    began, `parts` [m] the steps of each sample. Rows of `out`: T_in, T_out [N], x_in, x_out [m], what the
    first and the last contact did (+1 pulled, 0 stuck, −1 released). Return the number of samples done, fewer
    where one failed.
    """
    kept = memory.drive
    cone, room = workspace(plant)
    rest, whole = plant.rest, np.ones(1)
    for g in range(drive.size):
        first, cold, done = kept[0], kept[1], 0.0
        rate = (drive[g] - first) / max(spans[g], BAR.least_time)
        cuts = _cuts(kept[5], rate, parts[g], plant.by_rate) if plant.by_rate or parts[g] > 1 else whole
        for share in cuts:
            goal = drive[g] if share == 1.0 else first + share * (drive[g] - first)
            warm = warmth[g] if share == 1.0 else cold + share * (warmth[g] - cold)
            span, done = max((share - done) * spans[g], BAR.least_time), share
            if not by_force:
                kept[2] = min(max(kept[2], goal), goal + plant.backlash)  # docs/model.md (59)
            target = goal if by_force else kept[2]
            if plant.swift:
                if not swept(plant, memory, by_force, target, span, rest, cone, room[5]) <= SWEEP.accepted:
                    return g
                _hold_load(plant, memory, cone)
                continue
            weight = plant.pretension
            change, _ = balanced(plant, memory, by_force, target, weight, warm, span, rest, cone, room)
            if not change <= 1e2 * SOLVER.accepted:
                return g
            _hold_load(plant, memory, cone)
        kept[0], kept[1], kept[5] = drive[g], warmth[g], rate
        _record(plant, memory, by_force, rest[0], g, out)
        if profile.shape[0] > 0:
            profile[g] = memory.tension
    return drive.size


def _hold_load(plant, memory, cone):
    """Set the tension before the friction of the load, which the last contact has too; model.md (333)."""
    _, _, low, high = cone
    rubs, load, way = plant.load_friction, memory.tension[-1], memory.slip[-1]
    near, other = memory.tension[-2], plant.force[-1] - rubs
    held = min(max(memory.before_load[0], low[-1] * near - other), high[-1] * near + other)
    memory.before_load[0] = load + rubs * way if way else min(max(held, load - rubs), load + rubs)


def _record(plant, memory, by_force, rest, g, out):
    """Write one sample into `out`."""
    tension, kept, last = memory.tension, memory.drive, memory.tension.size - 1
    out[0, g], out[1, g], out[2, g] = tension[0], tension[last], kept[0]
    if plant.load_friction > 0.0:
        out[1, g] = memory.before_load[0]
    if by_force:  # docs/model.md (59)
        shift = memory.displacement[0] + stretch_of(plant, 0, tension[0]) - rest
        lag = kept[3] + (kept[4] - shift) * plant.backlash / BAR.turn
        kept[3], kept[4] = min(max(lag, 0.0), plant.backlash), shift
        out[2, g] = shift - kept[3]
    if plant.load == 0.0:
        out[3, g] = memory.displacement[last - 1]
    else:
        out[3, g] = (tension[last] - plant.pretension) / plant.load
    out[4, g], out[5, g] = memory.slip[0], memory.slip[last - 1]


def lagged(values, spans, lag, before):
    """Pass samples, straight between, through a lag that stands at `before`: in, out; docs/model.md (62)."""
    out = np.empty_like(values)
    last, read = before
    for i in range(values.size):
        if spans[i] > 0.0:
            behind = (values[i] - last) / spans[i] * lag
            read = values[i] - behind + (read - last + behind) * math.exp(-spans[i] / lag)
        last = values[i]
        out[i] = read
    return out


def front_of(slip, before, stands):
    """Return how many contacts from the drive on slid one way; as before where nothing moved there."""
    if slip[0] == 0:
        return before if stands else 0
    count = 1
    while count < slip.size and slip[count] == slip[0]:
        count += 1
    return count


def switch(memory, displacement_in, by_force):
    """Go from one kind of drive to the other: the tendon's end and the drive stay where they are; (59)."""
    drive = memory.drive
    if by_force:
        drive[0], drive[3], drive[4] = memory.tension[0], drive[2] - displacement_in, drive[2]
    else:
        drive[0], drive[2] = displacement_in, drive[4]
    drive[5] = 0.0
