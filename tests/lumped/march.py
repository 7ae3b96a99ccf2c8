"""The chain in time, compiled: backward Euler steps, each balanced to rounding.

Nothing here knows a closed form of the tension along a sheath. A node is in balance when the two bars and
the friction, projected on the tangent of the sheath, add to zero; the bars press the contact force into it.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from tests.lumped.contact import grip, speed_factor, stretched
from tests.lumped.sweep import answer

TOLERANCE_N = 1e-9  # between passes over curved laws; displacements of 1e-2 m round to some 1e-9 N
PASSES = 60  # more than that and the step is halved
HALVINGS = 12


class State(NamedTuple):
    """What a step leaves to the next."""

    position: np.ndarray  # [k] displacement of the nodes, towards the proximal end [m]
    tension: np.ndarray  # [b] N
    friction: np.ndarray  # [k] against motion to the proximal end [N]
    slip: np.ndarray  # [k] of the last step [m]
    travel: np.ndarray  # [k] slipped so far, either way [m]
    speed: np.ndarray  # [k] as the friction feels it [m/s]
    creep: np.ndarray  # [b, c] m
    work: np.ndarray  # [1] turned into heat by friction [J]


class Inputs(NamedTuple):
    """What is imposed at one time."""

    drive: float  # N or m
    warmth: float  # K above the start
    growth: np.ndarray  # [b] m each bar's path is longer than at the start
    turns: np.ndarray  # [k] rad, 0 at the fittings


@njit(cache=True, nogil=True, error_model="numpy")
def march(chain, spans, drive, warmth, frame, weight, growth, turns, keep, records):
    """Run steps of `spans` [g] and write the kept ones into `records`; return how many steps and passes.

    A negative number of steps tells the grid point where no balance was found.
    """
    state = start(chain, turns[0])
    now = inputs(chain, drive[0], warmth[0], frame[0], weight[0], growth, turns)
    rest = _rest(chain, state, turns[0])
    steps, passes, kept = 0, 0, 0
    before = now
    for g in range(len(spans)):
        after = inputs(chain, drive[g], warmth[g], frame[g], weight[g], growth, turns)
        done, part = 0.0, 1.0
        while done < 1.0:
            goal = min(done + part, 1.0)
            used = advance(chain, state, rest, _between(before, after, goal), (goal - done) * spans[g])
            steps += 1
            passes += abs(used)
            if used >= 0:
                done = goal
            else:
                part *= 0.5
                if part < 0.5**HALVINGS:
                    return -g - 1, passes
        if keep[g]:
            _record(records, kept, state)
            kept += 1
        before = after
    return steps, passes


@njit(cache=True, nogil=True, error_model="numpy")
def start(chain, turns):
    """Return the pretensioned state: one tension, no friction, creep at rest."""
    k, c = len(chain.friction), len(chain.creep_time)
    tension = np.full(k + 1, chain.pretension)
    return State(
        np.zeros(k),
        tension,
        np.zeros(k),
        np.zeros(k),
        np.zeros(k),
        np.zeros(k),
        chain.creep_compliance * chain.pretension if c > 0 else np.zeros((k + 1, 0)),
        np.zeros(1),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def inputs(chain, drive, warmth, frame, weight, growth, turns):
    """Return what is imposed between two frames of the path."""
    after = min(frame + 1, len(turns) - 1)
    k = len(chain.friction)
    longer, turn = np.zeros(k + 1), np.zeros(k)
    longer[1:-1] = (1.0 - weight) * growth[frame] + weight * growth[after]
    turn[1:-1] = (1.0 - weight) * turns[frame] + weight * turns[after]
    return Inputs(drive, warmth, longer, turn)


@njit(cache=True, nogil=True, error_model="numpy")
def advance(chain, state, rest, goal, span):
    """Bring the state to what is imposed after `span` [s]; return passes, below 0 without a balance.

    Curved laws are straightened about the last pass until the tensions stay; straight laws need one.
    """
    k = len(state.position)
    base, soft = _offers(chain, state, rest, goal, span)
    offset, slope = np.empty(k + 1), np.empty(k + 1)
    up, down = np.empty((k, 3)), np.empty((k, 3))
    tension, moved = state.tension.copy(), state.slip.copy()
    last = tension.copy()
    for done in range(PASSES):
        for j in range(k + 1):
            gap = chain.clearance_per_turn * _turn_of_bar(goal.turns, j)
            ext, slope[j] = stretched(
                last[j], soft[j], chain.toe[j], chain.toe_scale[j], gap, chain.clearance_scale
            )
            offset[j] = ext - slope[j] * last[j] - base[j]
        for i in range(k):
            _contact(chain, state, goal, span, i, last[i] + last[i + 1], abs(moved[i]), up[i], down[i])
        drive = goal.drive if chain.force_driven else 0.0
        if not answer(
            offset, slope, up, down, drive, chain.force_driven, chain.weight, chain.pretension, tension, moved
        ):
            return -PASSES
        change = np.abs(tension - last).max()
        last[:] = tension
        if change < TOLERANCE_N or (chain.straight and done == 0):
            _relaxed(chain, state, goal, moved, tension, span)
            return done + 1
    return -PASSES


@njit(cache=True, nogil=True, error_model="numpy")
def _contact(chain, state, goal, span, i, total, slip, up, down):
    """Straighten what node i passes on, T_left = r T_right + f + d w: `up` if w > 0, `down` if w < 0.

    On the tangent of the sheath (a − b) cos(turn/2) = ± (grip (a + b) h(v) + floor + drag v).
    """
    cosine = math.cos(0.5 * goal.turns[i])
    pulling, releasing = grip(chain, goal.turns[i], state.travel[i], total, i)
    factor, extra = 1.0, 0.0
    if chain.by_speed and 0 < i < len(state.position) - 1:
        kept = math.exp(-span / chain.speed_lag) if chain.speed_lag > 0.0 else 0.0
        fresh = (1.0 - kept) / span
        factor, rise = speed_factor(kept * state.speed[i] + fresh * slip, chain.speed_law)
        factor -= rise * fresh * slip
        extra = rise * fresh * total
    g = pulling * factor
    d = chain.drag[i] / span + pulling * extra
    up[0], up[1], up[2] = (cosine + g) / (cosine - g), chain.floor[i] / (cosine - g), d / (cosine - g)
    g = releasing * factor
    d = chain.drag[i] / span + releasing * extra
    down[0], down[1], down[2] = (cosine - g) / (cosine + g), -chain.floor[i] / (cosine + g), d / (cosine + g)


@njit(cache=True, nogil=True, error_model="numpy")
def _offers(chain, state, rest, goal, span):
    """Return extension [m] of each bar if no node moves, and its compliance [m/N], creep included."""
    k = len(state.position)
    base, soft = rest + goal.growth - chain.expansion * goal.warmth, chain.compliance.copy()
    for j in range(k + 1):
        left = state.position[j - 1] if j > 0 else (0.0 if chain.force_driven else goal.drive)
        right = state.position[j] if j < k else 0.0
        base[j] += left - right
        for c in range(len(chain.creep_time)):
            kept, share_old, share_new = _creep_weights(span / chain.creep_time[c])
            base[j] -= kept * state.creep[j, c] + share_old * chain.creep_compliance[j, c] * state.tension[j]
            soft[j] += share_new * chain.creep_compliance[j, c]
    return base, soft


@njit(cache=True, nogil=True, error_model="numpy")
def _creep_weights(x):
    """Return weights of old creep, old and new tension; the tension is linear over x relaxation times."""
    kept = math.exp(-x)
    mean = -math.expm1(-x) / x
    return kept, mean - kept, 1.0 - mean


@njit(cache=True, nogil=True, error_model="numpy")
def _turn_of_bar(turns, j):
    return 0.5 * (turns[j - 1] + turns[j]) if 0 < j < len(turns) else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _relaxed(chain, state, goal, moved, tension, span):
    for c in range(len(chain.creep_time)):
        kept, share_old, share_new = _creep_weights(span / chain.creep_time[c])
        pulled = share_old * state.tension + share_new * tension
        state.creep[:, c] = kept * state.creep[:, c] + chain.creep_compliance[:, c] * pulled
    kept = math.exp(-span / chain.speed_lag) if chain.speed_lag > 0.0 else 0.0
    for i in range(len(moved)):
        loss = tension[i] - tension[i + 1]
        state.work[0] += 0.5 * (state.tension[i] - state.tension[i + 1] + loss) * moved[i]
        state.friction[i] = loss * math.cos(0.5 * goal.turns[i])
        state.position[i] += moved[i]
        state.slip[i] = moved[i]
        state.travel[i] += abs(moved[i])
        state.speed[i] = kept * state.speed[i] + (1.0 - kept) * abs(moved[i]) / span
    state.tension[:] = tension


@njit(cache=True, nogil=True, error_model="numpy")
def _rest(chain, state, turns):
    """Return the extension [m] of each bar in the pretensioned state, on its way of loading."""
    k = len(state.position)
    turn = np.zeros(k)
    turn[1:-1] = turns
    rest = np.zeros(k + 1)
    tension = chain.pretension
    for j in range(k + 1):
        gap = chain.clearance_per_turn * _turn_of_bar(turn, j)
        rest[j] = (chain.compliance[j] + chain.creep_compliance[j].sum()) * tension
        rest[j] -= chain.toe[j] * math.expm1(-tension / chain.toe_scale[j])
        rest[j] -= gap * math.expm1(-tension / chain.clearance_scale)
    return rest


@njit(cache=True, nogil=True, error_model="numpy")
def _between(before, after, share):
    if share >= 1.0:
        return after
    return Inputs(
        before.drive + share * (after.drive - before.drive),
        before.warmth + share * (after.warmth - before.warmth),
        before.growth + share * (after.growth - before.growth),
        before.turns + share * (after.turns - before.turns),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _record(records, row, state):
    tension, position, friction, slip, work = records
    tension[row] = state.tension
    position[row] = state.position
    friction[row] = state.friction
    slip[row] = state.slip
    work[row] = state.work[0]
