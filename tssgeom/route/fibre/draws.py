"""Draws from the posterior of the curvature of a fibre; docs/model.md (38)."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Points, Vector, rows_at
from tssgeom.core.constants_route import NODES
from tssgeom.route.fibre.models import DRAWS, PRIOR, Kinds, Sensed
from tssgeom.route.fibre.noise import Noises

_SEED = 36  # of the draws


class Draws(NamedTuple):
    """Draws from the posterior of the curvature."""

    s: Vector
    """Arc length of the nodes [m] [m]."""
    bend: Points
    """Components in the mean [m, 2] [1/m]."""
    off: np.ndarray
    """Components of each draw less those of the mean [d, m, 2] [1/m]."""
    kappa: Matrix
    """Curvature of each draw [d, m] [1/m]."""
    phi: Matrix
    """Accumulated angle of each draw [d, m] [rad]."""
    smooth: np.ndarray
    """True for a draw with a smooth piece [d]."""
    log_evidence: float
    """Evidence of the curvatures (natural logarithm)."""


def sampled(sensed: Sensed, kinds: Kinds, of: Noises) -> Draws:
    """Draw curvatures, the noise among its levels; docs/model.md (38).

    The random numbers are taken in the axes of the strongest bend, so that no roll of the fibre changes an
    angle.
    """
    intervals = len(sensed.s) - 1
    each = max(2, -(-NODES.fewest // intervals))
    s = rows_at(np.arange(each * intervals + 1) / each, np.arange(intervals + 1.0), sensed.s[:, None])[:, 0]
    uniform, normal = _random_numbers(DRAWS, len(sensed.s))
    strongest = sensed.bend[np.argmax(np.linalg.norm(sensed.bend, axis=1))]
    cos, sin = strongest / max(float(np.linalg.norm(strongest)), 1e-300)
    turned = np.array([[cos, -sin], [sin, cos]]) if cos or sin else np.eye(2)
    count = np.diff(np.round(DRAWS * np.concatenate(([0.0], np.cumsum(of.probability)))).astype(int))
    parts, evidences, begin = list[list[np.ndarray]](), list[float](), 0
    rate, bent = PRIOR.pieces / sensed.length, sensed.bend @ turned
    for noise, share in zip(of.level, count, strict=True):
        if share:
            own, given = slice(begin, begin + share), (sensed.s, bent, sensed.merged / noise**2)
            evidence, *part = core.fibre_draws(*given, *kinds, rate, s, uniform[own], normal[own])
            parts.append(part)
            evidences.append(evidence)
            begin += share
    bend, kappa, phi, smooth = parts[0]
    if len(parts) > 1:
        bend, kappa, phi, smooth = (np.concatenate(each) for each in zip(*parts, strict=True))
    bend = (bend.reshape(-1, 2) @ turned.T).reshape(bend.shape)
    mean = bend.mean(axis=0)
    log_evidence = of.with_middle(sensed, evidences[len(evidences) // 2])
    return Draws(s, mean, bend - mean, kappa, phi, smooth, log_evidence)


@lru_cache(maxsize=4)
def _random_numbers(draws: int, sites: int) -> tuple[Matrix, Matrix]:
    rng = np.random.default_rng(_SEED)
    return rng.random((draws, 2 * sites)), rng.standard_normal((draws, 8 * sites))
