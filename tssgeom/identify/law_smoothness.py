"""How smooth laws are: their priors, and the evidence for each in a model made straight.

Source: docs/model.md (189), (190), (293); S. N. Wood, Fast stable restricted maximum likelihood and marginal
likelihood estimation of semiparametric generalized linear models, J. R. Stat. Soc. B 73 (2011).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.identify.mechanisms import Mechanism


def law_precision(one: Mechanism, roughness: float, level: float, order: int = 2) -> Matrix:
    """Return the precision of the prior of the numbers of a law [k, k]; docs/model.md (189), (293).

    Parameters
    ----------
    one
        The law.
    roughness
        S.d. of its derivatives over the warped knots, in u.
    level
        S.d. of each number by itself, in u.
    order
        Of the derivatives: 1 lets it step, 2 bend.
    """
    out = np.eye(one.size) / level**2
    if len(one.warped) < 3:
        return out
    rough = np.pad(_derivatives(one.warped, order), ((0, 0), (0, one.more)))[:, one.pinned :]
    rough = np.cumsum(rough[:, ::-1], axis=1)[:, ::-1] if one.rising else rough
    return out + rough.T @ rough / roughness**2


def _derivatives(at: Vector, order: int) -> Matrix:
    """Return derivatives of a curve by its values at knots, times the root of the way that each is over.

    White noise of the derivatives has the same s.d. with any number of knots.
    """
    step = np.diff(at)
    slope = np.diff(np.eye(len(at)), axis=0) / step[:, None]
    if order == 1:
        return slope * np.sqrt(step)[:, None]
    way = 0.5 * (step[:-1] + step[1:])
    return np.diff(slope, axis=0) / np.sqrt(way)[:, None]


@dataclass(frozen=True, slots=True)
class Straight:
    """A model made straight, as far as its evidence needs it."""

    information: Matrix
    """[numbers, numbers]"""
    slope: Vector
    """[numbers]"""
    square: float
    """Of all residuals from the centre of the priors [1]."""

    def evidence(self, precision: Matrix) -> float:
        """Return the log evidence under a prior of this precision; docs/model.md (190)."""
        normal = self.information + precision
        gain = float(self.slope @ np.linalg.solve(normal, self.slope))
        (_, whole), (_, prior) = np.linalg.slogdet(normal), np.linalg.slogdet(precision)
        return -0.5 * (self.square - gain + float(whole) - float(prior))

    def covariance(self, precisions: Sequence[Matrix]) -> Matrix:
        """Return the covariance under priors each as likely beforehand, about the likeliest; (294)."""
        evidence = np.array([self.evidence(each) for each in precisions])
        weights = np.exp(evidence - evidence.max())
        weights /= weights.sum()
        middle = np.linalg.solve(self.information + precisions[int(evidence.argmax())], self.slope)
        out = np.zeros_like(self.information)
        for weight, precision in zip(weights, precisions, strict=True):
            inverse = np.linalg.inv(self.information + precision)
            off = inverse @ self.slope - middle
            out += weight * (inverse + np.outer(off, off))
        return out


def straight_model(jacobian: Matrix, residual: Vector, deviation: Vector) -> Straight:
    """Make a model straight about numbers that are so far from the centre of their priors.

    Parameters
    ----------
    jacobian
        [rows, numbers] Of the whitened prediction [1].
    residual
        [rows] Measured less predicted, whitened [1].
    deviation
        Of the first numbers; those behind are at their centres.
    """
    pseudo = residual + jacobian[:, : len(deviation)] @ deviation
    return Straight(jacobian.T @ jacobian, jacobian.T @ pseudo, float(pseudo @ pseudo))
