"""Two accounts of sensed curvatures, pieces and smooth wander, each averaged over what it does not know."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from tssgeom.arrays import Vector
from tssgeom.route.fibre.partitions import Partition, Sensed, piece_means, weigh
from tssgeom.route.fibre.wander import Posterior, Prior, evidence, magnitude, posterior, spectrum
from tssgeom.route.stations import accumulated

_JOINTS = (0.3, 1.0, 3.0, 8.0, 20.0, 50.0)  # joints that may be expected on a fibre
_WANDER = 2.0 ** np.arange(-2.0, 6.0)  # of the typical curvature, over the whole fibre
_QUIETEST, _LOUDEST = 1e-3, 1.5  # noise that may be expected, of the typical curvature
_NOISES = 9
_NODES = 80
_SMALL = 0.02  # probability below which a prior no longer counts


class Candidate(NamedTuple):
    """One account of the curvatures."""

    evidence: float
    """ln of the evidence, averaged over the priors."""
    angle: float
    """Φ of the likeliest prior [rad]."""
    mean: float
    """Φ averaged over the priors [rad]."""
    variance: float
    """Variance of Φ [rad²]."""
    noise: float
    """Standard deviation of a curvature component [1/m]."""
    prior: Prior
    partition: Partition | None


def as_pieces(sensed: Sensed) -> Candidate:
    """Account for the curvatures by pieces of constant curvature; docs/model.md (36)."""
    expected = [m for m in _JOINTS if m <= max(len(sensed.s) - 1, 1)]
    rates = [m / sensed.length for m in expected]
    noises, share = _noises(
        sensed, lambda noise: max(weigh(sensed, noise, rate).evidence for rate in rates[1::3])
    )
    tried = [(noise, rate, weigh(sensed, noise, rate)) for noise in noises for rate in rates]
    seen = np.array([found.evidence for _, _, found in tried])
    log = seen + np.repeat(share, len(rates)) - math.log(len(rates))
    weight = _weights(log)
    noise, rate, best = tried[int(np.argmax(seen))]
    angle, beyond = _angle(sensed, best, noise, rate)
    mean = float(weight @ [found.mean for _, _, found in tried])
    square = float(weight @ [found.variance + (found.mean - mean) ** 2 for _, _, found in tried])
    return Candidate(_log_sum(log), angle, mean, square + beyond, noise, Prior(0, 0.0, noise), best)


def piece_curvature(sensed: Sensed, found: Partition, noise: float) -> tuple[Vector, Vector]:
    """Curvature of each piece without the bias of a magnitude, and its variance [k]; docs/model.md (36)."""
    mean, count = piece_means(sensed, found.joints, found.curved)
    variance = noise**2 / count * found.curved
    return np.sqrt(np.maximum(np.einsum("ij,ij->i", mean, mean) - variance, 0.0)), variance


def _angle(sensed: Sensed, found: Partition, noise: float, rate: float) -> tuple[float, float]:
    """Φ of a partition, and the variance from joints that may lie beyond the first and the last grating."""
    kappa, _ = piece_curvature(sensed, found, noise)
    reach = np.array([sensed.s[0], sensed.length - sensed.s[-1]])
    jump = kappa[[0, -1]] ** 2 + sensed.typical**2
    beyond = np.sum(np.minimum(rate * reach, 1.0) * reach**2 / 3.0 * jump)
    return float(kappa @ np.diff(sensed.cell[found.joints])), float(beyond)


def as_wander(sensed: Sensed, order: int) -> Candidate:
    """Account for the curvatures by smooth wander; docs/model.md (37)."""
    sizes = _WANDER * sensed.typical

    spectra = [spectrum(sensed, order, size) for size in sizes]
    noises, share = _noises(sensed, lambda noise: max(evidence(one, noise) for one in spectra))
    priors = [Prior(order, size, noise) for noise in noises for size in sizes]
    seen = np.array([evidence(one, noise) for noise in noises for one in spectra])
    log = seen + np.repeat(share, len(sizes)) - math.log(len(sizes))
    weight = _weights(log)
    counts = np.flatnonzero(weight > _SMALL * weight.max())
    nodes = wander_nodes(sensed, _NODES)
    angles = np.array([_smooth_angle(posterior(sensed, priors[i], nodes)) for i in counts])
    weight = _weights(log[counts])
    mean = float(weight @ angles[:, 0])
    variance = float(weight @ (angles[:, 1] + (angles[:, 0] - mean) ** 2))
    best = int(np.argmax(seen[counts]))
    prior = priors[counts[best]]
    return Candidate(_log_sum(log), float(angles[best, 0]), mean, variance, prior.noise, prior, None)


def wander_nodes(sensed: Sensed, least: int) -> Vector:
    """Nodes on which smooth curvature is evaluated: the gratings, both ends, and at least so many [m]."""
    share = np.concatenate((np.linspace(0.0, 1.0, least + 1), sensed.s / sensed.length))
    return sensed.length * np.unique(np.round(share, 9))


def _smooth_angle(found: Posterior) -> tuple[float, float]:
    """Φ of a posterior and its variance."""
    kappa, covariance = magnitude(found)
    weight = np.gradient(found.s)
    weight[[0, -1]] *= 0.5
    return float(accumulated(found.s, kappa)[-1]), max(float(weight @ covariance @ weight), 0.0)


def _noises(sensed: Sensed, score: Callable[[float], float]) -> tuple[Vector, Vector]:
    """Noise levels that count [1/m] and the ln of their prior shares: the known one, else a grid.

    A priori the logarithm of the noise is even over three decades; the grid is fine about the likeliest.
    """
    if sensed.noise > 0.0:
        return np.array([sensed.noise]), np.zeros(1)
    coarse = np.log(np.geomspace(_QUIETEST, _LOUDEST, _NOISES) * sensed.typical)
    best = coarse[int(np.argmax([score(math.exp(x)) for x in coarse]))]
    step = coarse[1] - coarse[0]
    bounds = (best - step, best + step)
    options = {"xatol": 0.03}
    peak = minimize_scalar(lambda x: -score(math.exp(x)), bounds=bounds, method="bounded", options=options).x
    near = peak + np.arange(-2, 3) / math.sqrt(len(sensed.s))
    far = coarse[(coarse < near[0]) | (coarse > near[-1])]
    level = np.sort(np.concatenate((far, near)))
    share = np.gradient(level)
    return np.exp(level), np.log(share / share.sum())


def _weights(log: Vector) -> Vector:
    weight = np.exp(log - log.max())
    return weight / weight.sum()


def _log_sum(log: Vector) -> float:
    return float(log.max() + math.log(np.sum(np.exp(log - log.max()))))
