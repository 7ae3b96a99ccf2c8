"""Slow twin of the equilibrium of a chain of bars; docs/model.md (40)-(47), (279)."""

import numpy as np

from tests.core.twins.tendon_chain import PULLED, RELEASED, STUCK, guess
from tssgeom.core.constants import ROUNDING
from tssgeom.core.constants_tendon import SOLVER


def _solve(chain, slip, tight, w, ratios):
    """Solve the bar laws with every contact in the state of `slip`, for the movements w [m]."""
    trial, stiffness, low, high = chain.trial, chain.stiffness, chain.low, chain.high
    force, drag, bristle, kept = chain.force, chain.drag, chain.bristle, chain.kept
    nodes = slip.size
    for i in range(nodes):
        before, here, behind, right = 0.0, 1.0, 0.0, 0.0
        if i == 0 and chain.rigid_in and tight[0]:
            right = chain.shift
        elif i == nodes - 1 and chain.rigid_out:
            pass
        elif slip[i] == STUCK and bristle[i] < np.inf:  # docs/model.md (279)
            near, far = stiffness[i] * tight[i], stiffness[i + 1] * tight[i + 1]
            if near + far + bristle[i] > 0.0:
                before, here, behind = -near, near + far + bristle[i], -far
                right = -kept[i] + (trial[i] if tight[i] else 0.0) - (trial[i + 1] if tight[i + 1] else 0.0)
        elif slip[i] != STUCK:
            side = low[i] if slip[i] == PULLED else high[i]
            near = side * stiffness[i] if tight[i] else 0.0
            far = stiffness[i + 1] if tight[i + 1] else 0.0
            if near + far + drag[i] > 0.0:
                before, here, behind = -near, near + far + drag[i], -far  # docs/model.md (43)
                right = -slip[i] * force[i]
                right += side * trial[i] if tight[i] else 0.0
                right -= trial[i + 1] if tight[i + 1] else 0.0
        if i > 0:
            here -= before * ratios[i - 1]
            right -= before * w[i - 1]
        if here <= 0.0:  # slack all around: any movement will do
            behind, here, right = 0.0, 1.0, 0.0
        ratios[i] = behind / here
        w[i] = right / here
    for i in range(nodes - 2, -1, -1):
        w[i] -= ratios[i] * w[i + 1]


def _linear(chain, w, j):
    """Return the tension of a bar by Hooke's law alone, negative where slack [N]; docs/model.md (40)."""
    near = w[j - 1] if j > 0 else 0.0
    far = w[j] if j < w.size else 0.0
    return chain.trial[j] + chain.stiffness[j] * (near - far)


def _tensions(chain, w, tension):
    """Set the tension of every bar from the movements, zero where it is slack."""
    trial, low, high, force, drag = chain.trial, chain.low, chain.high, chain.force, chain.drag
    last = w.size - 1
    for j in range(last + 2):
        tension[j] = max(_linear(chain, w, j), 0.0)
    if chain.rigid_in:  # docs/model.md (45)
        most = (tension[1] + force[0] + drag[0] * w[0]) / low[0]
        least = max(tension[1] - force[0] + drag[0] * w[0], 0.0) / high[0]
        held = most if w[0] > 0.0 else least if w[0] < 0.0 else min(max(trial[0], least), most)
        if chain.bristle[0] < np.inf:
            held = min(max(tension[1] + chain.kept[0] + chain.bristle[0] * w[0], least), most)
        tension[0] = 0.0 if w[0] > chain.shift else held
    if chain.rigid_out:
        still = trial[last + 1] if chain.bristle[last] == np.inf else tension[last] - chain.kept[last]
        here = max(still, low[last] * tension[last] - force[last])
        tension[last + 1] = max(min(here, high[last] * tension[last] + force[last]), 0.0)


def _excess(chain, w, i, near, far):
    """Return how far a contact is above both sides of its cone, and its movement, all as forces [N]."""
    stiffness, force = chain.stiffness, chain.force
    if i == 0 and chain.rigid_in:
        near = 0.0  # a rigid end is judged as if it were loose
    motion = SOLVER.motion * (stiffness[i] + stiffness[i + 1]) * w[i]
    if chain.bristle[i] < np.inf:
        motion = far - near + chain.kept[i] + chain.bristle[i] * w[i]
    far += chain.drag[i] * w[i]
    return far - chain.low[i] * near + force[i], far - chain.high[i] * near - force[i], motion


def _judge(chain, w, tension, slip, tight, renew):
    """Return the greatest residual of the complementarity [N]; with `renew`, choose slip and tight anew."""
    stiffness, worst = chain.stiffness, 0.0
    for i in range(slip.size - 1 if chain.rigid_out else slip.size):
        over_low, over_high, motion = _excess(chain, w, i, tension[i], tension[i + 1])
        left = min(over_low, max(motion, over_high))  # docs/model.md (42)
        if i == 0 and chain.rigid_in:
            taut = stiffness[1] * (w[0] - chain.shift)
            tight[0] = taut <= left if renew else tight[0]
            left = min(left, taut)
        stiff = stiffness[i] + stiffness[i + 1] + (chain.bristle[i] if chain.bristle[i] < np.inf else 0.0)
        worst = max(worst, abs(left) - ROUNDING.single * stiff * abs(w[i]))
        if renew:
            slip[i] = PULLED if over_low < motion else RELEASED if over_high > motion else STUCK
    if renew:
        _marked_anew(chain, w, tight, SOLVER.accuracy * (np.max(tension) + 1e-9))
    return worst


def _marked_anew(chain, w, tight, tie):
    """Mark anew which bars are tight; return whether any mark changed."""
    changed = False
    for j in range(1 if chain.rigid_in else 0, tight.size):
        now = _linear(chain, w, j) >= -tie
        changed |= now != tight[j]
        tight[j] = now
    return changed


def _newton(chain, slip, tight, w, tension, ratios, accepted, patience):
    """Return the solves spent and the residual of the semi-smooth Newton iteration."""
    residual = np.inf
    for turn in range(patience):
        if turn > 0:
            _judge(chain, w, tension, slip, tight, True)
        _solve(chain, slip, tight, w, ratios)
        _tensions(chain, w, tension)
        residual = _judge(chain, w, tension, slip, tight, False)
        if residual <= accepted:
            return turn + 1, residual
    return patience, residual


def _marked(chain, w, tight, i):
    """Return the excess of a contact with tight bars linear even below zero, and slack bars at zero [N]."""
    near = _linear(chain, w, i) if tight[i] else 0.0
    return _excess(chain, w, i, near, _linear(chain, w, i + 1) if tight[i + 1] else 0.0)


def _released(chain, slip, tight, w, tie):
    """Choose anew which contacts that are not pulled are released; return whether any changed."""
    changed = False
    for i in range(slip.size - 1 if chain.rigid_out else slip.size):
        _, over_high, motion = _marked(chain, w, tight, i)
        if slip[i] == STUCK and over_high > tie + motion:
            slip[i], changed = RELEASED, True
        elif slip[i] == RELEASED and motion > tie + over_high:
            slip[i], changed = STUCK, True
    return changed


def _pulled(chain, slip, tight, w, tie):
    """Choose anew which contacts are pulled, and whether a rigid drive is taut; return if any changed."""
    changed = False
    for i in range(slip.size - 1 if chain.rigid_out else slip.size):
        over_low, over_high, motion = _marked(chain, w, tight, i)
        other = max(motion, over_high)
        if i == 0 and chain.rigid_in:
            taut = chain.stiffness[1] * (w[0] - chain.shift)
            if tight[0] != (taut <= min(over_low, other) + (tie if tight[0] else -tie)):
                tight[0], changed = not tight[0], True
        if slip[i] != PULLED and over_low < other - tie:
            slip[i], changed = PULLED, True
        elif slip[i] == PULLED and other < over_low - tie:
            slip[i], changed = RELEASED if over_high > motion else STUCK, True
    return changed


def _nested(chain, slip, tight, w, ratios, tie):
    """Solve by policy iteration within policy iteration, which cannot cycle; return the solves spent.

    The inner loop decides what is released, the outer one what is pulled, and each w is above the one before.
    Slack bars stay as they are marked. Source: docs/model.md (46).
    """
    solves = 0
    for _ in range(4 * slip.size):
        for _ in range(4 * slip.size):
            _solve(chain, slip, tight, w, ratios)
            solves += 1
            if not _released(chain, slip, tight, w, tie):
                break
        if not _pulled(chain, slip, tight, w, tie):
            break
    return solves


def _balance(near, far, stiff, side, kept, drag):
    """Return the movement [m] to one side of the cone; near and far without it, negative where slack [N]."""
    k_near, k_far = stiff
    move = (side * near + kept - far) / (k_far + side * k_near + drag)
    if move > 0.0 and far + k_far * move < 0.0 and side * k_near + drag > 0.0:  # the far bar stays slack
        return (side * near + kept) / (side * k_near + drag)
    if move < 0.0 and near - k_near * move < 0.0 and k_far + drag > 0.0:  # the near bar stays slack
        return (kept - far) / (k_far + drag)
    return move


def _relax(chain, w, sweeps):
    """Improve w by sweeps that balance one contact after the other, slowly but surely; docs/model.md (46)."""
    stiffness, low, high, force, drag = chain.stiffness, chain.low, chain.high, chain.force, chain.drag
    last = w.size - 1
    w[last] = 0.0 if chain.rigid_out else w[last]
    free = w.size - 1 if chain.rigid_out else w.size
    for sweep in range(sweeps):
        for turn in range(free):
            i = turn if sweep % 2 == 0 else free - 1 - turn
            w[i] = 0.0
            near = 0.0 if i == 0 and chain.rigid_in else _linear(chain, w, i)
            far = _linear(chain, w, i + 1)
            stiff = (stiffness[i], stiffness[i + 1])
            if chain.bristle[i] < np.inf:
                still = _balance(near, far, stiff, 1.0, -chain.kept[i], chain.bristle[i])
                released = _balance(near, far, stiff, high[i], force[i], drag[i])
                pulled = _balance(near, far, stiff, low[i], -force[i], drag[i])
                w[i] = max(pulled, min(still, released))
            elif max(far, 0.0) < low[i] * max(near, 0.0) - force[i]:
                w[i] = max(_balance(near, far, stiff, low[i], -force[i], drag[i]), 0.0)
            elif max(far, 0.0) > high[i] * max(near, 0.0) + force[i]:
                w[i] = min(_balance(near, far, stiff, high[i], force[i], drag[i]), 0.0)
            if i == 0 and chain.rigid_in:
                w[0] = max(w[0], chain.shift)


def _freed_from_rounding(chain, slip, w, tension):
    """Free the tensions on the cone from the rounding of the solve, and mark the rigid ends."""
    if chain.rigid_in:
        over = w[0]
        if chain.bristle[0] < np.inf:
            over = tension[1] + chain.kept[0] + chain.bristle[0] * w[0] - tension[0]
            over *= abs(over) > ROUNDING.relative * tension[0]
        slip[0] = PULLED if over > 0.0 else RELEASED if over < 0.0 else STUCK
    if chain.rigid_out:
        slip[-1] = STUCK
    for i in range(slip.size):
        if slip[i] != STUCK and tension[i + 1] > 0.0 and chain.stiffness[i + 1] > 0.0:
            side = chain.low[i] if slip[i] == PULLED else chain.high[i]
            if w[i] != 0.0 or chain.bristle[i] < np.inf:
                here = side * tension[i] - slip[i] * chain.force[i] - chain.drag[i] * w[i]
                tension[i + 1] = max(here, 0.0)
            else:
                slip[i] = STUCK  # a mark left over from a bar that was taken for slack on the way


def equilibrium(chain, hanging, before, patience):
    """Return movements [n+1] [m], tensions [n+2] [N], slip [n+1] [1], the solves spent, and the residual [N].

    `hanging` is true where the last bar is a dead weight, `before` [n+1] is a guess: what each contact did in
    the last step. `patience` is as `PATIENCE`.
    """
    nodes = before.size
    tension, w, ratios = np.empty(nodes + 1), np.zeros(nodes), np.empty(nodes)
    slip, tight = before.copy(), np.ones(nodes + 1, dtype=np.bool_)
    scale = max(np.max(np.abs(chain.trial)), 1e-6)
    accepted = SOLVER.accuracy * scale
    solves, residual = _newton(chain, slip, tight, w, tension, ratios, accepted, patience[0])
    if residual > accepted:
        guess(chain, hanging, tension, slip, tight)
        accepted = SOLVER.accuracy * max(scale, np.max(tension))
        more, residual = _newton(chain, slip, tight, w, tension, ratios, accepted, patience[1])
        solves += more
    for attempt in range(SOLVER.rounds):
        if residual <= accepted:
            break
        if attempt > 0:
            _relax(chain, w, 20 * 4**attempt)
            _tensions(chain, w, tension)
            _judge(chain, w, tension, slip, tight, True)
        for _ in range(SOLVER.from_guess):
            solves += _nested(chain, slip, tight, w, ratios, 0.01 * accepted)
            _tensions(chain, w, tension)
            residual = _judge(chain, w, tension, slip, tight, False)
            if residual <= accepted or not _marked_anew(chain, w, tight, accepted):
                break
    _freed_from_rounding(chain, slip, w, tension)
    return w, tension, slip, solves, residual
