"""A smooth fit averaged over the smoothing ratio λ, which few points do not determine; model.md (150)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Vector
from tssgeom.core.constants import CHANCE
from tssgeom.core.constants_route import PASSES, PRIOR, SEARCH
from tssgeom.errors import FitError
from tssgeom.route.bounds import Polygon, polygon_of
from tssgeom.route.model_choice import added_variance, model_probabilities
from tssgeom.route.observations import MIN_POINTS, NOISE_PRIOR, Shape, noise_price, on_chords
from tssgeom.route.pieces import smooth_geometry
from tssgeom.route.route import step_lengths
from tssgeom.route.spline.fit import fit
from tssgeom.route.spline.posterior import before_pass, next_pass, scaled_variance
from tssgeom.route.spline.problem import LastPass, Problem, Solution
from tssgeom.route.spline.spline import Spline, spline_of
from tssgeom.statistics import EVIDENCE_SCALE


@dataclass(frozen=True, slots=True)
class RatioGrid:
    """On which λ a fit is made, and which of the fits count."""

    widest: float = 1.0
    """Greatest distance of neighbouring λ [decades]. Chosen."""
    narrowest: float = 0.3
    """Least distance of neighbouring λ [decades]. Chosen."""
    deviations: float = 1.25
    """Distance of neighbouring λ [standard deviations of ln λ]. Derived: the sum over a normal density on
    such a grid is exact to 1e-5."""
    passes: int = 5
    """Most passes at one λ. Chosen."""
    converged: float = 0.1
    """Change of -2 ln of the posterior of λ in the last pass [1]. Chosen."""
    missed: int = 2
    """Neighbouring λ that do not count or give no curve, after which the search ends. Chosen."""
    much_likelier: float = 4.0
    """Difference in -2 ln of the posterior from which fits on stations by chords are selected [1]. Chosen:
    odds of 7 to 1."""
    most_bias: float = 0.3
    """Such an error over the standard error of Φ up to which chords give the stations [1]. Chosen."""
    agreement: float = 0.5
    """Difference to the mean Φ up to which the likeliest λ stands for all [standard errors]. Chosen."""


GRID = RatioGrid()
_OUTLIER_PRICE = 2.0 * math.log(CHANCE.clear**2 / EVIDENCE_SCALE.false_alarms)
"""-2 ln of the probability density of one outlier across the route, in mean spacings [1]. Derived: as many
points are as chance takes beyond a limit, within three spacings."""


class _Candidate(NamedTuple):
    """A fit at one λ."""

    spline: Spline
    criterion: float
    """-2 ln of the posterior density of λ, in decades, times the width of its cell."""
    angle: float
    """Φ [rad]."""
    variance: float
    """Its variance [rad²]."""
    length: float
    """Length [m]."""
    length_variance: float
    """Its variance at a known noise [m²]."""
    spread: float
    """Factor on that variance where the noise is estimated [1]; docs/model.md (216)."""


class _State(NamedTuple):
    """Where the passes at one λ ended."""

    problem: Problem
    solution: Solution
    criterion: float
    """-2 ln of the posterior density of λ, in decades."""


def averaged(shape: Shape, noise: float | None, spline: Spline) -> Spline:
    """Return the fit that stands for those at every λ, with the variance of Φ that they have in common.

    Where stations are unknown and the points accurate, stations by arcs over the chords are tried as well:
    on few points those at the feet of the points may not converge.
    """
    if not shape.is_of_few or spline.shared_angle_error:
        return spline
    candidates = list(_candidates(shape, noise, spline))
    first = candidates[:1]
    if shape.stations is None:
        candidates = _likelier(candidates, shape, noise)
    if shape.directions is not None and noise is None:
        # beside directions λ alone does not give the noise: the typical one is tried as well
        typical = NOISE_PRIOR.typical * float(np.sum(step_lengths(shape.points)))
        candidates, first = [_priced(one) for one in candidates], []
        with suppress(FitError):
            candidates += map(_priced, _candidates(shape, typical, fit(shape, typical)))
        if shape.stations is None:
            candidates += map(_priced, _likelier([], shape, typical))
    return _representative(shape, candidates, first) if candidates else spline


def _priced(one: _Candidate) -> _Candidate:
    """Return a fit at a noise that was given, with the price of that noise."""
    route = one.spline.route
    return one._replace(criterion=one.criterion + noise_price(route.noise / float(route.s[-1])))


def _likelier(candidates: list[_Candidate], shape: Shape, noise: float | None) -> list[_Candidate]:
    """Return fits on stations by chords instead of those given, where they are much likelier."""
    try:
        others = _by_chords(shape, noise)
    except FitError:
        return candidates
    if not others:
        return candidates
    least = min((one.criterion for one in candidates), default=math.inf)
    difference = least - min(one.criterion for one in others)
    return others if difference > GRID.much_likelier else candidates


def _by_chords(shape: Shape, noise: float | None) -> list[_Candidate]:
    """Fits on the stations of arcs over the chords; a chord to an outlier is none of the route."""
    sensed = on_chords(shape)
    spline = fit(sensed, noise)
    if np.count_nonzero(spline.route.weight) < MIN_POINTS:
        return []
    if spline.route.weight.min() <= 0.0:
        sensed = on_chords(shape, spline.route.weight)
        spline = fit(sensed, noise)
    spacing = float(spline.route.s[-1]) / (len(shape.points) - 1)
    return [
        one._replace(spline=replace(one.spline, stations_known=False, by_chords=True))
        for one in _candidates(sensed, noise, spline)
        if _chord_bias(one, spacing) <= GRID.most_bias * math.sqrt(one.variance)
    ]


def _chord_bias(one: _Candidate, spacing: float) -> float:
    """Error of Φ that noise brings by longer chords [rad]."""
    return 3.0 * 2.0 * (one.spline.route.noise / spacing) ** 2 * one.angle


def _representative(shape: Shape, candidates: list[_Candidate], first: list[_Candidate]) -> Spline:
    """Return the fit that stands for all, with the mean square error of its angle; (151).

    It is the likeliest λ's where that agrees with the mean, else the fit that is nearest to the mean.
    """
    sound = list(_within_bounds(shape, candidates)) or candidates
    criterion = np.array([one.criterion for one in sound])
    angle = np.array([one.angle for one in sound])
    own = np.array([one.variance for one in sound])
    probability = model_probabilities(-0.5 * criterion)
    mean = float(probability @ angle)
    spread = math.sqrt(added_variance(probability, angle, own, mean, 0.0))
    eligible = probability >= PASSES.representative * probability.max()
    if (eligible & (own <= angle**2)).any():
        eligible &= own <= angle**2
    chosen = sound[int(np.argmin(np.where(eligible, np.abs(angle - mean), math.inf)))]
    for one in _within_bounds(shape, first):
        if abs(one.angle - mean) <= GRID.agreement * spread and one.variance <= one.angle**2:
            chosen = one
    best = sound[int(np.argmin(criterion))].spline
    more = added_variance(probability, angle, own, chosen.angle, chosen.variance)
    share = more / max(chosen.angle, 1e-12) ** 2
    return replace(
        chosen.spline,
        deviance=best.deviance,
        ratio_variance=share,
        ratio_length_variance=_added_length_variance(probability, sound, chosen),
    )


def _added_length_variance(probability: Vector, every: list[_Candidate], chosen: _Candidate) -> float:
    """Return what other fits add to the variance of the length of one, over its square [1]; (216)."""
    length = np.array([one.length for one in every])
    own = np.array([one.length_variance * one.spread for one in every])
    return added_variance(probability, length, own, chosen.length, chosen.length_variance) / chosen.length**2


def _within_bounds(shape: Shape, candidates: list[_Candidate]) -> Iterator[_Candidate]:
    polygons = dict[bytes, Polygon]()  # by which points are used
    for one in candidates:
        route = one.spline.route
        key = route.weight.tobytes()
        if key not in polygons:
            polygons[key] = polygon_of(shape, route.weight)
        if not polygons[key].broken(float(route.s[-1]), one.angle, route.noise):
            yield one


def _candidates(shape: Shape, noise: float | None, spline: Spline) -> Iterator[_Candidate]:
    """Fits on a grid of λ about that of a fit, as far as they count."""
    first = _converged(_problem(shape, noise, spline), spline.memory, spline.memory.ratio)
    step = _step(first)
    states = [first, *_aside(first, -step), *_aside(first, step)]
    least = min(state.criterion for state in states)
    for state in states:
        if state.criterion <= least + CHANCE.clear**2:
            fitted = spline_of(shape, state.problem, state.solution, spline.memory.spacing)
            arcs = smooth_geometry(fitted)[1]
            angle, variance = arcs.total_angle, arcs.total_angle_se**2
            of_length = arcs.total_length, arcs.total_length_se**2, _noise_spread(fitted, noise)
            if math.isfinite(angle + variance):
                criterion = state.criterion - 2.0 * math.log(step)
                yield _Candidate(fitted, criterion, angle, variance, *of_length)


def _noise_spread(spline: Spline, noise: float | None) -> float:
    """Return the variance of a Student distribution over a normal one, where the noise is estimated."""
    left = 2.0 * (float(np.count_nonzero(spline.route.weight)) - spline.freedom)
    left = max(left, 3.0)  # a Student distribution needs three for a variance
    return left / (left - 2.0) if noise is None else 1.0


def _aside(first: _State, step: float) -> Iterator[_State]:
    """Yield states at λ in steps [decades] to one side, until two of them do not count or fail."""
    x, state, least, missed = math.log10(first.solution.ratio), first, first.criterion, 0
    for count in range(1, round((SEARCH.most - SEARCH.least) / GRID.narrowest)):
        at = x + step * count
        if missed == GRID.missed or not SEARCH.least <= at <= SEARCH.most:
            break
        missed += 1
        with suppress(FitError):
            state = _converged(state.problem, state.solution, 10.0**at)
            yield state
            missed = missed if state.criterion > least + CHANCE.clear**2 else 0
            least = min(least, state.criterion)


def _problem(shape: Shape, noise: float | None, spline: Spline) -> Problem:
    last = spline.memory
    if shape.directions is not None and noise is None:
        noise = spline.route.noise
    variance = scaled_variance(noise, last.spacing)
    return before_pass(last, variance, last.tangents, shape.direction_noise**2)


def _converged(problem: Problem, before: Solution | LastPass, ratio: float) -> _State:
    """Fit at one λ in passes, until they change little; returns that of the greatest posterior.

    Raises FitError where the points give no finite curve.
    """
    solution, reached, best = before, math.inf, None
    for _ in range(GRID.passes):
        problem, last = next_pass(problem, solution), reached
        solution, reached = _solved(problem, ratio)
        if math.isfinite(reached) and (best is None or reached < best.criterion):
            best = _State(problem, solution, reached)
        if abs(reached - last) < GRID.converged:
            break
    if best is None:
        raise FitError("the points give no finite curve: check the unit, and check for outlying points")
    return best  # at a kink the prior and the curve along which it is linearised sharpen each other


def _solved(problem: Problem, ratio: float) -> tuple[Solution, float]:
    """Solution at one λ, and -2 ln of the posterior of λ; docs/model.md (21), (150)."""
    model, sensed = problem.model, problem.sensed
    inverse_intensity = 0.0 if sensed[0] is None else ratio / problem.variance
    _, log_s, squares, values = core.innovations(*model, *sensed, ratio, inverse_intensity)
    q = problem.variance / ratio or max(squares / max(2 * values, 1), PRIOR.rounding**2 / ratio)
    criterion = 2 * (values * math.log(q) + log_s) + squares / q + SEARCH.price_per_decade * math.log10(ratio)
    if problem.variance == 0.0:
        criterion += noise_price(math.sqrt(ratio * q) / float(model.u[-1] - model.u[0]))
    criterion += _OUTLIER_PRICE * int(np.count_nonzero(model.weight <= 0.0))
    return Solution(
        ratio, q, log_s, squares, values, *core.smooth(*model, *sensed, ratio, inverse_intensity)
    ), criterion


def _step(state: _State) -> float:
    """Distance of neighbouring λ by the posterior about the likeliest one [decades]."""
    near = [
        _solved(state.problem, state.solution.ratio * 10.0**x)[1] for x in (-SEARCH.fine, 0.0, SEARCH.fine)
    ]
    bend = (near[0] - 2.0 * near[1] + near[2]) / SEARCH.fine**2
    if bend <= 0.0:
        return GRID.widest
    return min(max(GRID.deviations * math.sqrt(2.0 / bend), GRID.narrowest), GRID.widest)
