"""Φ and the length, averaged over a smooth route and chains of arcs; docs/model.md (217).

Noisy points select neither the kind of model nor the number of pieces. The estimate is that of the selected
model. Its variances are taken over all models that were tried, over their chains with straight pieces between
the bends, which fit as well where noise hides them, over joints that blend and ends that are straight without
moving a point by more than noise, and over what curvature may do between few points.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Generator, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Vector, rows_at
from tssgeom.errors import FitError
from tssgeom.route.arcs.chain import Chain, Data, fit_with_work, parameter_count, value_count
from tssgeom.route.arcs.moves import work_of_promises
from tssgeom.route.arcs.summary import chain_follows, chain_pieces, identifiable_in_steps, search_variance
from tssgeom.route.bend_priors import hidden_form
from tssgeom.route.model_choice import (
    CHOICE,
    added_variance,
    chain_evidence,
    evidence_scale,
    log_sum,
    model_probabilities,
)
from tssgeom.route.pieces import Arcs
from tssgeom.route.route import Route, step_lengths
from tssgeom.route.route_fit import NO_ERRORS, RouteFit, SharedErrors, Turned
from tssgeom.route.spline.spline import Spline
from tssgeom.route.steps import at_once
from tssgeom.route.unresolved_curvature import unresolved_angle_variance


@dataclass(frozen=True, slots=True)
class ModelAverage:
    """How evidence weighs the models."""

    straight_share: float = 0.1
    """First length of a straight piece beside a bend, of that bend [1]. Chosen: the fit moves it."""


AVERAGE = ModelAverage()
_MOST_LOG_ODDS = math.floor(math.log(sys.float_info.max))  # their exponential is finite


class ChainModel(NamedTuple):
    """Estimates of the route by a chain, and the evidence for it."""

    angle: float
    """Φ [rad]."""
    angle_variance: float
    """Its variance [rad²]."""
    length: float
    """Length [m]."""
    length_variance: float
    """Its variance [m²]."""
    difference: float
    """Evidence over that of the spline [2 ln]."""
    priced: float
    """The same after the price of its joints; docs/model.md (34)."""
    parameters: int
    proven: bool
    """Whether there are enough values for each of its parameters to show that the route is a chain."""


def chain_model(data: Data, chain: Chain, spline: Spline) -> ChainModel:
    """Angle, length and evidence of a fitted chain beside a spline of the same points."""
    evidence = chain_evidence(data, chain, spline)
    angle, angle_variance, length, length_variance = _moments(chain_pieces(data, chain).arcs)
    return ChainModel(
        angle=angle,
        angle_variance=(1.0 + search_variance(data, chain)) * angle_variance,
        length=length,
        length_variance=length_variance,
        difference=evidence.difference,
        priced=evidence.priced,
        parameters=len(chain.matrix),
        proven=value_count(data) >= CHOICE.whole_values_per_parameter * len(chain.matrix),
    )


def with_straights(tried: Iterable[tuple[Data, Chain]]) -> Generator[float, None, list[tuple[Data, Chain]]]:
    """Fit chains again with a straight piece wherever a bend meets another one or an end, but not at kinks.

    Of a kink and a straight piece that both are shorter than the spacing, no point shows which one turns.
    """
    fitted = list[tuple[Data, Chain]]()
    for data, chain in tried:
        candidate = _with_straights(chain) if data.shortest >= 1.0 else None
        if candidate is not None and parameter_count(candidate.curved, data.free) < value_count(data):
            work, candidate = fit_with_work(data, candidate)
            yield work
            with suppress(FitError):
                fitted.append((data, (yield from identifiable_in_steps(data, candidate))[0]))
    return fitted


def _different(tried: Iterable[tuple[Data, Chain]]) -> list[tuple[Data, Chain]]:
    """Return each chain once, which several first guesses may give."""
    return list({(len(chain.bend), f"{chain.cost:.4g}"): (data, chain) for data, chain in tried}.values())


def _with_straights(chain: Chain) -> Chain | None:
    """Put short straight pieces beside the bends of a chain; None where all have one."""
    edge = chain.edges
    beside = np.concatenate(([True], chain.curved, [True]))
    cut = AVERAGE.straight_share * np.diff(edge) * chain.curved
    before, after = cut * beside[:-2], cut * beside[2:]
    if not before.any() and not after.any():
        return None
    begin, kept = edge[:-1] + before, np.diff(edge) - before - after
    bend = chain.bend * (np.diff(edge) / np.maximum(kept, 1e-12))[:, None]
    new = np.concatenate((edge[:1][before[:1] > 0.0], (edge[1:] - after)[after > 0.0]))
    joints = np.concatenate((begin, new))
    curved = np.concatenate((chain.curved, np.zeros(len(new), dtype=np.bool_)))
    rows = np.column_stack((joints, np.concatenate((bend, np.zeros((len(new), 2))))))
    order = np.argsort(joints, kind="stable")
    return chain._replace(form=np.concatenate((chain.form[:4], rows[order])), curved=curved[order])


def averaged_over_models(fit: RouteFit, smooth: RouteFit, tried: Sequence[tuple[Data, Chain]]) -> RouteFit:
    """Return the selected fit with what all models add to its variances, which it remembers.

    Parameters
    ----------
    fit
        The selected fit, the smooth one or a chain.
    smooth
        The smooth fit.
    tried
        Chains that were fitted to the same points.
    """
    added = added_by_models(fit, smooth, tried)
    return replace(added.of_models(fit), by_models=added)


def added_by_models(fit: RouteFit, smooth: RouteFit, tried: Sequence[tuple[Data, Chain]]) -> SharedErrors:
    """Variances of Φ and of the length beside those of a fit, as above; (217), (238)."""
    return at_once(added_in_steps(fit, smooth, tried))


def added_in_steps(
    fit: RouteFit, smooth: RouteFit, tried: Sequence[tuple[Data, Chain]]
) -> Generator[float, None, SharedErrors]:
    """Do as `added_by_models`, with a stop after each fit and each evidence."""
    if smooth.spline is None:
        return NO_ERRORS
    first = _different(tried)
    models, chains = list[ChainModel](), list[tuple[Data, Chain]]()
    for data, chain in _different((*first, *(yield from with_straights(first)))):
        if not chain_follows(data, chain):
            continue
        model = chain_model(data, chain, smooth.spline)
        yield work_of_promises(data, chain)  # it takes about as long
        if math.isfinite(sum(model[:5])):  # a singular one leaves the others
            models.append(model)
            chains.append((data, chain))
    probability = probabilities(models)
    models, unresolved = models[: len(probability) - 1], 0.0
    if models and fit.chain is not None:
        unresolved = unresolved_angle_variance(*chains[int(np.argmax(probability[1:]))])
        models = [one._replace(angle_variance=one.angle_variance + unresolved) for one in models]
    smooth_moments = _smooth_moments(smooth, smooth.spline)
    every = [smooth_moments, *(one[:4] for one in models)]
    if smooth.turned:
        probability = with_turned(probability, smooth.turned)
        of_smooth = np.multiply(smooth_moments, (1.0, 0.0, 1.0, 0.0))
        every += [of_smooth + one[:4] for one in smooth.turned[:-1]]
    angle, own_angle, length, own_length = np.array(every).T
    about, known, length_about, length_known = _moments(fit.arcs)
    added = added_variance(probability, angle, own_angle, about, known)
    longer = added_variance(probability, length, own_length, length_about, length_known)
    if smooth.turned and smooth.spline.memory.tangents is not None:
        by_angle = (2.0 * _longer_than_chords(smooth.route)) ** 2 * (known + added) / max(about**2, 1e-24)
        longer = max(longer, by_angle - length_known)
    return SharedErrors(added, longer, min(unresolved, added))


def _longer_than_chords(route: Route) -> float:
    """By how much a route is longer than the chords between the feet of its points [m]; (166)."""
    feet = rows_at(route.station[route.weight > 0.0], route.s, route.position)
    return max(float(route.s[-1] - step_lengths(feet).sum()), 0.0)


def _moments(arcs: Arcs) -> tuple[float, float, float, float]:
    """Φ [rad] and the length [m], each followed by its variance."""
    return arcs.total_angle, arcs.total_angle_se**2, arcs.total_length, arcs.total_length_se**2


def _smooth_moments(smooth: RouteFit, spline: Spline) -> tuple[float, float, float, float]:
    """Do as `_moments` of a smooth fit, with what its bends may turn whose form many points hide; (258)."""
    angle, variance, length, length_variance = _moments(smooth.arcs)
    alone = spline.shared_angle_error == 0.0 and spline.tangent_share == 0.0
    if alone and not smooth.is_of_few:
        route, points = spline.route, int(np.count_nonzero(smooth.weight))
        bend = core.parallel_components(route.tangent, route.curvature_vector)
        variance += hidden_form(bend, route.s, points, smooth.noise) ** 2
    return angle, variance, length, length_variance


def probabilities(models: Sequence[ChainModel]) -> Vector:
    """Probability of the smooth model and of each chain [1 + n], of none where no chain has evidence; (217).

    The price of joints is a guess. The odds of all chains are those nearest to even that any share of it
    gives, and known no better than the criterion is. Chains with too few values for each parameter pass
    through any points: their odds are at most even. Between chains the criterion itself decides.
    """
    difference = np.array([one.difference for one in models])
    priced = np.array([one.priced if math.isfinite(one.priced) else -math.inf for one in models])
    if not len(models) or not np.isfinite(difference.max()) or not np.isfinite(priced.max()):
        return np.ones(1)
    least, most = sorted((float(priced.max()), float(difference.max())))
    likeliest = models[int(np.argmax(priced))]
    scale = 2.0 * evidence_scale(likeliest.parameters)
    log_odds = min(max(0.0, least), most) / scale
    log_odds = log_odds if likeliest.proven else min(log_odds, 0.0)
    of_smooth, of_chains = (1.0 / (1.0 + math.exp(min(one, _MOST_LOG_ODDS))) for one in (log_odds, -log_odds))
    return np.concatenate(([of_smooth], of_chains * model_probabilities(0.5 * difference)))


def with_turned(probability: Vector, turned: Sequence[Turned]) -> Vector:
    """Divide the probability of a smooth fit, the first one, among what few points allow beside it; (243).

    Three priors share it, so that the odds of the chains (217) are to all of these. The one that oscillates,
    which comes before the last, has its odds to these three beside it. Returns the probability of the last
    one, of the chains, and of all others.
    """
    evidence = np.array([one.log_evidence for one in turned])
    known = log_sum(np.delete(evidence, -2))
    of_chains = np.log(np.maximum(probability[1:], math.exp(-_MOST_LOG_ODDS)))
    share = math.log(probability[0]) + evidence - known
    return model_probabilities(np.concatenate((share[-1:], of_chains, share[:-1])))
