"""How smooth laws are: their priors, and the evidence for each in a model made straight.

Source: docs/model.md (189), (190), (293); S. N. Wood, Fast stable restricted maximum likelihood and marginal
likelihood estimation of semiparametric generalized linear models, J. R. Stat. Soc. B 73 (2011).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.identify.finding import LawCurve
from tssgeom.identify.mechanisms import KNOTS, Mechanism
from tssgeom.statistics import NORMAL_95


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


def law_curve(
    one: Mechanism,
    waves: Matrix,
    numbers: Vector,
    covariance: Matrix,
    coefficient: float,
    nearest: tuple[tuple[str, float], ...] = (),
) -> LawCurve:
    """Return a law over its support with its 95 % band, friction as the coefficient itself; (190), (312).

    Parameters
    ----------
    one, waves, numbers
        The law, u at its knots by its waves [k, waves], and its numbers [waves].
    covariance
        Of the logarithm of the coefficient, and of the numbers [1 + waves, 1 + waves].
    coefficient
        Of friction [1].
    nearest
        Formulae near to it.
    """
    whole, shape = waves @ numbers, waves[: one.size - one.more]
    if one.name.startswith("friction_over"):
        both = np.column_stack([np.ones(len(shape)), shape])
        middle = coefficient * one.value(whole)
        spread = NORMAL_95 * np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", both, covariance, both), 0.0))
        low, high = middle * np.exp(-spread), middle * np.exp(spread)
    else:
        each = np.column_stack([one.value(unit) for unit in shape.T])  # it is linear in u
        middle = one.value(whole)
        spread = NORMAL_95 * np.sqrt(np.einsum("ki,ij,kj->k", each, covariance[1:, 1:], each))
        low, high = middle - spread, middle + spread
    x, (middle, low, high) = _finer(one, middle, low, high)
    return LawCurve(
        one.over, read_only(x), read_only(middle), read_only(low), read_only(high), one.unit, nearest
    )


def _finer(one: Mechanism, *values: Vector) -> tuple[Vector, list[Vector]]:
    """Return the knots of a curve made dense, and values there; what has no knots as it is."""
    if len(one.x) != len(one.warped) or len(one.x) < 2:
        return one.x, list(values)
    dense = np.linspace(0.0, 1.0, KNOTS.reported)
    x = core.tabulated(core.table_of(one.warped, one.x), dense)
    return x, [core.tabulated(core.table_of(one.x, each), x) for each in values]
