"""A chain of circular arcs: places, exact derivatives, and the normal equations of fitting it to points.

The chain starts at a place with axes (tangent and two normals, carried along without twist). Piece j runs
from arc length b_j to b_j+1 with constant curvature components K_j on the normals, so a straight piece and a
change of the bending plane are regular points. The last piece goes on as long as it is asked to.

Changing anything before a point moves the point by a rigid twist (a, θ): δx = a + θ × x. The normal equations
therefore need of each piece only the 6 by 6 moments of its points, and cost O(points + pieces²); see
docs/model.md (30) to (32).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def _arc_functions(q: float) -> tuple[float, float, float, float, float]:
    """Functions of q = θ²: sin θ/θ, (1 - cos θ)/θ², (θ - sin θ)/θ³, and derivatives of the first two."""
    if q < 1e-3:
        a = 1 - q / 6 * (1 - q / 20 * (1 - q / 42))
        b = 0.5 * (1 - q / 12 * (1 - q / 30 * (1 - q / 56)))
        c = (1 - q / 20 * (1 - q / 42 * (1 - q / 72))) / 6
        da = -(1 - q / 10 * (1 - q / 28 * (1 - q / 54))) / 6
        db = -(1 - q / 15 * (1 - q / 37.333333333333336 * (1 - q / 67.5))) / 24
        return a, b, c, da, db
    t = math.sqrt(q)
    a, cos = math.sin(t) / t, math.cos(t)
    half = math.sin(0.5 * t)
    b = 2 * half * half / q
    return a, b, (1 - a) / q, 0.5 * (cos - a) / q, (0.5 * a - b) / q


@njit(cache=True, nogil=True)
def _place(k0: float, k1: float, s: float, out: np.ndarray) -> None:
    """Place [3] at arc length s of one arc, in the axes at its start."""
    a, b, _, _, _ = _arc_functions((k0 * k0 + k1 * k1) * s * s)
    out[0] = s * a
    out[1] = s * s * b * k0
    out[2] = s * s * b * k1


@njit(cache=True, nogil=True)
def _place_by_kappa(k0: float, k1: float, s: float, out: np.ndarray) -> None:
    """Differentiate `_place` with respect to both curvature components, [2, 3]."""
    _, b, _, da, db = _arc_functions((k0 * k0 + k1 * k1) * s * s)
    s2, s3 = s * s, s * s * s
    for c in range(2):
        k = k0 if c == 0 else k1
        out[c, 0] = 2 * s3 * da * k
        out[c, 1] = 2 * s2 * s2 * db * k * k0
        out[c, 2] = 2 * s2 * s2 * db * k * k1
        out[c, 1 + c] += s2 * b


@njit(cache=True, nogil=True)
def _axes_after(k0: float, k1: float, s: float, axes: np.ndarray, out: np.ndarray) -> None:
    """Axes [3, 3] after arc length s, carried without twist."""
    q = (k0 * k0 + k1 * k1) * s * s
    a, b, _, _, _ = _arc_functions(q)
    w0, w1 = k0 * s, k1 * s
    for i in range(3):
        t, e0, e1 = axes[0, i], axes[1, i], axes[2, i]
        out[0, i] = (1 - b * q) * t + a * (w0 * e0 + w1 * e1)
        out[1, i] = e0 - a * w0 * t - b * w0 * (w0 * e0 + w1 * e1)
        out[2, i] = e1 - a * w1 * t - b * w1 * (w0 * e0 + w1 * e1)


@njit(cache=True, nogil=True)
def joint_frames(
    start: np.ndarray, axes: np.ndarray, joints: np.ndarray, bend: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Place [k, 3] and axes [k, 3, 3] at the start of every piece."""
    k = len(bend)
    place, frame = np.empty((k, 3)), np.empty((k, 3, 3))
    place[0], frame[0] = start, axes
    step = np.empty(3)
    for j in range(1, k):
        length = joints[j] - joints[j - 1]
        _place(bend[j - 1, 0], bend[j - 1, 1], length, step)
        place[j] = place[j - 1]
        for i in range(3):
            for c in range(3):
                place[j, i] += step[c] * frame[j - 1, c, i]
        _axes_after(bend[j - 1, 0], bend[j - 1, 1], length, frame[j - 1], frame[j])
    return place, frame


@njit(cache=True, nogil=True)
def piece_of(joints: np.ndarray, s: float, guess: int) -> int:
    """Piece that holds arc length s; whatever lies beyond the ends belongs to the first or last piece."""
    k = len(joints)
    while guess + 1 < k and s >= joints[guess + 1]:
        guess += 1
    while guess > 0 and s < joints[guess]:
        guess -= 1
    return guess


@njit(cache=True, nogil=True)
def along(
    s: np.ndarray, start: np.ndarray, axes: np.ndarray, joints: np.ndarray, bend: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Place [n, 3], unit tangent [n, 3] and curvature vector [n, 3] at arc lengths `s` [n]."""
    place, frame = joint_frames(start, axes, joints, bend)
    x, t, curvature = np.empty((len(s), 3)), np.empty((len(s), 3)), np.empty((len(s), 3))
    step, turned = np.empty(3), np.empty((3, 3))
    j = 0
    for i in range(len(s)):
        j = piece_of(joints, s[i], j)
        _place(bend[j, 0], bend[j, 1], s[i] - joints[j], step)
        _axes_after(bend[j, 0], bend[j, 1], s[i] - joints[j], frame[j], turned)
        for c in range(3):
            x[i, c] = place[j, c]
            for d in range(3):
                x[i, c] += step[d] * frame[j, d, c]
            t[i, c] = turned[0, c]
            curvature[i, c] = bend[j, 0] * turned[1, c] + bend[j, 1] * turned[2, c]
    return x, t, curvature


@njit(cache=True, nogil=True)
def project(
    p: np.ndarray,
    s: np.ndarray,
    start: np.ndarray,
    axes: np.ndarray,
    joints: np.ndarray,
    bend: np.ndarray,
    reach: float,
) -> None:
    """Move the stations `s` [n], in place, towards the feet of the points [n, 3], by at most `reach`."""
    x, t, curvature = along(s, start, axes, joints, bend)
    for i in range(len(s)):
        ahead, aside = 0.0, 0.0
        for c in range(3):
            ahead += (p[i, c] - x[i, c]) * t[i, c]
            aside += (p[i, c] - x[i, c]) * curvature[i, c]
        s[i] += min(max(ahead / max(1.0 - aside, 0.3), -reach), reach)


@njit(cache=True, nogil=True)
def _twist_of_turn(theta: np.ndarray, centre: np.ndarray, out: np.ndarray) -> None:
    """Twist of a turn θ about a centre: a = -θ × centre."""
    out[0] = -(theta[1] * centre[2] - theta[2] * centre[1])
    out[1] = -(theta[2] * centre[0] - theta[0] * centre[2])
    out[2] = -(theta[0] * centre[1] - theta[1] * centre[0])
    out[3:6] = theta


@njit(cache=True, nogil=True)
def _twists(
    place: np.ndarray,
    frame: np.ndarray,
    joints: np.ndarray,
    bend: np.ndarray,
    curved: np.ndarray,
    free: bool,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Twist [m, 6] of every parameter, the first piece it moves [m], and the piece it bends [m] (or -1).

    Parameters in order: the start (3 coordinates, or 2 across where `free`, since stations then slide along),
    turns about both normals, inner joints, curvature components of the curved pieces.
    """
    k = len(bend)
    shifts = 2 if free else 3
    m = shifts + 2 + (k - 1) + 2 * int(curved.sum())
    twist = np.zeros((m, 6))
    first, own = np.zeros(m, dtype=np.int64), np.full(m, -1)
    for c in range(shifts):
        if free:
            twist[c, :3] = frame[0, 1 + c]
        else:
            twist[c, c] = 1.0
    for c in range(2):
        _twist_of_turn(frame[0, 1 + c].copy(), place[0], twist[shifts + c])
    row = shifts + 2
    theta = np.empty(3)
    for j in range(1, k):
        d0, d1 = bend[j - 1, 0] - bend[j, 0], bend[j - 1, 1] - bend[j, 1]
        for i in range(3):  # t × e1 = e2, t × e2 = -e1
            theta[i] = d0 * frame[j, 2, i] - d1 * frame[j, 1, i]
        _twist_of_turn(theta, place[j], twist[row])
        first[row] = j
        row += 1
    moved = np.empty((2, 3))
    for j in range(k):
        if not curved[j]:
            continue
        length = joints[j + 1] - joints[j] if j + 1 < k else 0.0
        q = (bend[j, 0] ** 2 + bend[j, 1] ** 2) * length * length
        _, b, c3, _, _ = _arc_functions(q)
        a = 1.0 - q * c3
        _place_by_kappa(bend[j, 0], bend[j, 1], length, moved)
        w1, w2 = -bend[j, 1] * length, bend[j, 0] * length  # rotation vector on (t, e1, e2): (0, w1, w2)
        for c in range(2):
            v1, v2 = (0.0, length) if c == 0 else (-length, 0.0)
            dot = w1 * v1 + w2 * v2
            turn0, turn1, turn2 = b * (w1 * v2 - w2 * v1), a * v1 + c3 * dot * w1, a * v2 + c3 * dot * w2
            for i in range(3):
                theta[i] = turn0 * frame[j, 0, i] + turn1 * frame[j, 1, i] + turn2 * frame[j, 2, i]
            if j + 1 < k:
                _twist_of_turn(theta, place[j + 1], twist[row])
                for i in range(3):
                    for d in range(3):
                        twist[row, i] += moved[c, d] * frame[j, d, i]
            first[row], own[row] = j + 1, j
            row += 1
    return twist, first, own


@njit(cache=True, nogil=True)
def _moments(
    p: np.ndarray,
    weight: np.ndarray,
    s: np.ndarray,
    place: np.ndarray,
    frame: np.ndarray,
    joints: np.ndarray,
    bend: np.ndarray,
    free: bool,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Moments [k, 8, 8] and [k, 8] of the rows (n, x × n, n·dx/dK) of each piece's points, and the cost."""
    k = len(bend)
    second, with_residual = np.zeros((k, 8, 8)), np.zeros((k, 8))
    row, step, by, turned = np.empty(8), np.empty(3), np.empty((2, 3)), np.empty((3, 3))
    x, r, n = np.empty(3), np.empty(3), np.empty(3)
    cost = 0.0
    j = 0
    for i in range(len(s)):
        w = weight[i]
        if w <= 0.0:
            continue
        j = piece_of(joints, s[i], j)
        here = s[i] - joints[j]
        _place(bend[j, 0], bend[j, 1], here, step)
        _place_by_kappa(bend[j, 0], bend[j, 1], here, by)
        if free:
            _axes_after(bend[j, 0], bend[j, 1], here, frame[j], turned)
        for c in range(3):
            x[c] = (
                place[j, c] + step[0] * frame[j, 0, c] + step[1] * frame[j, 1, c] + step[2] * frame[j, 2, c]
            )
            r[c] = p[i, c] - x[c]
        for part in range(1 if free else 0, 3):
            for c in range(3):
                n[c] = turned[part, c] if free else (1.0 if c == part else 0.0)
            row[0], row[1], row[2] = n[0], n[1], n[2]
            row[3] = x[1] * n[2] - x[2] * n[1]
            row[4] = x[2] * n[0] - x[0] * n[2]
            row[5] = x[0] * n[1] - x[1] * n[0]
            for d in range(2):
                row[6 + d] = 0.0
                for e in range(3):
                    f = n[0] * frame[j, e, 0] + n[1] * frame[j, e, 1] + n[2] * frame[j, e, 2]
                    row[6 + d] += by[d, e] * f
            off = r[0] * n[0] + r[1] * n[1] + r[2] * n[2]
            cost += w * off * off
            for a in range(8):
                wa = w * row[a]
                with_residual[j, a] += wa * off
                for b in range(a, 8):
                    second[j, a, b] += wa * row[b]
    for j in range(k):
        for a in range(8):
            for b in range(a):
                second[j, a, b] = second[j, b, a]
    return second, with_residual, cost


@njit(cache=True, nogil=True)
def normal_equations(
    p: np.ndarray,
    weight: np.ndarray,
    s: np.ndarray,
    start: np.ndarray,
    axes: np.ndarray,
    joints: np.ndarray,
    bend: np.ndarray,
    curved: np.ndarray,
    free: bool,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Gauss-Newton matrix [m, m] and gradient [m] of the fit, and its cost; docs/model.md (31), (32).

    Parameters
    ----------
    p, weight, s
        Points [n, 3], weights [n] and stations [n].
    start, axes, joints, bend, curved
        The chain: place [3] and axes [3, 3] at its start, start of each piece [k], curvature components
        [k, 2], which pieces may be curved [k].
    free
        True where stations are unknown: only distances across the chain count.
    """
    place, frame = joint_frames(start, axes, joints, bend)
    twist, first, own = _twists(place, frame, joints, bend, curved, free)
    second, with_residual, cost = _moments(p, weight, s, place, frame, joints, bend, free)
    m, k = len(twist), len(bend)
    beyond, beyond_residual = np.zeros((k + 1, 6, 6)), np.zeros((k + 1, 6))
    for j in range(k - 1, -1, -1):
        beyond[j] = beyond[j + 1] + second[j, :6, :6]
        beyond_residual[j] = beyond_residual[j + 1] + with_residual[j, :6]
    matrix, gradient = np.zeros((m, m)), np.zeros(m)
    # column of the own component (6 or 7) of each curvature parameter
    side = np.zeros(m, dtype=np.int64)
    for a in range(1, m):
        if own[a] >= 0 and own[a - 1] == own[a]:
            side[a] = 1
    reach = np.empty(6)
    for a in range(m):
        gradient[a] = np.sum(twist[a] * beyond_residual[first[a]])
        if own[a] >= 0:
            gradient[a] += with_residual[own[a], 6 + side[a]]
        for b in range(a, m):
            moments = beyond[max(first[a], first[b])]
            for i in range(6):
                reach[i] = np.sum(moments[i] * twist[b])
            if own[b] >= 0 and first[a] <= own[b]:
                for i in range(6):
                    reach[i] += second[own[b], i, 6 + side[b]]
            value = np.sum(twist[a] * reach)
            if own[a] >= 0 and first[b] <= own[a]:
                for i in range(6):
                    value += twist[b, i] * second[own[a], i, 6 + side[a]]
            if own[a] >= 0 and own[a] == own[b]:
                value += second[own[a], 6 + side[a], 6 + side[b]]
            matrix[a, b] = value
            matrix[b, a] = value
    return matrix, gradient, cost
