"""Two models of the curvatures that a fibre senses: pieces of constant curvature, and smooth functions.

A fibre in pieces is cut where its curvature vector jumps; where between two gratings it does is not observed.
Joints come at random with a rate λ a metre, half of the pieces are straight, the others have curvature
components of variance τ². Sums over all partitions then take time quadratic in the number of gratings (Barry
and Hartigan 1992), and so does the likeliest one.

In the smooth model each component is Brownian motion beforehand, or the integral of one, from an unknown
start. With at most a few hundred stations its covariances are kept as dense matrices.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.route.route import accumulated


@dataclass(frozen=True, slots=True)
class PriorScale:
    """Scales of the priors of curvature."""

    faintest: float = 1e-4
    """Curvature below which nothing differs from straight [1/m]. Chosen: a radius of 10 km."""
    steepest: float = 6.0
    """Change of a smooth curvature over the fibre beforehand, in typical sizes [1]. Chosen: vague."""
    rounding: float = 1e-10
    """Variance over the mean square of curvature that is rounding [1]. Derived: double precision."""


SCALE = PriorScale()


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
        return math.sqrt(max(float(np.mean(self.bend**2)), self.noise**2, SCALE.faintest**2))


class Partition(NamedTuple):
    """The average over all partitions, and the likeliest of them."""

    log_evidence: float
    """Evidence of the curvatures (natural logarithm)."""
    mean: float
    """Φ averaged over all partitions [rad]."""
    variance: float
    """Its variance [rad²]."""
    joints: np.ndarray
    """First grating of each piece, and their number at the end [k+1]."""
    curved: np.ndarray
    """False for a straight piece [k]."""


def average_partitions(sensed: Sensed, noise: float, rate: float) -> Partition:
    """Average all partitions for a given noise [1/m] and rate of joints [1/m]; docs/model.md (36)."""
    given = (sensed.s, sensed.bend, sensed.merged / noise**2, sensed.cell)
    log_evidence, mean, variance, origin, curved = core.average_partitions(*given, rate, sensed.typical**2)
    joints = [len(sensed.s)]
    while joints[-1] > 0:
        joints.append(int(origin[joints[-1]]))
    joints.reverse()
    return Partition(log_evidence, mean, variance, np.array(joints), curved[joints[1:]])


def piece_means(sensed: Sensed, joints: np.ndarray, curved: np.ndarray) -> tuple[Points, Vector]:
    """Mean components [k, 2] of each piece and its number of gratings [k]; a straight one has mean 0."""
    count = np.add.reduceat(sensed.merged, joints[:-1])
    mean = np.add.reduceat(sensed.bend * sensed.merged[:, None], joints[:-1]) / count[:, None]
    return mean * curved[:, None], count


def piece_curvature(sensed: Sensed, partition: Partition, noise: float) -> tuple[Vector, Vector]:
    """Curvature of each piece without the bias of a magnitude, and its variance [k]; docs/model.md (36)."""
    mean, count = piece_means(sensed, partition.joints, partition.curved)
    variance = noise**2 / count * partition.curved
    return np.sqrt(np.maximum(np.einsum("ij,ij->i", mean, mean) - variance, 0.0)), variance


def angle_of_pieces(sensed: Sensed, partition: Partition, noise: float, rate: float) -> tuple[float, float]:
    """Φ of a partition, and the variance from joints that may lie beyond the first and the last grating."""
    kappa, _ = piece_curvature(sensed, partition, noise)
    reach = np.array([sensed.s[0], sensed.length - sensed.s[-1]])
    jump = kappa[[0, -1]] ** 2 + sensed.typical**2
    beyond = np.sum(np.minimum(rate * reach, 1.0) * reach**2 / 3.0 * jump)
    return float(kappa @ np.diff(sensed.cell[partition.joints])), float(beyond)


def joint_variance(sensed: Sensed, partition: Partition, noise: float) -> tuple[Vector, Matrix]:
    """Arc length and variance of each inner joint, the others held; docs/model.md (36).

    Returns
    -------
    joint
        Arc length of each joint: halfway between two gratings [m].
    variance
        Its variance [m²]: the interval between the gratings, and those that could be on the other side.
    """
    mean, _ = piece_means(sensed, partition.joints, partition.curved)
    cell, interval = sensed.cell, np.diff(sensed.s)
    joint, variance = cell[partition.joints[1:-1]], np.zeros(len(partition.joints) - 2)
    for j in range(len(variance)):
        begin, here, end = partition.joints[j : j + 3]
        off = [np.sum((sensed.bend[begin:end] - mean[j + side]) ** 2, axis=1) for side in (0, 1)]
        gain = np.cumsum((off[1] - off[0]) * sensed.merged[begin:end]) / (2 * noise**2)
        at = np.arange(begin + 1, end)
        weight = np.exp(gain[:-1] - np.max(gain[:-1])) * interval[at - 1]
        spread = (cell[at] - cell[here]) ** 2 + interval[at - 1] ** 2 / 12.0
        variance[j] = np.sum(weight * spread) / np.sum(weight)
    return joint, variance


class Prior(NamedTuple):
    """How curvature wanders along the fibre."""

    order: int
    """1 for Brownian motion, 2 for the integral of one."""
    wander: float
    """Standard deviation of what it adds to a component over the whole fibre [1/m]."""
    noise: float
    """Standard deviation of one component of one grating [1/m]."""


class Posterior(NamedTuple):
    """Curvature components at nodes, given what was sensed."""

    s: Vector
    """Arc length of the nodes [m]."""
    mean: Points
    """Components [m, 2] [1/m]."""
    covariance: Matrix
    """Covariance of one component, the same for both [m, m] [1/m²]."""


class Spectrum(NamedTuple):
    """Statistics of the data from which the evidence of a prior follows, for every noise."""

    values: Vector
    """Eigenvalues of the prior covariance, rows scaled by the root of the gratings merged [1/m²]."""
    squares: Vector
    """Squared components of what was sensed along its eigenvectors, both summed [1/m²]."""
    log_merged: float
    """Sum of ln of the gratings merged."""


def spectrum(sensed: Sensed, order: int, wander: float) -> Spectrum:
    """Take a prior of the given order and wander [1/m] apart."""
    from scipy.linalg import eigh

    root = np.sqrt(sensed.merged)
    scaled = _kernel(sensed, Prior(order, wander, 0.0), sensed.s, sensed.s) * root[:, None] * root
    values, vectors = eigh(scaled)
    along = vectors.T @ (sensed.bend * root[:, None])
    squares = np.einsum("ij,ij->i", along, along)
    return Spectrum(np.maximum(values, 0.0), squares, float(np.sum(np.log(sensed.merged))))


def log_evidence(of: Spectrum, noise: float) -> float:
    """Return ln of the evidence of a prior with noise [1/m]; docs/model.md (37)."""
    total = of.values + noise**2
    log_det = float(np.sum(np.log(total))) - of.log_merged
    return -0.5 * float(np.sum(of.squares / total)) - log_det - len(total) * math.log(2 * math.pi)


def posterior(sensed: Sensed, prior: Prior, nodes: Vector) -> Posterior:
    """Posterior of the curvature at nodes [m] along the fibre; docs/model.md (37)."""
    from scipy.linalg import cho_factor, cho_solve

    total = _kernel(sensed, prior, sensed.s, sensed.s)
    total[np.diag_indices_from(total)] += prior.noise**2 / sensed.merged
    cross = _kernel(sensed, prior, nodes, sensed.s)
    gain = cho_solve(cho_factor(total), cross.T).T
    covariance = _kernel(sensed, prior, nodes, nodes) - gain @ cross.T
    return Posterior(nodes, gain @ sensed.bend, 0.5 * (covariance + covariance.T))


def _kernel(sensed: Sensed, prior: Prior, a: Vector, b: Vector) -> Matrix:
    """Prior covariance of one component between arc lengths `a` and `b` [m]."""
    x, y = a[:, None] / sensed.length, b[None, :] / sensed.length
    low, high = np.minimum(x, y), np.maximum(x, y)
    start = sensed.typical**2
    if prior.order == 1:
        return start + prior.wander**2 * low
    slope = (SCALE.steepest * sensed.typical) ** 2
    return start + slope * (x - 0.5) * (y - 0.5) + prior.wander**2 * low**2 * (3.0 * high - low) / 2.0


def wander_nodes(sensed: Sensed, least: int) -> Vector:
    """Nodes on which smooth curvature is evaluated: the gratings, both ends, and at least so many [m]."""
    share = np.concatenate((np.linspace(0.0, 1.0, least + 1), sensed.s / sensed.length))
    return sensed.length * np.unique(np.round(share, 9))


def magnitude(smooth: Posterior) -> tuple[Vector, Matrix]:
    """Return the expected magnitude of the curvature at the nodes and its covariance; docs/model.md (37).

    The mean is that of the Rice distribution. The covariance is its Hermite series to second order: what a
    shift of the vector does to the mean, and what two shifts do.
    """
    from scipy.special import i0e, i1e

    square = np.einsum("ij,ij->i", smooth.mean, smooth.mean)
    v = np.maximum(np.diag(smooth.covariance), SCALE.rounding * np.mean(square) + 1e-300)
    size = np.sqrt(square) + 1e-12 * np.sqrt(v)
    x = size**2 / (4.0 * v)
    low, high = i0e(x), i1e(x)
    slope = size * np.sqrt(math.pi / (8.0 * v)) * (low + high)
    mean = np.sqrt(0.5 * math.pi * v) * ((1.0 + 2.0 * x) * low + 2.0 * x * high)
    across = slope / size
    along = (mean - size * slope) / v - across
    unit = smooth.mean / size[:, None]
    parallel = unit @ unit.T
    covariance = np.outer(slope, slope) * parallel * smooth.covariance
    both = np.outer(along, along) * parallel**2 + np.outer(across, across) * parallel**2
    both += (np.outer(along, across) + np.outer(across, along)) * (1.0 - parallel**2)
    return mean, covariance + 0.5 * both * smooth.covariance**2


def angle_of_wander(smooth: Posterior) -> tuple[float, float]:
    """Φ of a smooth posterior and its variance."""
    kappa, covariance = magnitude(smooth)
    weight = np.gradient(smooth.s)
    weight[[0, -1]] *= 0.5
    return float(accumulated(smooth.s, kappa)[-1]), max(float(weight @ covariance @ weight), 0.0)
