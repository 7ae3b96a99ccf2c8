"""Which model the observations support, and the variance of not knowing it; docs/model.md (34), (38).

Points are fitted by a spline and a chain of arcs, the curvatures of a fibre by pieces and by smooth priors.
Both are averaged in the same way: each model counts with its posterior probability, and the variance between
the models joins that within them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Vector, rows_at
from tssgeom.core.constants_route import SPACING
from tssgeom.route.arcs.chain import Chain, Data, noise_variance, squared_distances
from tssgeom.route.arcs.moves import saved_by_slopes
from tssgeom.route.arcs.outliers import squared_tangent_residuals
from tssgeom.route.observations import are_few, noise_price
from tssgeom.route.route import across
from tssgeom.route.spline.spline import Spline


@dataclass(frozen=True, slots=True)
class ModelChoice:
    """Choice between spline and chain. Evidence is counted as 2 ln, like the information criteria.

    Prices were fitted on chains, clothoids, helices, harmonics and colon-like routes of 15 to 1000 points;
    docs/model.md (34).
    """

    chain_bonus: float = 23.0
    """Evidence that a chain is given beforehand [2 ln]. Fitted, as above."""
    whole_bonus_from: int = 30
    """Points from which on it counts as a whole, and fewer in proportion [1]. Fitted on 8 to 40 points."""
    joint_price: float = 18.0
    """What each joint must save beyond its parameters [2 ln]. Fitted: staircases resemble smooth routes."""
    whole_price_from: int = 20
    """The same of the price of joints [1]. Fitted, as above."""
    many_pieces: int = 7
    """Pieces from which on each must save more. Fitted, as above."""
    further_piece_price: float = 4.0
    """What each piece beyond these must save in addition [2 ln]. Fitted, as above."""
    least_of_chain: float = 26.0
    """Evidence below which no chain with joints is taken for the route, and `further_piece_price` for each of
    them [2 ln]. Measured: what chains of two to six pieces gain on smooth routes; docs/model.md (225)."""
    values_per_parameter: float = 1.3
    """Fewest values for each parameter of a chain of a few pieces [1]. Chosen: fewer cannot show them."""
    whole_values_per_parameter: float = 2.5
    """Values for each parameter from which on they are enough, for many pieces too [1]. Chosen."""
    missing_value_price: float = 25.0
    """Price of each value that a parameter lacks of these [2 ln]. Fitted on routes of 8 to 20 points."""
    hopeless: float = -40.0
    """Evidence difference of a first chain that further moves do not make up, and of either model from which
    the interval to its next trial doubles in a stream [2 ln]. Chosen."""


CHOICE = ModelChoice()


def model_probabilities(log_evidence: Vector) -> Vector:
    """Posterior probabilities of models that are equally likely beforehand, from ln of their evidence [n]."""
    weight = np.exp(log_evidence - log_evidence.max())
    return weight / weight.sum()


def log_sum(log_evidence: Vector) -> float:
    """Return ln of the sum of the evidence of all models, from ln of each [n]."""
    return float(log_evidence.max() + math.log(np.sum(np.exp(log_evidence - log_evidence.max()))))


def mixture_variance(probability: Vector, mean: Vector, variance: Vector | float, about: float) -> float:
    """Mean square error of the estimate `about`, over models with means and variances of their own [n].

    About the mean over all models it is their common variance; about the estimate of the selected model it
    holds what selecting it may cost.
    """
    return float(probability @ (variance + (mean - about) ** 2))


def added_variance(probability: Vector, angle: Vector, own: Vector, about: float, known: float) -> float:
    """Return what other fits add to the variance of Φ of the one that stands for them [rad²]; (151).

    Parameters
    ----------
    probability, angle, own
        Posterior probability of each fit [n], its Φ [rad] and the variance of that [rad²].
    about, known
        Φ of the fit that stands for all [rad], and its own variance [rad²].
    """
    # a variance above Φ², or none, only shows that a fit is not linear in its errors
    return max(mixture_variance(probability, angle, np.fmin(own, angle**2), about) - known, 0.0)


def evidence_scale(parameters: int) -> float:
    """Return by how much the error of the criterion widens a difference of evidence [1]; (217).

    The criterion leaves out the density of the prior, of the order of 1 for each parameter. A logistic
    density that is as wide as this error is joined with that of the odds themselves.
    """
    return math.sqrt(1.0 + 3.0 * (parameters / (2.0 * math.pi)) ** 2)


def evidence_difference(data: Data, chain: Chain, spline: Spline) -> float:
    """Evidence of the chain over the spline without any price [2 ln]; (217)."""
    return spline.deviance - chain_deviance(data, chain)


class ChainEvidence(NamedTuple):
    """Evidence of a chain over a spline of the same points [2 ln]."""

    difference: float
    """Without the price of its joints; docs/model.md (217)."""
    priced: float
    """With it; docs/model.md (34)."""


def chain_evidence(data: Data, chain: Chain, spline: Spline) -> ChainEvidence:
    """Evidence of a chain over a spline, what the spline saves within its pieces paid for."""
    varying = saved_by_variation(data, chain, spline)
    difference, priced = (
        of(data, chain, spline) - varying for of in (evidence_difference, log_evidence_difference)
    )
    return ChainEvidence(difference, priced)


def preference(data: Data, chain: Chain, spline: Spline, evidence: ChainEvidence) -> float:
    """Evidence by which a chain is selected, where it is positive, or a spline [2 ln]; docs/model.md (259).

    The price of joints keeps a chain from being selected for its evidence alone. It is not asked where
    Akaike's criterion, by which staircases on smooth routes lose, is for the chain as well.
    """
    if evidence.priced > 0.0:
        return evidence.priced
    akaike = _akaike_difference(data, chain, spline) - math.log(data.values_across)
    return max(evidence.priced, min(evidence.difference, akaike))


def _akaike_difference(data: Data, chain: Chain, spline: Spline) -> float:
    """Akaike's criterion of the spline less that of a chain of many points, by those that both use; (259)."""
    variance = spline.route.noise**2
    if are_few(data.points) or data.shortest < 1.0 or data.tangents is not None or variance <= 0.0:
        return -math.inf
    weight = np.minimum(data.weight, spline.route.weight)
    of_spline = float(weight @ _squared_across(spline))
    of_chain = float(weight @ squared_distances(data, chain, across=True))
    parameters, of_freedom = float(chain.parameters_across), 2.0 * spline.freedom
    if data.variance > 0.0:
        return (of_spline - of_chain) / variance - 2.0 * (parameters - of_freedom)
    values = float(data.values_across)
    if min(of_chain, of_spline) <= 0.0 or values - max(parameters, of_freedom) <= 1.0:
        return -math.inf
    price = [2.0 * one * values / (values - one - 1.0) for one in (parameters, of_freedom)]
    return values * math.log(of_spline / of_chain) - price[0] + price[1]


def _squared_across(spline: Spline) -> Vector:
    """Squared distances of points from a spline, across it [n] [m²]."""
    off = across(spline.route.residual, rows_at(spline.route.station, spline.route.s, spline.route.tangent))
    return np.einsum("ij,ij->i", off, off)


def saved_by_variation(data: Data, chain: Chain, spline: Spline) -> float:
    """Return what curvature that varies within the pieces saves beyond chance [noise variances]; (225).

    It is what slopes in the pieces save, or what the spline does with its 2 f parameters across the route.
    Where the noise is not known, it is estimated from what these leave of the values.
    """
    by_slopes = max(saved_by_slopes(data, chain), 0.0)
    variance = spline.route.noise**2
    kinked = data.shortest < 1.0  # a spline rounds what it does not follow
    if kinked or data.tangents is not None or variance <= 0.0:
        return by_slopes
    if data.variance == 0.0:
        left = data.values_across - 2.0 * spline.freedom
        return max(by_slopes, left * math.log(max(noise_variance(data, chain) / variance, 1.0)))
    square = squared_distances(data, chain, across=True) - _squared_across(spline)
    by_chance = 2.0 * spline.freedom - chain.parameters_across
    return max(by_slopes, float(data.weight @ square) / variance - by_chance)


def log_evidence_difference(data: Data, chain: Chain, spline: Spline) -> float:
    """Evidence of the chain over the spline, after the additional price of its joints [2 ln]; (34)."""
    pieces = len(chain.bend)
    points = len(data.points)
    whole = min(points / CHOICE.whole_bonus_from, 1.0)
    bonus = CHOICE.chain_bonus * whole
    price = CHOICE.joint_price * (pieces - 1) * min(points / CHOICE.whole_price_from, 1.0)
    price += CHOICE.further_piece_price * max(pieces - CHOICE.many_pieces, 0)
    if chain.curved.any():
        price = max(price, bonus + whole * least_evidence(pieces))
    values = data.values_across / chain.parameters_across
    price += CHOICE.missing_value_price * max(CHOICE.whole_values_per_parameter - values, 0.0)
    if data.variance == 0.0:
        length = float(chain.stations.max() - chain.stations.min())
        price += noise_price(math.sqrt(noise_variance(data, chain)) / length)
        price -= noise_price(spline.route.noise / float(spline.route.s[-1]))
    return evidence_difference(data, chain, spline) + bonus - price


def least_evidence(pieces: int) -> float:
    """Evidence that chains gain even on smooth routes, which no other price may undercut [2 ln]; (225)."""
    joints = pieces - 1
    return CHOICE.least_of_chain + CHOICE.further_piece_price * joints if joints else 0.0


def chain_deviance(data: Data, chain: Chain) -> float:
    """-2 ln evidence of points and directions normal to a chain; docs/model.md (34), (94)."""
    fitted = _deviance_of_points(data, chain)
    if data.tangents is None:
        return fitted
    used = data.tangents.variance > 0.0
    variance, square = data.tangents.variance[used], squared_tangent_residuals(data, chain)[used]
    return fitted + float(np.sum(2.0 * np.log(variance) + square / variance))


def _deviance_of_points(data: Data, chain: Chain) -> float:
    """-2 ln evidence of the points normal to a chain, infinite where it has too many parameters for them."""
    square = squared_distances(data, chain, across=True)
    cost, values = float(data.weight @ square), 2 * int(np.count_nonzero(data.weight))
    fitted, parameters = data.values_across, chain.parameters_across
    few = len(chain.bend) <= CHOICE.many_pieces
    least = CHOICE.values_per_parameter if few else CHOICE.whole_values_per_parameter
    if parameters * least > fitted or _lost_along(data, chain, cost):
        return math.inf
    variance = data.variance if data.variance > 0.0 else max(cost / values, 1e-280)
    return values * math.log(variance) + cost / variance + parameters * math.log(fitted)


def _lost_along(data: Data, chain: Chain, across: float) -> bool:
    """Whether points are far from their stations though near the chain, as where a route turns back."""
    limit = SPACING.uneven**2 * float(data.weight.sum()) * data.spacing**2
    lost = chain.cost - across > limit
    return not data.free and lost and chain.cost > SPACING.uneven**2 * across
