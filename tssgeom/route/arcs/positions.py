"""Positions along a chain of circular arcs, and how far points are from it.

The chain starts at a position with axes (tangent and two normals, carried along without twist). Piece j runs
from arc length b_j to b_j+1 with constant curvature components K_j on the normals, so a straight piece and a
change of the bending plane are regular points. The last piece goes on without end.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def arc_functions(q: float) -> tuple[float, float, float, float, float]:
    """Functions of q = θ²: sin θ/θ, (1 - cos θ)/θ², (θ - sin θ)/θ³, and derivatives of the first two."""
    if q < 1e-2:
        a = 1 - q / 6 * (1 - q / 20 * (1 - q / 42 * (1 - q / 72)))
        b = 0.5 * (1 - q / 12 * (1 - q / 30 * (1 - q / 56 * (1 - q / 90))))
        c = (1 - q / 20 * (1 - q / 42 * (1 - q / 72 * (1 - q / 110)))) / 6
        da = -(1 - q / 10 * (1 - q / 28 * (1 - q / 54 * (1 - q / 88)))) / 6
        db = -(1 - q / 15 * (1 - q / 37.333333333333336 * (1 - q / 67.5 * (1 - q / 105.6)))) / 24
        return a, b, c, da, db
    t = math.sqrt(q)
    a, cos = math.sin(t) / t, math.cos(t)
    b = (1 - cos) / q
    return a, b, (1 - a) / q, 0.5 * (cos - a) / q, (0.5 * a - b) / q


@njit(cache=True, nogil=True)
def _local(k0: float, k1: float, h: float, out: np.ndarray) -> None:
    """Position and axes (rows: position, tangent, normals) at arc length h, in the axes at its start."""
    a, b, _, _, _ = arc_functions((k0 * k0 + k1 * k1) * h * h)
    fill_local(a, b, k0, k1, h, out)


@njit(cache=True, nogil=True)
def fill_local(a: float, b: float, k0: float, k1: float, h: float, out: np.ndarray) -> None:
    """Write position and axes from the arc functions a and b of the turn; see `_local`."""
    w0, w1 = k0 * h, k1 * h
    out[0, 0], out[0, 1], out[0, 2] = h * a, h * b * w0, h * b * w1
    out[1, 0], out[1, 1], out[1, 2] = 1 - b * (w0 * w0 + w1 * w1), a * w0, a * w1
    out[2, 0], out[2, 1], out[2, 2] = -a * w0, 1 - b * w0 * w0, -b * w0 * w1
    out[3, 0], out[3, 1], out[3, 2] = -a * w1, -b * w0 * w1, 1 - b * w1 * w1


@njit(cache=True, nogil=True)
def joint_frames(
    start: np.ndarray, axes: np.ndarray, joints: np.ndarray, bend: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Position [k, 3] and axes [k, 3, 3] at the start of every piece."""
    k = len(bend)
    position, frame = np.empty((k, 3)), np.empty((k, 3, 3))
    for i in range(3):
        position[0, i] = start[i]
        for c in range(3):
            frame[0, c, i] = axes[c, i]
    local = np.empty((4, 3))
    for j in range(1, k):
        _local(bend[j - 1, 0], bend[j - 1, 1], joints[j] - joints[j - 1], local)
        for i in range(3):
            t, e0, e1 = frame[j - 1, 0, i], frame[j - 1, 1, i], frame[j - 1, 2, i]
            position[j, i] = position[j - 1, i] + local[0, 0] * t + local[0, 1] * e0 + local[0, 2] * e1
            for c in range(3):
                frame[j, c, i] = local[1 + c, 0] * t + local[1 + c, 1] * e0 + local[1 + c, 2] * e1
    return position, frame


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
    """Position [n, 3], unit tangent [n, 3] and curvature vector [n, 3] at arc lengths `s` [n]."""
    position, frame = joint_frames(start, axes, joints, bend)
    x, t, curvature = np.empty((len(s), 3)), np.empty((len(s), 3)), np.empty((len(s), 3))
    local = np.empty((4, 3))
    j = 0
    for i in range(len(s)):
        j = piece_of(joints, s[i], j)
        _local(bend[j, 0], bend[j, 1], s[i] - joints[j], local)
        for c in range(3):
            f0, f1, f2 = frame[j, 0, c], frame[j, 1, c], frame[j, 2, c]
            x[i, c] = position[j, c] + local[0, 0] * f0 + local[0, 1] * f1 + local[0, 2] * f2
            t[i, c] = local[1, 0] * f0 + local[1, 1] * f1 + local[1, 2] * f2
            first = local[2, 0] * f0 + local[2, 1] * f1 + local[2, 2] * f2
            second = local[3, 0] * f0 + local[3, 1] * f1 + local[3, 2] * f2
            curvature[i, c] = bend[j, 0] * first + bend[j, 1] * second
    return x, t, curvature


@njit(cache=True, nogil=True)
def squared_distances(
    p: np.ndarray,
    s: np.ndarray,
    start: np.ndarray,
    axes: np.ndarray,
    joints: np.ndarray,
    bend: np.ndarray,
    across: bool,
) -> np.ndarray:
    """Squared distance of points [n, 3] from the chain at their stations [n], whole or across it [m²]."""
    x, tangent, _ = along(s, start, axes, joints, bend)
    square = np.empty(len(s))
    for i in range(len(s)):
        whole, along_chain = 0.0, 0.0
        for c in range(3):
            off = p[i, c] - x[i, c]
            whole += off * off
            along_chain += off * tangent[i, c]
        square[i] = max(whole - along_chain * along_chain, 0.0) if across else whole
    return square
