"""Noise of the curvatures that a fibre senses: stated, averaged over, or gone on with from frame to frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.core.constants import CHANCE
from tssgeom.route.fibre.models import DRAWS, PRIOR, Kinds, Sensed, log_densities, partitions
from tssgeom.route.observations import NOISE_PRIOR


@dataclass(frozen=True, slots=True)
class NoiseLevels:
    """How finely the noise of a fibre is averaged over. Chosen: what is left is below a tenth of an s.e."""

    coarse: int = 7
    """Levels of the coarse grid."""
    more: int = 8
    """Levels that are added where the probability is, at most."""
    step: float = 0.8
    """Step of the logarithm of the noise that is fine enough [standard errors]."""
    near_step: float = 1.5
    """Distance from the noise of the last frame to the levels on both sides [standard errors]."""
    most_ratio: float = 2.0
    """Greatest change of its standard error that needs none, as a factor [1]."""
    sharp_se: float = 0.1
    """Standard error of the logarithm of the noise below which its mean stands for all levels there [1]."""
    every: int = 8
    """Frames of a stream from one estimate to the next; a filter follows the noise in between."""


LEVELS = NoiseLevels()


class LastNoise(NamedTuple):
    """Noise of a fibre in an earlier frame."""

    noise: float
    """Of a component of one grating, above 0 [1/m]."""
    relative_se: float
    """Standard error of its logarithm, 0 where it is stated [1]."""
    frames: int = 0
    """Frames since it was estimated, or compared with the curvatures where it is stated [1]."""


class Noises(NamedTuple):
    """Levels of the noise that count, with their probabilities."""

    level: Vector
    """Standard deviation of a component of one grating [k] [1/m]."""
    probability: Vector
    """Posterior probability of each [k] [1]."""
    estimate: float
    """The noise [1/m]: the mean of its logarithm; as stated where it is known."""
    relative_se: float
    """Standard error of its logarithm [1]; 0 where it is known."""
    log_evidence: float | None
    """Evidence of the curvatures over all of them (natural logarithm); None where it is not summed yet."""

    def with_middle(self, sensed: Sensed, evidence: float) -> float:
        """Return ln of the evidence over all levels, by the sum (36) of the middle one."""
        if self.log_evidence is not None:
            return self.log_evidence
        of_level = evidence + log_densities(sensed.merged[sensed.read] / self.estimate**2)
        if self.relative_se == 0.0:
            return of_level
        return of_level + _log_prior(math.log(self.estimate)) + _log_width(self.relative_se)


def noises(sensed: Sensed, kinds: Kinds, last: LastNoise | None = None) -> Noises:
    """Levels of the noise: the known one, else a grid that is fine where the probability is; (240).

    The noise of the last frame is enough for three levels where the posterior of this one lies near it, and
    stands for itself where it was estimated a few frames ago.
    """
    if sensed.noise > 0.0:
        return Noises(np.array([sensed.noise]), np.ones(1), sensed.noise, 0.0, None)
    if last is not None and 0 < last.frames < LEVELS.every:
        return _normal(math.log(last.noise), last.relative_se, None)
    if last is not None and (near := _near(sensed, kinds, last)) is not None:
        return near
    low, high = (math.log(share * sensed.typical) for share in PRIOR.noise_range)
    high += 0.5 * math.log(float(sensed.merged.max()))  # means are that much less noisy than a grating
    level = np.linspace(low, high, LEVELS.coarse)
    density = np.array([_log_density(sensed, kinds, x) for x in level])
    finest = LEVELS.step / math.sqrt(2.0 * float(np.count_nonzero(sensed.read)))
    for _ in range(LEVELS.more):
        mass = np.exp(np.maximum(density[1:], density[:-1]) - density.max()) * np.diff(level)
        widest = np.where(np.diff(level) > finest, mass, 0.0)
        if DRAWS * widest.max() <= mass.sum():  # no step has a draw of its own
            break
        i = int(np.argmax(widest))
        middle = 0.5 * (level[i] + level[i + 1])
        level = np.insert(level, i + 1, middle)
        density = np.insert(density, i + 1, _log_density(sensed, kinds, middle))
    share = np.exp(density - density.max()) * np.gradient(level)
    log_evidence = float(density.max() + math.log(share.sum()))
    probability = share / share.sum()
    mean = float(probability @ level)
    relative_se = math.sqrt(float(probability @ (level - mean) ** 2))
    return Noises(np.exp(level), probability, math.exp(mean), relative_se, log_evidence)


def _normal(mean: float, deviation: float, log_evidence: float | None) -> Noises:
    """Levels of a normal posterior of ln noise: its nodes, or its mean where it is sharp; (242)."""
    node = [-math.sqrt(3.0), 0.0, math.sqrt(3.0)] if deviation > LEVELS.sharp_se else [0.0]
    share = [1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0] if deviation > LEVELS.sharp_se else [1.0]
    level = np.exp(mean + deviation * np.array(node))
    return Noises(level, np.array(share), math.exp(mean), deviation, log_evidence)


def _near(sensed: Sensed, kinds: Kinds, last: LastNoise) -> Noises | None:
    """Return the levels of a normal posterior of ln noise, or None where it lies elsewhere; (242)."""
    middle, step = math.log(last.noise), LEVELS.near_step * last.relative_se
    below, at, above = (_log_density(sensed, kinds, middle + x) for x in (-step, 0.0, step))
    bend = below - 2.0 * at + above
    if not math.isfinite(bend) or bend >= 0.0:
        return None
    slope, deviation = 0.5 * (above - below), step / math.sqrt(-bend)
    ratio, off = deviation / last.relative_se, -step * slope / bend
    if max(ratio, 1.0 / ratio) > LEVELS.most_ratio or abs(off) > CHANCE.clear * last.relative_se:
        return None
    log_evidence = at - 0.5 * slope**2 / bend + _log_width(deviation)
    return _normal(middle + off, deviation, log_evidence)


def _log_density(sensed: Sensed, kinds: Kinds, log_noise: float) -> float:
    """Evidence times the prior of ln noise (natural logarithm)."""
    return partitions(sensed, kinds, math.exp(log_noise)).log_evidence + _log_prior(log_noise)


def _log_prior(log_noise: float) -> float:
    """Prior of ln noise (natural logarithm)."""
    width = NOISE_PRIOR.decades * math.log(10.0)
    off = (log_noise - math.log(PRIOR.noise_per_m)) / width
    return -0.5 * off**2 - _log_width(width)


def _log_width(deviation: float) -> float:
    """Integral of a normal density of height one (natural logarithm)."""
    return math.log(deviation * math.sqrt(2.0 * math.pi))
