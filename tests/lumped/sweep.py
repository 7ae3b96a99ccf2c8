"""The chain answered exactly in one sweep, for straight laws, compiled.

From the proximal side, all that lies distal of a point is one curve: how far the point moves in this step, w,
against the tension T there. It rises, and is a polyline for straight laws. A bar adds its extension to w. A
node that sticks holds w = 0 over a range of tensions, so it pulls the curve apart there: what moves to the
proximal end is shifted to higher tensions, what moves to the distal end to lower ones. At the drive the
tension or the displacement picks the point of the last curve, and the way back gives every node. Nothing is
guessed, iterated or regularised.
"""

import numpy as np
from numba import njit

FAR_N, FAR_M = 1e5, 10.0  # where curves end: no tension and no motion of a run comes near

EDGE = 1e-11  # of the tension: this close to a limit the node slips, by w = 0 or, under a weight, by any w


@njit(cache=True, nogil=True, error_model="numpy")
def answer(offset, slope, up, down, drive, force_driven, weight, load, tension, moved):
    """Fill in tension [b] and motion [k] of this step; return whether there is an equilibrium.

    Bar j has w_left = w_right + offset_j + slope_j T_j while it is taut. Node i passes on
    T_left = up_i0 T_right + up_i1 + up_i2 w when w > 0, the same with `down` when w < 0.
    """
    k = len(moved)
    t, w = np.empty((2, 4 * k + 8)), np.empty((2, 4 * k + 8))
    held, loose = np.empty((k, 3)), np.empty(k + 1)
    size, here = _far_end(t[0], w[0], weight, load), 0
    for j in range(k, -1, -1):
        size, loose[j] = _bar(t[here], w[here], size, offset[j], slope[j])
        if j > 0:
            i = j - 1
            size, held[i, 0], held[i, 1], held[i, 2] = _node(t, w, size, here, up[i], down[i])
            here = 1 - here
    known = t[here, :size] if force_driven else w[here, :size]
    pull, left = _picked(t[here, :size], w[here, :size], known, drive)
    if pull > 0.0 and not (abs(left) < 0.5 * FAR_M and pull < 0.5 * FAR_N):
        return False
    _way_back(pull, left, offset, slope, up, down, held, loose, tension, moved)
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _far_end(t, w, weight, load):
    """A held end moves by 0 under any tension, a weight by anything under its own."""
    t[0], w[0] = (load, -FAR_M) if weight else (0.0, 0.0)
    t[1], w[1] = (load, FAR_M) if weight else (FAR_N, 0.0)
    return 2


@njit(cache=True, nogil=True, error_model="numpy")
def _bar(t, w, size, offset, slope):
    """Add a bar, which goes slack at no tension: the curve then falls straight down.

    Return the size of the curve, and where its right end rests when it is slack [m].
    """
    if t[0] > 0.0:  # a weight at the end: never slack
        w[:size] += offset + slope * t[:size]
        return size, 0.0
    first = 0
    while t[first + 1] <= 0.0:
        first += 1
    share = -t[first] / (t[first + 1] - t[first])
    loose = w[first] + share * (w[first + 1] - w[first])
    kept = size - first - 1
    if first == 0:  # one point more than before
        for m in range(kept, 0, -1):
            t[m + 1], w[m + 1] = t[m], w[m]
    elif first > 1:
        for m in range(kept):
            t[m + 2], w[m + 2] = t[first + 1 + m], w[first + 1 + m]
    w[2 : kept + 2] += offset + slope * t[2 : kept + 2]
    t[1], w[1] = 0.0, loose + offset
    t[0], w[0] = 0.0, min(-FAR_M, w[1])
    return kept + 2, loose


@njit(cache=True, nogil=True, error_model="numpy")
def _node(t, w, size, here, up, down):
    """Pull the curve apart at w = 0; return its size, the tension of rest and the range that it holds."""
    other = 1 - here
    m = 0
    while m < size and w[here, m] < 0.0:
        t[other, m] = down[0] * t[here, m] + down[1] + down[2] * w[here, m]
        w[other, m] = w[here, m]
        m += 1
    if m == 0:
        rest = t[here, 0]
    elif m == size:
        rest = t[here, size - 1]
    else:
        share = -w[here, m - 1] / (w[here, m] - w[here, m - 1])
        rest = t[here, m - 1] + share * (t[here, m] - t[here, m - 1])
    low, high = down[0] * rest + down[1], up[0] * rest + up[1]
    t[other, m], w[other, m] = low, 0.0
    t[other, m + 1], w[other, m + 1] = high, 0.0
    for n in range(m, size):
        t[other, n + 2] = up[0] * t[here, n] + up[1] + up[2] * w[here, n]
        w[other, n + 2] = w[here, n]
    return size + 2, rest, low, high


@njit(cache=True, nogil=True, error_model="numpy")
def _picked(t, w, known, drive):
    """Return tension and motion where the last curve has the drive's tension [N] or displacement [m]."""
    m = 1
    while m < len(t) - 1 and known[m] < drive:
        m += 1
    gap = known[m] - known[m - 1]
    share = (drive - known[m - 1]) / gap if gap > 0.0 else 1.0
    return t[m - 1] + share * (t[m] - t[m - 1]), w[m - 1] + share * (w[m] - w[m - 1])


@njit(cache=True, nogil=True, error_model="numpy")
def _way_back(pull, left, offset, slope, up, down, held, loose, tension, moved):
    """Go to the far end from the drive's tension and motion; `held` is tension of rest and limits, [k, 3]."""
    for j in range(len(moved)):
        tension[j] = max(pull, 0.0)
        moved[j] = left - offset[j] - slope[j] * pull if pull > 0.0 else loose[j]
        below, above = pull <= held[j, 1] + EDGE * pull, pull >= held[j, 2] - EDGE * pull
        if not below and not above:
            moved[j], pull = 0.0, held[j, 0]
        else:
            if below != above:
                moved[j] = min(moved[j], 0.0) if below else max(moved[j], 0.0)
            law = down[j] if moved[j] < 0.0 or not above else up[j]
            pull = (pull - law[1] - law[2] * moved[j]) / law[0]
        left = moved[j]
    tension[-1] = max(pull, 0.0)
