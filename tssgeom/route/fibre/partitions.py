"""Curvatures sensed at stations as pieces of constant curvature: all ways to cut them, by their evidence.

A fibre is cut where its curvature vector jumps; where between two gratings it does, nobody sees. Joints come
at random with a rate λ a metre, half of the pieces are straight, the others have curvature components of
variance τ². Sums over all partitions then take time quadratic in the number of gratings (Barry and
Hartigan 1992), and so does the likeliest one.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from tssgeom.arrays import Matrix, Points, Vector

_FAINTEST = 1e-4  # curvature below which nothing is told from straight [1/m]


class Sensed(NamedTuple):
    """Curvature components at the stations of a fibre, in SI."""

    s: Vector
    """Arc length of each grating from the proximal end [m]."""
    bend: Points
    """Components κ_x, κ_y [n, 2] [1/m]."""
    merged: Vector
    """Number of gratings that each value is the mean of [1]."""
    length: float
    """Length of the fibre [m]."""
    noise: float
    """Known standard deviation of one component of one grating, 0 where unknown [1/m]."""

    @property
    def cell(self) -> Vector:
        """Bounds of the stretch that each grating stands for: both ends, and halfway between [n+1] [m]."""
        return np.concatenate(([0.0], 0.5 * (self.s[1:] + self.s[:-1]), [self.length]))

    @property
    def typical(self) -> float:
        """Typical size τ of a component, not below what the noise could hide [1/m]."""
        return math.sqrt(max(float(np.mean(self.bend**2)), self.noise**2, _FAINTEST**2))


class Partition(NamedTuple):
    """What all partitions say together, and the likeliest of them."""

    evidence: float
    """ln of the evidence."""
    mean: float
    """Φ averaged over all partitions [rad]."""
    variance: float
    """Its variance [rad²]."""
    joints: np.ndarray
    """First grating of each piece, and their number at the end [k+1]."""
    curved: np.ndarray
    """False for a straight piece [k]."""


def weigh(sensed: Sensed, noise: float, rate: float) -> Partition:
    """Weigh all partitions for a given noise [1/m] and rate of joints [1/m]; docs/model.md (36)."""
    precision = sensed.merged / noise**2
    return Partition(*_weigh(sensed.s, sensed.bend, precision, sensed.cell, rate, sensed.typical**2))


def piece_means(sensed: Sensed, joints: np.ndarray, curved: np.ndarray) -> tuple[Points, Vector]:
    """Mean components [k, 2] of each piece and its number of gratings [k]; a straight one has mean 0."""
    count = np.add.reduceat(sensed.merged, joints[:-1])
    mean = np.add.reduceat(sensed.bend * sensed.merged[:, None], joints[:-1]) / count[:, None]
    return mean * curved[:, None], count


def joint_spread(sensed: Sensed, found: Partition, noise: float) -> tuple[Vector, Matrix]:
    """Place and variance of each inner joint, the others held; docs/model.md (36).

    Returns
    -------
    place
        Where each joint lies: halfway between two gratings [m].
    variance
        Of that place [m²]: the gap between the gratings, and the gratings that could be on the other side.
    """
    mean, _ = piece_means(sensed, found.joints, found.curved)
    cell, gap = sensed.cell, np.diff(sensed.s)
    place, variance = cell[found.joints[1:-1]], np.zeros(len(found.joints) - 2)
    for j in range(len(variance)):
        begin, here, end = found.joints[j : j + 3]
        off = [np.sum((sensed.bend[begin:end] - mean[j + side]) ** 2, axis=1) for side in (0, 1)]
        gain = np.cumsum((off[1] - off[0]) * sensed.merged[begin:end]) / (2 * noise**2)
        at = np.arange(begin + 1, end)
        weight = np.exp(gain[:-1] - np.max(gain[:-1])) * gap[at - 1]
        spread = (cell[at] - cell[here]) ** 2 + gap[at - 1] ** 2 / 12.0
        variance[j] = np.sum(weight * spread) / np.sum(weight)
    return place, variance


@njit(cache=True, nogil=True)
def _weigh(
    s: np.ndarray, bend: np.ndarray, precision: np.ndarray, cell: np.ndarray, rate: float, size2: float
) -> tuple:
    """Sum over all partitions, and the likeliest; returns the fields of `Partition`."""
    n = len(s)
    mass, first, square = np.zeros(n + 1), np.zeros((n + 1, 2)), np.zeros(n + 1)
    for i in range(n):
        p = precision[i]
        mass[i + 1] = mass[i] + p
        first[i + 1] = first[i] + p * bend[i]
        square[i + 1] = square[i] + 0.5 * p * np.sum(bend[i] ** 2) - math.log(p / (2 * math.pi))
    # of all partitions of the gratings before j: ln evidence, mean and mean square of φ, and of |κ| last
    total, best = np.zeros(n + 1), np.zeros(n + 1)
    phi, phi2 = np.zeros(n + 1), np.zeros(n + 1)
    kappa, kappa2 = np.zeros(n + 1), np.zeros(n + 1)
    joint, gap2 = np.zeros(n), np.zeros(n)
    for i in range(1, n):
        joint[i] = math.log(-math.expm1(-rate * (s[i] - s[i - 1])) + 1e-300)
        gap2[i] = (s[i] - s[i - 1]) ** 2 / 12.0
    origin, kind = np.zeros(n + 1, dtype=np.int64), np.zeros(n + 1, dtype=np.bool_)
    log = np.empty((n, 2))
    for j in range(1, n + 1):
        best[j] = -np.inf
        for i in range(j):
            prior = -rate * (s[j - 1] - s[i]) - math.log(2.0)
            if i > 0:
                prior += joint[i]
            m = mass[j] - mass[i]
            a, b = first[j, 0] - first[i, 0], first[j, 1] - first[i, 1]
            straight = prior - (square[j] - square[i])
            curved = straight + 0.5 * (a * a + b * b) / (m + 1.0 / size2) - math.log1p(m * size2)
            log[i, 0], log[i, 1] = total[i] + straight, total[i] + curved
            if best[i] + max(straight, curved) > best[j]:
                best[j], origin[j], kind[j] = best[i] + max(straight, curved), i, curved > straight
        top = np.max(log[:j])
        weight = 0.0
        for i in range(j):
            span = cell[j] - cell[i]
            m = mass[j] - mass[i]
            for curved in range(2):
                if log[i, curved] < top - 28.0:
                    continue
                w = math.exp(log[i, curved] - top)
                k, v = 0.0, 0.0
                if curved == 1:
                    a, b = first[j, 0] - first[i, 0], first[j, 1] - first[i, 1]
                    v = 1.0 / m
                    k = math.sqrt(max((a * a + b * b) / (m * m) - v, 0.0))
                    v = 1.0 / (m + 1.0 / size2)
                square_k = k * k + v
                own = span * span * v + gap2[i] * (kappa2[i] - 2 * kappa[i] * k + square_k)
                weight += w
                phi[j] += w * (phi[i] + span * k)
                phi2[j] += w * (phi2[i] + 2 * phi[i] * span * k + (span * k) ** 2 + own)
                kappa[j] += w * k
                kappa2[j] += w * square_k
        total[j] = top + math.log(weight)
        phi[j] /= weight
        phi2[j] /= weight
        kappa[j] /= weight
        kappa2[j] /= weight
    joints = [n]
    while joints[-1] > 0:
        joints.append(origin[joints[-1]])
    joints_up = np.array(joints[::-1])
    return total[n], phi[n], max(phi2[n] - phi[n] ** 2, 0.0), joints_up, kind[joints_up[1:]]
