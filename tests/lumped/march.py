"""The chain in time, compiled: each step is a backward Euler step of all nodes, solved by Newton on displacements.

Nothing here knows a closed form of the tension along a sheath. A node is in balance when the two bars and the bristle,
projected on the tangent of the sheath, add to zero; the contact force is what the two bars press into it.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from tests.lumped.contact import SLACK_N, bristle, pull

TOLERANCE_N = 1e-8  # of the balance at each node; displacements of 1e-2 m round to some 1e-9 N
ITERATIONS = (
    40  # and two for each node, since a front may pass them all; more than that and the step is halved
)
HALVINGS = 12


class State(NamedTuple):
    """What a step leaves to the next."""

    place: np.ndarray  # [k] displacement of the nodes, towards the proximal end [m]
    tension: np.ndarray  # [b] N
    friction: np.ndarray  # [k] force of the bristle against motion to the proximal end [N]
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


@njit(cache=True, nogil=True)
def march(chain, times, drive, warmth, frame, weight, growth, turns, keep, records):
    """Run the chain over `times` [g] and write the kept ones into `records`; return how many steps and iterations.

    A negative number of steps tells the grid point where no balance was found.
    """
    state = start(chain, turns[0])
    now = inputs(chain, drive[0], warmth[0], frame[0], weight[0], growth, turns)
    rest = _rest(chain, state, turns[0])
    steps, iterations, kept = 0, 0, 0
    before = now
    for g in range(len(times)):
        span = times[g] - times[g - 1] if g > 0 else times[1] - times[0]
        after = inputs(chain, drive[g], warmth[g], frame[g], weight[g], growth, turns)
        done, part = 0.0, 1.0
        while done < 1.0:
            goal = min(done + part, 1.0)
            used = advance(chain, state, rest, _between(before, after, goal), (goal - done) * span)
            steps += 1
            iterations += abs(used)
            if used >= 0:
                done = goal
            else:
                part *= 0.5
                if part < 0.5**HALVINGS:
                    return -g - 1, iterations
        if keep[g]:
            _record(records, kept, state)
            kept += 1
        before = after
    return steps, iterations


@njit(cache=True, nogil=True)
def start(chain, turns):
    """Return the pretensioned state: one tension, no friction, creep at rest."""
    k, c = len(chain.bristle), len(chain.creep_time)
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


@njit(cache=True, nogil=True)
def inputs(chain, drive, warmth, frame, weight, growth, turns):
    """Return what is imposed between two frames of the path."""
    after = min(frame + 1, len(turns) - 1)
    k = len(chain.bristle)
    longer, turn = np.zeros(k + 1), np.zeros(k)
    longer[1:-1] = (1.0 - weight) * growth[frame] + weight * growth[after]
    turn[1:-1] = (1.0 - weight) * turns[frame] + weight * turns[after]
    return Inputs(drive, warmth, longer, turn)


@njit(cache=True, nogil=True)
def advance(chain, state, rest, goal, span):
    """Bring the state to the imposed values after `span` [s]; return iterations, negative where there is no balance."""
    k = len(state.place)
    base, soft = _offers(chain, state, rest, goal, span)
    lagged, fresh = 0.0, 1.0 / span
    keep = 0.0
    if chain.speed_lag > 0.0:
        keep = math.exp(-span / chain.speed_lag)
        fresh = (1.0 - keep) / span
    moved = np.zeros(k)
    tension, stiffness = np.empty(k + 1), np.empty(k + 1)
    force, slip = np.empty(k), np.empty(k)
    rest_r, low, diag, high = np.empty(k), np.empty(k), np.empty(k), np.empty(k)
    limit = ITERATIONS + 2 * k
    for iteration in range(limit):
        _pull_all(chain, goal, base, soft, moved, tension, stiffness)
        worst = 0.0
        for i in range(k):
            lagged = keep * state.speed[i]
            a, b = tension[i], tension[i + 1]
            trial = state.friction[i] + chain.bristle[i] * moved[i]
            coulomb, gain = _coulomb(chain, state, goal, i, a, b, trial >= 0.0)
            drag = chain.drag[i] / span
            force[i], by_place, by_coulomb, slip[i] = bristle(
                trial, chain.bristle[i], coulomb, chain.floor[i], drag, lagged, fresh, _law(chain, i)
            )
            cosine = math.cos(0.5 * goal.turns[i])
            rest_r[i] = cosine * (a - b) - force[i]
            worst = max(worst, abs(rest_r[i]))
            by_a, by_b = cosine - by_coulomb * gain, -cosine - by_coulomb * gain
            low[i] = by_a * stiffness[i]
            high[i] = -by_b * stiffness[i + 1]
            diag[i] = (
                -by_a * stiffness[i] + by_b * stiffness[i + 1] - by_place - 1e-9 * chain.bristle[i] / 1e4
            )
        if worst < TOLERANCE_N:
            _settle(chain, state, goal, moved, tension, force, slip, keep, span)
            return iteration
        change = _thomas(low, diag, high, rest_r)
        for i in range(k):
            moved[i] -= change[i]
    return -limit


@njit(cache=True, nogil=True)
def _offers(chain, state, rest, goal, span):
    """Return extension [m] each bar has if no node moves, and its compliance [m/N] creep of this step included."""
    k = len(state.place)
    base, soft = rest + goal.growth - chain.expansion * goal.warmth, chain.compliance.copy()
    for j in range(k + 1):
        left = state.place[j - 1] if j > 0 else (0.0 if chain.force_driven else goal.drive)
        right = state.place[j] if j < k else 0.0
        base[j] += left - right
        for c in range(len(chain.creep_time)):
            kept, share_old, share_new = _creep_weights(span / chain.creep_time[c])
            base[j] -= kept * state.creep[j, c] + share_old * chain.creep_compliance[j, c] * state.tension[j]
            soft[j] += share_new * chain.creep_compliance[j, c]
    return base, soft


@njit(cache=True, nogil=True)
def _creep_weights(x):
    """Return the weights of old creep, old and new tension for a tension linear over a step of x relaxation times."""
    kept = math.exp(-x)
    mean = -math.expm1(-x) / x
    return kept, mean - kept, 1.0 - mean


@njit(cache=True, nogil=True)
def _pull_all(chain, goal, base, soft, moved, tension, stiffness):
    k = len(moved)
    for j in range(k + 1):
        extension = base[j] + (moved[j - 1] if j > 0 else 0.0) - (moved[j] if j < k else 0.0)
        gap = chain.gap_per_turn * _turn_of_bar(goal.turns, j)
        tension[j], stiffness[j] = pull(
            extension, soft[j], chain.toe[j], chain.toe_scale[j], gap, chain.gap_scale
        )
    if chain.force_driven:
        tension[0], stiffness[0] = max(goal.drive, SLACK_N), 0.0
    if chain.weight:
        tension[k], stiffness[k] = chain.pretension, 0.0


@njit(cache=True, nogil=True)
def _turn_of_bar(turns, j):
    return 0.5 * (turns[j - 1] + turns[j]) if 0 < j < len(turns) else 0.0


@njit(cache=True, nogil=True)
def _coulomb(chain, state, goal, i, a, b, pulling):
    """Return the Coulomb limit [N] of a node between tensions a and b, and its derivative by either of them [1]."""
    if i == 0 or i == len(state.place) - 1:
        return 0.5 * chain.friction[i] * (a + b), 0.5 * chain.friction[i]
    press = math.sin(
        0.5 * goal.turns[i]
    )  # of two bars that pull with a and b: contact force (a + b) sin(turn/2)
    grip = chain.friction[i] * press * (1.0 + chain.asymmetry * (1.0 if pulling else -1.0))
    grip *= 1.0 + chain.curvature_gain * goal.turns[i] / chain.share[i]
    if chain.wear_gain != 0.0:
        grip *= 1.0 - chain.wear_gain * math.expm1(-state.travel[i] / chain.wear_travel)
    if chain.load_exponent == 0.0 or press == 0.0:
        return grip * (a + b), grip
    load = max(0.5 * (a + b), SLACK_N)
    scale = (2.0 * press / chain.share[i] if chain.load_is_normal else 1.0) / chain.load_reference
    grip *= (load * scale) ** chain.load_exponent
    return grip * (a + b), grip * (1.0 + chain.load_exponent)


@njit(cache=True, nogil=True)
def _law(chain, i):
    return chain.speed_law if 0 < i < len(chain.bristle) - 1 else (0.0, 1.0, 0.0, 1.0)


@njit(cache=True, nogil=True)
def _settle(chain, state, goal, moved, tension, force, slip, keep, span):
    for j in range(len(tension)):
        for c in range(len(chain.creep_time)):
            kept, share_old, share_new = _creep_weights(span / chain.creep_time[c])
            pulled = share_old * state.tension[j] + share_new * tension[j]
            state.creep[j, c] = kept * state.creep[j, c] + chain.creep_compliance[j, c] * pulled
        state.tension[j] = tension[j]
    for i in range(len(moved)):
        state.work[0] += 0.5 * (state.friction[i] + force[i]) * slip[i]
        state.place[i] += moved[i]
        state.friction[i] = force[i]
        state.slip[i] = slip[i]
        state.travel[i] += abs(slip[i])
        state.speed[i] = keep * state.speed[i] + (1.0 - keep) * abs(slip[i]) / span


@njit(cache=True, nogil=True)
def _rest(chain, state, turns):
    """Return the extension [m] of each bar in the pretensioned state, on its way of loading."""
    k = len(state.place)
    turn = np.zeros(k)
    turn[1:-1] = turns
    rest = np.zeros(k + 1)
    tension = chain.pretension
    for j in range(k + 1):
        gap = chain.gap_per_turn * _turn_of_bar(turn, j)
        rest[j] = (chain.compliance[j] + chain.creep_compliance[j].sum()) * tension
        rest[j] -= chain.toe[j] * math.expm1(-tension / chain.toe_scale[j])
        rest[j] -= gap * math.expm1(-tension / chain.gap_scale)
    return rest


@njit(cache=True, nogil=True)
def _between(before, after, share):
    if share >= 1.0:
        return after
    return Inputs(
        before.drive + share * (after.drive - before.drive),
        before.warmth + share * (after.warmth - before.warmth),
        before.growth + share * (after.growth - before.growth),
        before.turns + share * (after.turns - before.turns),
    )


@njit(cache=True, nogil=True)
def _thomas(low, diag, high, right):
    """Solve a tridiagonal system; the chain's has no need of pivots."""
    k = len(diag)
    solution, above = np.empty(k), np.empty(k)
    above[0], solution[0] = high[0] / diag[0], right[0] / diag[0]
    for i in range(1, k):
        pivot = diag[i] - low[i] * above[i - 1]
        above[i] = high[i] / pivot
        solution[i] = (right[i] - low[i] * solution[i - 1]) / pivot
    for i in range(k - 2, -1, -1):
        solution[i] -= above[i] * solution[i + 1]
    return solution


@njit(cache=True, nogil=True)
def _record(records, row, state):
    tension, place, friction, slip, work = records
    tension[row] = state.tension
    place[row] = state.place
    friction[row] = state.friction
    slip[row] = state.slip
    work[row] = state.work[0]
