"""Equilibrium of a loaded tendon whose every contact may stick or slide: one step, any size.

The tendon is a chain of elastic bars between contacts. Bar 0 is what drives the proximal end, the last bar
what the distal end pulls against. A contact with movement w > 0 slides towards the proximal end and is on the
lower side of its friction cone, one with w < 0 on the upper side; inside it sticks. Who does what is found by
policy iteration on a tridiagonal M-matrix; docs/model.md (40)-(46). `chain` is a tuple of
trial [n+2], the tension of each bar if no contact moved, negative where it would be slack [N];
stiffness [n+2], 0 where the tension is given (force drive, dead weight) and at rigid ends [N/m];
low, high, force [n+1]: T[i+1] lies between low·T[i] − force and high·T[i] + force [1], [N];
drag [n+1], friction for each metre moved in this step [N/m];
rigid, shift: whether the proximal end moves by exactly `shift` [m], and whether the distal end is fixed.
"""

import numpy as np
from numba import njit

from tssgeom.tendon.bars.fixed_route import PULLED, RELEASED, STUCK, guess

ACCURACY = 1e-10
"""Largest residual of an accepted equilibrium, relative to the greatest tension [1]."""
PATIENCE = (np.int64(6), np.int64(10))  # no literals, for each of which a kernel would be compiled anew
"""Newton iterations from what slid last, then from what would slide on a fixed route; few steps need many."""
_REMARKS = 10  # times that slack bars are marked anew before the movements are relaxed
_ROUNDS = 7  # of relaxation, each four times as long as the one before
_EASE = 1e-3  # weight of movement against force; small, so that contacts stop before they turn round
_ROUNDING = 2e-15  # of stiffness times movement: what the solve itself leaves of a residual


@njit(cache=True, nogil=True, error_model="numpy")
def _solve(chain, slip, tight, w, ratios):
    """Solve the bar laws with every contact doing what `slip` says, for the movements w [m]."""
    trial, stiffness, low, high, force, drag, rigid, shift = chain
    nodes = slip.size
    for i in range(nodes):
        before, here, behind, right = 0.0, 1.0, 0.0, 0.0
        if i == 0 and rigid[0] and tight[0]:
            right = shift
        elif slip[i] != STUCK and not (i == nodes - 1 and rigid[1]):
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


@njit(cache=True, nogil=True, error_model="numpy")
def _linear(chain, w, j):
    """Return the tension of a bar by Hooke's law alone, negative where slack [N]; docs/model.md (40)."""
    near = w[j - 1] if j > 0 else 0.0
    far = w[j] if j < w.size else 0.0
    return chain[0][j] + chain[1][j] * (near - far)


@njit(cache=True, nogil=True, error_model="numpy")
def _tensions(chain, w, tension):
    """Set the tension of every bar from the movements, zero where it is slack."""
    trial, _, low, high, force, drag, rigid, shift = chain
    last = w.size - 1
    for j in range(last + 2):
        tension[j] = max(_linear(chain, w, j), 0.0)
    if rigid[0]:  # docs/model.md (45)
        most = (tension[1] + force[0] + drag[0] * w[0]) / low[0]
        least = max(tension[1] - force[0] + drag[0] * w[0], 0.0) / high[0]
        held = most if w[0] > 0.0 else least if w[0] < 0.0 else min(max(trial[0], least), most)
        tension[0] = 0.0 if w[0] > shift else held
    if rigid[1]:
        here = max(trial[last + 1], low[last] * tension[last] - force[last])
        tension[last + 1] = max(min(here, high[last] * tension[last] + force[last]), 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _excess(chain, w, i, near, far):
    """Return how far a contact is above both sides of its cone, and its movement, all as forces [N]."""
    _, stiffness, low, high, force, drag, rigid, _ = chain
    if i == 0 and rigid[0]:
        near = 0.0  # a rigid end is judged as if it were loose
    far += drag[i] * w[i]
    motion = _EASE * (stiffness[i] + stiffness[i + 1]) * w[i]
    return far - low[i] * near + force[i], far - high[i] * near - force[i], motion


@njit(cache=True, nogil=True, error_model="numpy")
def _judge(chain, w, tension, slip, tight, renew):
    """Return the greatest residual of the complementarity [N]; with `renew`, choose slip and tight anew."""
    rigid, shift = chain[6], chain[7]
    worst = 0.0
    for i in range(slip.size - 1 if rigid[1] else slip.size):
        over_low, over_high, motion = _excess(chain, w, i, tension[i], tension[i + 1])
        left = min(over_low, max(motion, over_high))  # docs/model.md (42)
        if i == 0 and rigid[0]:
            taut = chain[1][1] * (w[0] - shift)
            tight[0] = taut <= left if renew else tight[0]
            left = min(left, taut)
        worst = max(worst, abs(left) - _ROUNDING * (chain[1][i] + chain[1][i + 1]) * abs(w[i]))
        if renew:
            slip[i] = PULLED if over_low < motion else RELEASED if over_high > motion else STUCK
    if renew:
        _remark(chain, w, tight, ACCURACY * (np.max(tension) + 1e-9))
    return worst


@njit(cache=True, nogil=True, error_model="numpy")
def _remark(chain, w, tight, tie):
    """Mark anew which bars are tight; return whether any mark changed."""
    changed = False
    for j in range(1 if chain[6][0] else 0, tight.size):
        now = _linear(chain, w, j) >= -tie
        changed |= now != tight[j]
        tight[j] = now
    return changed


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
def _marked(chain, w, tight, i):
    """Return the excess of a contact with tight bars linear even below zero, and slack bars at zero [N]."""
    near = _linear(chain, w, i) if tight[i] else 0.0
    return _excess(chain, w, i, near, _linear(chain, w, i + 1) if tight[i + 1] else 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _released(chain, slip, tight, w, tie):
    """Choose anew who is released and who is stuck among those not pulled; return whether any changed."""
    changed = False
    for i in range(slip.size - 1 if chain[6][1] else slip.size):
        _, over_high, motion = _marked(chain, w, tight, i)
        if slip[i] == STUCK and over_high > tie + motion:
            slip[i], changed = RELEASED, True
        elif slip[i] == RELEASED and motion > tie + over_high:
            slip[i], changed = STUCK, True
    return changed


@njit(cache=True, nogil=True, error_model="numpy")
def _pulled(chain, slip, tight, w, tie):
    """Choose anew who is pulled, and whether a rigid drive is taut; return whether anything changed."""
    rigid, shift, changed = chain[6], chain[7], False
    for i in range(slip.size - 1 if rigid[1] else slip.size):
        over_low, over_high, motion = _marked(chain, w, tight, i)
        other = max(motion, over_high)
        if i == 0 and rigid[0]:
            taut = chain[1][1] * (w[0] - shift)
            if tight[0] != (taut <= min(over_low, other) + (tie if tight[0] else -tie)):
                tight[0], changed = not tight[0], True
        if slip[i] != PULLED and over_low < other - tie:
            slip[i], changed = PULLED, True
        elif slip[i] == PULLED and other < over_low - tie:
            slip[i], changed = RELEASED if over_high > motion else STUCK, True
    return changed


@njit(cache=True, nogil=True, error_model="numpy")
def _nested(chain, slip, tight, w, ratios, tie):
    """Solve by policy iteration within policy iteration, which cannot cycle; return the solves spent.

    The inner loop decides who is released, the outer one who is pulled, and every w is above the one before.
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


@njit(cache=True, nogil=True, error_model="numpy")
def _balance(near, far, stiff, side, kept, drag):
    """Return the movement [m] to one side of the cone; near and far without it, negative where slack [N]."""
    k_near, k_far = stiff
    move = (side * near + kept - far) / (k_far + side * k_near + drag)
    if move > 0.0 and far + k_far * move < 0.0 and side * k_near + drag > 0.0:  # the far bar stays slack
        return (side * near + kept) / (side * k_near + drag)
    if move < 0.0 and near - k_near * move < 0.0 and k_far + drag > 0.0:  # the near bar stays slack
        return (kept - far) / (k_far + drag)
    return move


@njit(cache=True, nogil=True, error_model="numpy")
def _relax(chain, w, sweeps):
    """Improve w by sweeps that balance one contact after the other, slowly but surely; docs/model.md (46)."""
    _, stiffness, low, high, force, drag, rigid, shift = chain
    last = w.size - 1
    w[last] = 0.0 if rigid[1] else w[last]
    for sweep in range(sweeps):
        for turn in range(w.size - 1 if rigid[1] else w.size):
            i = turn if sweep % 2 == 0 else (last - 1 if rigid[1] else last) - turn
            w[i] = 0.0
            near = 0.0 if i == 0 and rigid[0] else _linear(chain, w, i)
            far = _linear(chain, w, i + 1)
            stiff = (stiffness[i], stiffness[i + 1])
            if max(far, 0.0) < low[i] * max(near, 0.0) - force[i]:
                w[i] = max(_balance(near, far, stiff, low[i], -force[i], drag[i]), 0.0)
            elif max(far, 0.0) > high[i] * max(near, 0.0) + force[i]:
                w[i] = min(_balance(near, far, stiff, high[i], force[i], drag[i]), 0.0)
            if i == 0 and rigid[0]:
                w[0] = max(w[0], shift)


@njit(cache=True, nogil=True, error_model="numpy")
def _settle(chain, slip, w, tension):
    """Free the tensions on the cone from the rounding of the solve, and mark the rigid ends."""
    _, stiffness, low, high, force, drag, rigid, _ = chain
    if rigid[0]:
        slip[0] = PULLED if w[0] > 0.0 else RELEASED if w[0] < 0.0 else STUCK
    if rigid[1]:
        slip[-1] = STUCK
    for i in range(slip.size):
        if slip[i] != STUCK and tension[i + 1] > 0.0 and stiffness[i + 1] > 0.0:
            side = low[i] if slip[i] == PULLED else high[i]
            if w[i] != 0.0:
                tension[i + 1] = max(side * tension[i] - slip[i] * force[i] - drag[i] * w[i], 0.0)
            else:
                slip[i] = STUCK  # a mark left over from a bar that was taken for slack on the way


@njit(cache=True, nogil=True, error_model="numpy")
def equilibrium(chain, hanging, before, patience):
    """Return movements [n+1] [m], tensions [n+2] [N], slip [n+1] [1], the solves spent, and the residual [N].

    `hanging` says whether the last bar is a dead weight, `before` [n+1] is a guess: what each contact did in
    the last step. `patience` is as `PATIENCE`.
    """
    nodes = before.size
    tension, w, ratios = np.empty(nodes + 1), np.zeros(nodes), np.empty(nodes)
    slip, tight = before.copy(), np.ones(nodes + 1, dtype=np.bool_)
    scale = max(np.max(np.abs(chain[0])), 1e-6)
    accepted = ACCURACY * scale
    solves, residual = _newton(chain, slip, tight, w, tension, ratios, accepted, patience[0])
    if residual > accepted:
        guess(chain, hanging, tension, slip, tight)
        accepted = ACCURACY * max(scale, np.max(tension))
        more, residual = _newton(chain, slip, tight, w, tension, ratios, accepted, patience[1])
        solves += more
    for attempt in range(_ROUNDS):
        if residual <= accepted:
            break
        if attempt > 0:
            _relax(chain, w, 20 * 4**attempt)
            _tensions(chain, w, tension)
            _judge(chain, w, tension, slip, tight, True)
        for _ in range(_REMARKS):
            solves += _nested(chain, slip, tight, w, ratios, 0.01 * accepted)
            _tensions(chain, w, tension)
            residual = _judge(chain, w, tension, slip, tight, False)
            if residual <= accepted or not _remark(chain, w, tight, accepted):
                break
    _settle(chain, slip, w, tension)
    return w, tension, slip, solves, residual
