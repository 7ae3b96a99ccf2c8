"""The prior of the curvatures that a fibre senses, and what follows from it: evidence, noise and draws.

A route is cut into pieces, of which each is straight, of constant curvature, or smooth. Where between two
gratings two of them meet is not observed. Sums over all partitions take time quadratic in the number of
gratings (Barry and Hartigan 1992); a smooth piece is a Gaussian process, filtered along the fibre;
docs/model.md (36).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Points, Vector, rows_at
from tssgeom.core.constants import CHANCE, ROUNDING
from tssgeom.core.constants_route import NODES
from tssgeom.route.model_choice import NOISE_PRIOR


@dataclass(frozen=True, slots=True)
class FibrePrior:
    """Prior of the curvature of a fibre; docs/model.md (36), (37), (240)."""

    straight: float = 0.5
    """Probability that a piece is straight; half of the others are smooth [1]. Chosen."""
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


@dataclass(frozen=True, slots=True)
class Effort:
    """How finely a fibre is averaged. Chosen: the rest is below a tenth of a standard error."""

    noise_levels: int = 7
    """Levels of the coarse grid of the noise."""
    more_levels: int = 8
    """Levels that are added where the probability is, at most."""
    level_step: float = 0.8
    """Step of the logarithm of the noise that is fine enough [standard errors]."""
    near_step: float = 1.5
    """Distance from the noise of the last frame to the levels on both sides [standard errors]."""
    most_ratio: float = 2.0
    """Greatest change of its standard error that needs none, as a factor [1]."""
    draws: int = 256
    """Draws of the curvature."""


EFFORT = Effort()
_SEED = 36  # of the draws


class Kinds(NamedTuple):
    """Kinds of pieces."""

    variance: Vector
    """Of a component of the curvature, 0 where straight [k] [1/m²]."""
    decay: Vector
    """Of its covariance along the piece, 0 where constant [k] [1/m]."""
    share: Vector
    """Probability of each [k] [1]."""


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
        return np.concatenate(([0.0], 0.5 * (self.s[1:] + self.s[:-1]), [self.length]))

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
    curved = (1.0 - PRIOR.straight) / 2.0
    kinds = [Kinds(np.array(variance), np.zeros(constant + 1), _shares(PRIOR.straight, curved, constant))]
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
    log_evidence += float(np.sum(np.log(precision[sensed.read] / (2.0 * math.pi))))
    return Partition(log_evidence, np.array(joints), kinds.variance[kind[joints[1:]]] > 0.0)


class LastNoise(NamedTuple):
    """Noise of a fibre that an earlier frame gave."""

    noise: float
    """Of a component of one grating, above 0 [1/m]."""
    relative_se: float
    """Standard error of its logarithm, above 0 [1]."""


class Noises(NamedTuple):
    """Levels of the noise that count, with their probabilities."""

    level: Vector
    """Standard deviation of a component of one grating [k] [1/m]."""
    probability: Vector
    """Posterior probability of each [k] [1]."""
    log_evidence: float
    """Evidence of the curvatures over all of them (natural logarithm)."""

    @property
    def estimate(self) -> float:
        """The noise [1/m]: the mean of its logarithm; as stated where it is known."""
        if len(self.level) == 1:
            return float(self.level[0])
        return math.exp(float(self.probability @ np.log(self.level)))

    @property
    def relative_se(self) -> float:
        """Standard error of its logarithm [1]; 0 where it is known."""
        off = np.log(self.level / self.estimate)
        return math.sqrt(float(self.probability @ off**2))


def noises(sensed: Sensed, kinds: Kinds, last: LastNoise | None = None) -> Noises:
    """Levels of the noise: the known one, else a grid that is fine where the probability is; (240).

    The noise of the last frame is enough for three levels where the posterior of this one lies near it.
    """
    if sensed.noise > 0.0:
        log_evidence = partitions(sensed, kinds, sensed.noise).log_evidence
        return Noises(np.array([sensed.noise]), np.ones(1), log_evidence)
    if last is not None and (near := _near(sensed, kinds, last)) is not None:
        return near
    low, high = (math.log(share * sensed.typical) for share in PRIOR.noise_range)
    high += 0.5 * math.log(float(sensed.merged.max()))  # means are that much less noisy than a grating
    level = np.linspace(low, high, EFFORT.noise_levels)
    density = np.array([_log_density(sensed, kinds, x) for x in level])
    finest = EFFORT.level_step / math.sqrt(2.0 * float(np.count_nonzero(sensed.read)))
    for _ in range(EFFORT.more_levels):
        mass = np.exp(np.maximum(density[1:], density[:-1]) - density.max()) * np.diff(level)
        widest = np.where(np.diff(level) > finest, mass, 0.0)
        if EFFORT.draws * widest.max() <= mass.sum():  # no step has a draw of its own
            break
        i = int(np.argmax(widest))
        middle = 0.5 * (level[i] + level[i + 1])
        level = np.insert(level, i + 1, middle)
        density = np.insert(density, i + 1, _log_density(sensed, kinds, middle))
    share = np.exp(density - density.max()) * np.gradient(level)
    return Noises(np.exp(level), share / share.sum(), float(density.max() + math.log(share.sum())))


def _near(sensed: Sensed, kinds: Kinds, last: LastNoise) -> Noises | None:
    """Return the levels of a normal posterior of ln noise, or None where it lies elsewhere; (242)."""
    middle, step = math.log(last.noise), EFFORT.near_step * last.relative_se
    below, at, above = (_log_density(sensed, kinds, middle + x) for x in (-step, 0.0, step))
    bend = below - 2.0 * at + above
    if not math.isfinite(bend) or bend >= 0.0:
        return None
    slope, deviation = 0.5 * (above - below), step / math.sqrt(-bend)
    ratio, off = deviation / last.relative_se, -step * slope / bend
    if max(ratio, 1.0 / ratio) > EFFORT.most_ratio or abs(off) > CHANCE.clear * last.relative_se:
        return None
    level = np.exp(middle + off + deviation * math.sqrt(3.0) * np.array([-1.0, 0.0, 1.0]))
    log_evidence = at - 0.5 * slope**2 / bend + math.log(deviation * math.sqrt(2.0 * math.pi))
    return Noises(level, np.array([1.0, 4.0, 1.0]) / 6.0, log_evidence)


def _log_density(sensed: Sensed, kinds: Kinds, log_noise: float) -> float:
    """Evidence times the prior of ln noise (natural logarithm)."""
    width = NOISE_PRIOR.decades * math.log(10.0)
    off = (log_noise - math.log(PRIOR.noise_per_m)) / width
    prior = -0.5 * off**2 - math.log(width * math.sqrt(2.0 * math.pi))
    return partitions(sensed, kinds, math.exp(log_noise)).log_evidence + prior


class Draws(NamedTuple):
    """Draws from the posterior of the curvature."""

    s: Vector
    """Arc length of the nodes [m] [m]."""
    bend: np.ndarray
    """Components of each draw [d, m, 2] [1/m]."""
    phi: Matrix
    """Accumulated angle of each draw [d, m] [rad]."""
    smooth: np.ndarray
    """True for a draw with a smooth piece [d]."""


def sampled(sensed: Sensed, kinds: Kinds, of: Noises) -> Draws:
    """Draw curvatures, the noise among its levels; docs/model.md (38).

    The random numbers are taken in the axes of the strongest bend, so that no roll of the fibre changes an
    angle.
    """
    intervals = len(sensed.s) - 1
    each = max(2, -(-NODES.fewest // intervals))
    s = rows_at(np.arange(each * intervals + 1) / each, np.arange(intervals + 1.0), sensed.s[:, None])[:, 0]
    uniform, normal = _random_numbers(EFFORT.draws, len(sensed.s))
    strongest = sensed.bend[np.argmax(np.linalg.norm(sensed.bend, axis=1))]
    cos, sin = strongest / max(float(np.linalg.norm(strongest)), 1e-300)
    turned = np.array([[cos, -sin], [sin, cos]]) if cos or sin else np.eye(2)
    count = np.diff(np.round(EFFORT.draws * np.concatenate(([0.0], np.cumsum(of.probability)))).astype(int))
    parts, begin = list[tuple[np.ndarray, Matrix, np.ndarray]](), 0
    rate, bent = PRIOR.pieces / sensed.length, sensed.bend @ turned
    for noise, share in zip(of.level, count, strict=True):
        if share:
            own = slice(begin, begin + share)
            given = (sensed.s, bent, sensed.merged / noise**2)
            parts.append(core.fibre_draws(*given, *kinds, rate, s, uniform[own], normal[own]))
            begin += share
    bend, phi, smooth = (np.concatenate(each) for each in zip(*parts, strict=True))
    return Draws(s, bend @ turned.T, phi, smooth)


@lru_cache(maxsize=4)
def _random_numbers(draws: int, sites: int) -> tuple[Matrix, Matrix]:
    rng = np.random.default_rng(_SEED)
    return rng.random((draws, 2 * sites)), rng.standard_normal((draws, 8 * sites))


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
