"""The prior of the curvatures that a fibre senses, and what follows from it: evidence and pieces.

A route is cut into pieces, of which each is straight, of constant curvature, or smooth. Where between two
gratings two of them meet is not observed. Sums over all partitions take time quadratic in the number of
gratings (Barry and Hartigan 1992); a smooth piece is a Gaussian process, filtered along the fibre;
docs/model.md (36).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Points, Vector
from tssgeom.core.constants import ROUNDING
from tssgeom.statistics import EVEN


@dataclass(frozen=True, slots=True)
class FibrePrior:
    """Prior of the curvature of a fibre; docs/model.md (36), (37), (240)."""

    pieces: float = 4.0
    """Pieces on a fibre, of which a piece as long as it is one of this number and one [1]. Chosen."""
    constant_sizes: tuple[float, ...] = (2.5, 0.5, 0.1)
    """Sizes of constant curvature, in rms curvatures [1]. Chosen: about even in the magnitude."""
    smooth_sizes: tuple[float, ...] = (1.5, 0.3)
    """The same of smooth curvature [1]. Chosen."""
    least_scale: float = 3.0
    """Length over which a smooth curvature is alike, at least [median spacings]. Chosen."""
    scale_ratio: float = 2.2
    """From one such length to the next, up to that of the fibre [1]. Chosen."""
    noise_per_m: float = 0.1
    """Typical noise of a component [1/m]. Chosen: strains of some 10⁻⁶ in cores 40 µm off the middle."""
    noise_range: tuple[float, float] = (1e-4, 1.5)
    """Bounds of an unknown noise, in rms curvatures of what is fitted [1]. Chosen."""


PRIOR = FibrePrior()
DRAWS = 256
"""Draws of the curvature [1]. Chosen: the rest is below a tenth of a standard error."""


class Kinds(NamedTuple):
    """Kinds of pieces."""

    variance: Vector
    """Of a component of the curvature, 0 where straight [k] [1/m²]."""
    decay: Vector
    """Of its covariance along the piece, 0 where constant [k] [1/m]."""
    share: Vector
    """Probability of each [k] [1]."""


def cell_bounds(s: Vector) -> Vector:
    """Bounds of the stretch that each of some arc lengths [n] [m] stands for, as `Sensed.cell` [n+1] [m]."""
    return np.concatenate((s[:1], 0.5 * (s[1:] + s[:-1]), s[-1:]))


def stretches(s: Vector) -> Vector:
    """Length of the stretch that each of some arc lengths stands for [n] [m]."""
    return np.diff(cell_bounds(s))


class Sensed(NamedTuple):
    """Curvature components at the sites of a fibre: its gratings, and its ends, in SI."""

    s: Vector
    """Arc length of each site from the proximal end [n] [m]."""
    bend: Points
    """Components κ_x, κ_y [n, 2] [1/m]."""
    merged: Vector
    """Number of gratings that each value is the mean of, 0 at an end without one [n] [1]."""
    noise: float
    """Known standard deviation of one component of one grating, 0 where unknown [1/m]."""

    @property
    def length(self) -> float:
        """Length of the fibre [m]."""
        return float(self.s[-1])

    @property
    def read(self) -> np.ndarray:
        """True where a grating was read [n]."""
        return self.merged > 0.0

    @property
    def cell(self) -> Vector:
        """Bounds of the stretch that each site stands for: both ends, and halfway between [n+1] [m]."""
        return cell_bounds(self.s)

    @property
    def typical(self) -> float:
        """Size τ of a component in the mean, not below what noise or rounding could hide [1/m]."""
        mean_square = float(np.mean(self.bend[self.read] ** 2))
        hidden = self.noise**2 * float(np.mean(1.0 / self.merged[self.read]))
        return max(math.sqrt(max(mean_square, hidden)), ROUNDING.relative / self.length)


def kinds_of(sensed: Sensed, *, smooth: bool = True, pieces: bool = True) -> Kinds:
    """Kinds of pieces: of constant curvature, straight ones among them, and of smooth curvature."""
    spacing = float(np.median(np.diff(sensed.s)))
    count = math.log(sensed.length / (PRIOR.least_scale * spacing)) / math.log(PRIOR.scale_ratio)
    steps = np.arange(max(math.floor(count), 0) + 1, dtype=np.float64)
    scale: Vector = sensed.length * PRIOR.scale_ratio**-steps
    variance = [0.0] + [size**2 for size in PRIOR.constant_sizes]
    constant = len(PRIOR.constant_sizes)
    curved = (1.0 - EVEN) / 2.0  # a piece is straight or not, and if not smooth or not, each as likely as not
    kinds = [Kinds(np.array(variance), np.zeros(constant + 1), _shares(EVEN, curved, constant))]
    kinds = kinds if pieces else []
    if smooth:
        size, decay = (each.ravel() for each in np.meshgrid(PRIOR.smooth_sizes, math.sqrt(7.0) / scale))
        own = np.full(size.size, curved / size.size)
        kinds.append(Kinds(np.square(size), decay, own))
    every = Kinds(*(np.concatenate(each) for each in zip(*kinds, strict=True)))
    return every._replace(variance=every.variance * sensed.typical**2, share=every.share / every.share.sum())


def _shares(straight: float, curved: float, count: int) -> Vector:
    return np.concatenate(([straight], np.full(count, curved / count)))


class Partition(NamedTuple):
    """Evidence of the curvatures over all partitions, and the likeliest of these."""

    log_evidence: float
    """Evidence (natural logarithm)."""
    joints: np.ndarray
    """First site of each piece, and their number at the end [k+1]."""
    curved: np.ndarray
    """False for a straight piece [k]."""


def partitions(sensed: Sensed, kinds: Kinds, noise: float) -> Partition:
    """Sum over all partitions for a noise [1/m]; docs/model.md (36)."""
    precision, rate = sensed.merged / noise**2, PRIOR.pieces / sensed.length
    log_evidence, origin, kind = core.fibre_evidence(sensed.s, sensed.bend, precision, *kinds, rate)
    joints = [len(sensed.s)]
    while joints[-1] > 0:
        joints.append(int(origin[joints[-1]]))
    joints.reverse()
    log_evidence += log_densities(precision[sensed.read])
    return Partition(log_evidence, np.array(joints), kinds.variance[kind[joints[1:]]] > 0.0)


def log_densities(precision: Vector) -> float:
    """Constant of the normal densities of what was read, both components (natural logarithm)."""
    return float(np.sum(np.log(precision / (2.0 * math.pi))))


def piece_means(sensed: Sensed, partition: Partition) -> tuple[Points, Vector]:
    """Mean components [k, 2] of each piece and its number of gratings [k]; a straight one has mean 0."""
    joints, curved = partition.joints, partition.curved
    count = np.maximum(np.add.reduceat(sensed.merged, joints[:-1]), 1e-300)
    mean = np.add.reduceat(sensed.bend * sensed.merged[:, None], joints[:-1]) / count[:, None]
    return mean * curved[:, None], count


def piece_curvature(sensed: Sensed, partition: Partition, noise: float) -> tuple[Vector, Vector]:
    """Curvature of each piece without the bias of a magnitude, and its variance [k]; docs/model.md (241)."""
    mean, count = piece_means(sensed, partition)
    variance = np.where(partition.curved & (count >= 1.0), noise**2 / count, 0.0)
    return np.sqrt(np.maximum(np.einsum("ij,ij->i", mean, mean) - variance, 0.0)), variance


def joint_variance(sensed: Sensed, partition: Partition, noise: float) -> tuple[Vector, Vector]:
    """Arc length and variance of each inner joint, the others held; docs/model.md (241).

    Returns
    -------
    joint
        Arc length of each joint: halfway between two gratings [m].
    variance
        Its variance [m²]: the interval between the gratings, and those that could be on the other side.
    """
    mean, _ = piece_means(sensed, partition)
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
