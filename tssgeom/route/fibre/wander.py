"""Curvatures sensed at stations as a smooth function of arc length: its posterior, and that of its magnitude.

A priori each component is Brownian motion, or the integral of one, from an unknown start. With at most a few
hundred stations the covariances are kept as dense matrices.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, eigh
from scipy.special import i0e, i1e

from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.route.fibre.partitions import Sensed

_EXACT = 1e-10  # of the mean square: rounding, not variance
_STEEPEST = 6.0  # typical sizes by which curvature may change over the fibre before it wanders


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
    """What the evidence of a prior asks of the data, for every noise."""

    values: Vector
    """Eigenvalues of the prior covariance, rows scaled by the root of the gratings merged [1/m²]."""
    squares: Vector
    """Squared components of what was sensed along its eigenvectors, both summed [1/m²]."""
    log_merged: float
    """Sum of ln of the gratings merged."""


def spectrum(sensed: Sensed, order: int, wander: float) -> Spectrum:
    """Take a prior of the given order and wander [1/m] apart."""
    root = np.sqrt(sensed.merged)
    scaled = _kernel(sensed, Prior(order, wander, 0.0), sensed.s, sensed.s) * root[:, None] * root
    values, vectors = eigh(scaled)
    along = vectors.T @ (sensed.bend * root[:, None])
    squares = np.einsum("ij,ij->i", along, along)
    return Spectrum(np.maximum(values, 0.0), squares, float(np.sum(np.log(sensed.merged))))


def evidence(found: Spectrum, noise: float) -> float:
    """Return ln of the evidence of a prior with noise [1/m]; docs/model.md (37)."""
    total = found.values + noise**2
    log_det = float(np.sum(np.log(total))) - found.log_merged
    return -0.5 * float(np.sum(found.squares / total)) - log_det - len(total) * math.log(2 * math.pi)


def posterior(sensed: Sensed, prior: Prior, nodes: Vector) -> Posterior:
    """Posterior of the curvature at nodes [m] along the fibre; docs/model.md (37)."""
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
    slope = (_STEEPEST * sensed.typical) ** 2
    return start + slope * (x - 0.5) * (y - 0.5) + prior.wander**2 * low**2 * (3.0 * high - low) / 2.0


def magnitude(found: Posterior) -> tuple[Vector, Matrix]:
    """Return the expected magnitude of the curvature at the nodes and its covariance; docs/model.md (37).

    The mean is that of the Rice distribution. The covariance is its Hermite series to second order: what a
    shift of the vector does to the mean, and what two shifts do.
    """
    square = np.einsum("ij,ij->i", found.mean, found.mean)
    v = np.maximum(np.diag(found.covariance), _EXACT * np.mean(square) + 1e-300)
    size = np.sqrt(square) + 1e-12 * np.sqrt(v)
    x = size**2 / (4.0 * v)
    low, high = i0e(x), i1e(x)
    slope = size * np.sqrt(math.pi / (8.0 * v)) * (low + high)
    mean = np.sqrt(0.5 * math.pi * v) * ((1.0 + 2.0 * x) * low + 2.0 * x * high)
    across = slope / size
    along = (mean - size * slope) / v - across
    way = found.mean / size[:, None]
    parallel = way @ way.T
    covariance = np.outer(slope, slope) * parallel * found.covariance
    both = np.outer(along, along) * parallel**2 + np.outer(across, across) * parallel**2
    both += (np.outer(along, across) + np.outer(across, along)) * (1.0 - parallel**2)
    return mean, covariance + 0.5 * both * found.covariance**2
