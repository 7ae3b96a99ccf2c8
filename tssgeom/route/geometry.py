"""From sensed points to the estimate of a route: of a spline and a chain of arcs one is selected."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tssgeom import core
from tssgeom.core.constants import CHANCE
from tssgeom.core.constants_arcs import CHAIN_MOVES
from tssgeom.core.constants_route import SPACING
from tssgeom.errors import FitError
from tssgeom.route.agreement import (
    checked,
    is_folded,
    order_warning,
    refuse_folded,
    there_and_back,
    with_order_warning,
)
from tssgeom.route.arcs.chain import Chain, Data, fit_fixed_pieces, unfitted
from tssgeom.route.arcs.corners import cornered
from tssgeom.route.arcs.moves import Budget, fit_chain
from tssgeom.route.arcs.outliers import refitted_with_tangents, with_tangents, without_outliers
from tssgeom.route.arcs.summary import chain_fit, chain_follows, identifiable
from tssgeom.route.bounds import within_bounds
from tssgeom.route.curvature_priors import turned_between
from tssgeom.route.model_average import averaged_over_models
from tssgeom.route.model_choice import (
    CHOICE,
    chain_evidence,
    evidence_difference,
    preference,
)
from tssgeom.route.observations import NOISE_PRIOR, Shape, on_chords
from tssgeom.route.pieces import Arcs, smooth_geometry
from tssgeom.route.ratio_average import averaged
from tssgeom.route.resolution import LIMITS
from tssgeom.route.route import Route, step_lengths
from tssgeom.route.route_fit import Nodes, RouteFit, SharedErrors, available
from tssgeom.route.spline.fit import fit
from tssgeom.route.spline.spline import Spline

Method = Literal["auto", "spline", "arcs"]

_FROM_CHORDS = "the points do not determine their stations: taken from the chords between them"


@dataclass(frozen=True, slots=True)
class ChainStart:
    """Where a chain of arcs is tried, and from which first guesses."""

    quick_moves: int = 8
    """Moves after which a first chain that is still hopeless is given up. Chosen."""
    uncertain_angle: float = 0.03
    """Relative standard error of Φ above which a smooth fit may hide kinks [1]. Chosen; model.md (33)."""
    shortest: float = 1.5
    """Shortest piece of a first guess beside directions [mean spacings]. Chosen: a shorter one may hold no
    point."""


START = ChainStart()
_NOISES = 200  # that are compared across a plane, 1.05 to 1.1 apart
_FEWEST = 5 + 1  # points of a chain: one arc in space has 5 parameters across it beside its joints


def measure(shape: Shape, noise: float | None = None, method: Method = "auto") -> RouteFit:
    """Fit a route to a shape and cut it into pieces.

    Parameters
    ----------
    shape
        Validated points.
    noise
        Known standard deviation of each coordinate [m]; estimated where left out.
    method
        Estimator: the spline, the chain of arcs, or the one with more evidence; docs/model.md (34).

    Returns
    -------
    RouteFit
        Route, profile and pieces, with standard errors.

    Raises
    ------
    FitError
        Where the points give no finite curve.

    Notes
    -----
    Source: docs/model.md (34), (256).

    Examples
    --------
    >>> from tssgeom import clean, measure
    >>> import numpy as np
    >>> angle = np.linspace(0.0, np.pi, 40)  # a half circle of 0.5 m
    >>> points = 0.5 / np.pi * np.column_stack((np.sin(angle), 1 - np.cos(angle), 0 * angle))
    >>> round(float(measure(clean(points)).arcs.total_angle), 4)  # [rad]
    3.1416
    """
    fit = _fitted(shape, noise, method)
    across = noise_of_plane(shape, fit) if noise is None else None
    if across is not None:
        with suppress(FitError):
            fit = _fitted(shape, across, method)
    return with_order_warning(fit, shape)


def _fitted(shape: Shape, noise: float | None, method: Method) -> RouteFit:
    """Fit a route on the stations of the points, or else on those of their chords."""
    try:
        return within_bounds(checked(_measured(shape, noise, method), shape), shape)
    except FitError:
        if shape.stations is not None:
            raise
    try:
        fit = checked(_measured(on_chords(shape), noise, method), shape).warned(_FROM_CHORDS)
    except FitError as error:
        unordered = there_and_back(shape.points)
        unordered = unordered or order_warning(shape.points, shape.index, is_uncertain=True)
        if unordered is None:
            raise
        raise FitError(f"{error} ({unordered})") from error
    return within_bounds(fit, shape)


def _measured(shape: Shape, noise: float | None, method: Method) -> RouteFit:
    spline = averaged(shape, noise, fit(shape, noise))
    smooth = with_few_points_variance(spline_fit(spline), shape)
    if shape.is_of_few and not spline.shared_angle_error:
        smooth = replace(smooth, turned=turned_between(shape.points, smooth, noise, shape.direction_noise))
    if method == "spline" or not chain_allowed(shape, spline):
        refuse_folded(spline.route)
        return averaged_over_models(smooth, smooth, [])
    data = chain_data(shape, noise, spline)
    required = method == "arcs" or is_folded(spline.route)
    tried = list(_chains(data, smooth, spline, required=required))
    sound = [one for one in tried if chain_follows(*one)]
    candidates = sound or (tried if method == "arcs" else [])
    if not candidates:
        if method == "arcs":
            raise FitError("no chain of arcs fits the points: take method auto, or check for outlying points")
        refuse_folded(spline.route)
        return averaged_over_models(smooth, smooth, [])
    scored = [(chain_evidence(*one, spline), *one) for one in candidates]
    evidence, data, chain = max(scored, key=lambda one: one[0].priced)
    arcs = chain_fit(shape, *without_outliers(data, chain))
    if required:
        return arcs
    likelier = arcs if preference(data, chain, spline, evidence) > 0.0 else smooth
    likelier = replace(likelier, spline=smooth.spline, turned=smooth.turned)
    return averaged_over_models(likelier, smooth, candidates)


def _chains(data: Data, smooth: RouteFit, spline: Spline, *, required: bool) -> Iterator[tuple[Data, Chain]]:
    """Chains from every first guess, before and after moves."""
    for given, first in _first_guesses(data, smooth):
        chain: Chain | None = fit_fixed_pieces(given, first)
        budget = Budget(given)
        if not required and given is data:
            chain = _competitive(given, chain, spline, budget)
        for one in () if chain is None else (fit_chain(given, chain, budget), chain):
            weighted, fitted = refitted_with_tangents(given, one, budget)
            with suppress(FitError):
                yield weighted, identifiable(weighted, fitted, budget=budget)[0]


def _first_guesses(data: Data, smooth: RouteFit) -> Iterator[tuple[Data, Chain]]:
    """First guesses of a chain: the pieces of the smooth fit, and where that is uncertain, corners."""
    yield data, first_chain(data, smooth)
    sure = smooth.arcs.total_angle_se <= START.uncertain_angle * smooth.arcs.total_angle
    if not sure or smooth.noise > SPACING.uneven * data.spacing:
        guess = cornered(data, smooth.route)
        if guess is not None:
            yield guess


def spline_fit(spline: Spline) -> RouteFit:
    """Profile and pieces of a smooth fit."""
    route = spline.route
    profile, arcs = smooth_geometry(spline)
    smooth = RouteFit(
        arcs=arcs,
        noise=route.noise,
        weight=route.weight,
        nodes=available(Nodes(route, profile)),
        evidence=available(-0.5 * spline.deviance),
        warnings=spline.warnings,
        spline=spline,
    )
    return smooth.with_angle_variance(spline.ratio_variance * arcs.total_angle**2)


def with_few_points_variance(smooth: RouteFit, shape: Shape) -> RouteFit:
    """Add to the length of few points what other λ give, (216), or what the error of the angle means, (166).

    Whichever is more: arcs exceed the chords between few points with the square of the angle.
    """
    if not shape.is_of_few:
        return smooth
    arcs = smooth.arcs
    longer = arcs.total_length - float(np.sum(step_lengths(shape.points[smooth.weight > 0.0])))
    by_angle = 2.0 * max(longer, 0.0) * arcs.total_angle_se / max(arcs.total_angle, 1e-12)
    by_ratio = 0.0 if smooth.spline is None else smooth.spline.ratio_length_variance * arcs.total_length**2
    return replace(smooth, arcs=SharedErrors(0.0, max(by_angle**2, by_ratio)).on(arcs))


def chain_data(shape: Shape, noise: float | None, spline: Spline) -> Data:
    """Points as the chain needs them, weighted as in the spline that was fitted to them."""
    variance, route = 0.0 if noise is None else noise * noise, spline.route
    spacing = core.spacing_of_pieces(shape.points, float(route.s[-1]))
    data = Data(shape.points, np.array(route.weight), shape.stations is None, variance, spacing)
    if shape.directions is None:
        return data
    kappa = np.interp(route.station, route.s, np.linalg.norm(route.curvature_vector, axis=1))
    return with_tangents(data, spline.memory.tangents, shape.direction_noise**2, kappa, route.noise**2)


def chain_allowed(shape: Shape, spline: Spline) -> bool:
    """Whether there are points enough, with errors of their own."""
    return len(shape.points) >= _FEWEST and spline.shared_angle_error == 0.0


def _competitive(data: Data, chain: Chain, spline: Spline, budget: Budget) -> Chain | None:
    """Return the chain after a few moves, or None where its evidence stays hopeless beside the spline."""
    for _ in range(START.quick_moves):
        if evidence_difference(data, chain, spline) >= CHOICE.hopeless:
            return chain
        before, chain = chain, fit_chain(data, chain, budget, 1)
        if chain is before:
            return None
    return chain if evidence_difference(data, chain, spline) >= CHOICE.hopeless else None


def first_chain(data: Data, smooth: RouteFit) -> Chain:
    """First guess of a chain from a smooth fit; directions identify even pieces of few points."""
    chain = _chain_of_pieces(smooth.route, smooth.arcs)
    return _merged(chain, 0.0 if data.tangents is None else START.shortest * data.spacing)


def _chain_of_pieces(route: Route, arcs: Arcs) -> Chain:
    """Chain with the joints of the spline's pieces, and the mean curvature vector of each."""
    tangent = route.tangent[0]
    first, second = core.normals(tangent)
    parts = core.parallel_components(route.tangent, route.curvature_vector)
    at = np.searchsorted(route.s, np.append(arcs.s_start, route.s[-1]))
    bend = np.array([parts[a : max(b, a + 1)].mean(axis=0) for a, b in itertools.pairwise(at)])
    axes = np.array([tangent, first, second])
    return unfitted(route.position[0], axes, arcs.s_start, bend, np.array(route.station))


def _merged(chain: Chain, shortest: float) -> Chain:
    """Merge pieces below a length [m], and the shortest of too many, with the neighbour that bends alike.

    A smooth fit that follows the noise has hundreds of pieces, and the work of a chain grows with their cube.
    """
    joints, bend = np.append(chain.joints, chain.stations[-1]), chain.bend
    while len(bend) > 1:
        length = np.diff(joints)
        i = int(np.argmin(length))
        if length[i] >= shortest and len(bend) <= CHAIN_MOVES.most_pieces:
            break
        unlike = np.linalg.norm(np.diff(bend, axis=0), axis=1)
        lower = min(range(max(i - 1, 0), min(i + 1, len(bend) - 1)), key=lambda j: unlike[j])
        pair = slice(lower, lower + 2)
        mean = length[pair] @ bend[pair] / length[pair].sum()
        bend = np.vstack((bend[:lower], mean, bend[lower + 2 :]))
        joints = np.delete(joints, lower + 1)
    return unfitted(chain.start, chain.axes, joints[:-1], bend, chain.stations)


def noise_of_plane(shape: Shape, fit: RouteFit) -> float | None:
    """Return the noise [m] of few points that lie in a plane too exactly for that of a fit, else None.

    White noise is the same in each direction. What lies in the plane is then bends, not noise. Points
    that lie in it exactly were not sensed across it, and show nothing; docs/model.md (256), (257).

    Parameters
    ----------
    shape
        Validated points, whose noise is not known.
    fit
        Fit by a noise that was estimated.
    """
    points = shape.points[fit.weight > 0.0]
    free = len(points) - 3
    shared = fit.spline is not None and fit.spline.shared_angle_error > 0.0
    if not shape.is_of_few or shape.directions is not None or shared or free < 1:
        return None
    length = float(np.sum(step_lengths(points)))
    square = float(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1]) ** 2
    share = square / (free * max(fit.noise, 1e-300) ** 2)
    if square <= free * (LIMITS.noiseless * length) ** 2 or share >= 1.0:
        return None
    if free * (share - 1.0 - math.log(share)) <= CHANCE.clear**2:
        return None
    noise = np.geomspace(LIMITS.noiseless * length, fit.noise, _NOISES)
    decades = np.log10(noise / (NOISE_PRIOR.typical * length)) / NOISE_PRIOR.decades
    return float(noise[np.argmin(2.0 * free * np.log(noise) + square / noise**2 + decades**2)])
