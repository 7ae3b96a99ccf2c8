"""Whether a fitted route agrees with its points, with their order, and with a length that is known."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Points, Vector, read_only, rows_at
from tssgeom.core.constants import CHANCE, ROUNDING
from tssgeom.core.constants_arcs import CHAIN_FIT
from tssgeom.core.constants_route import POINTS
from tssgeom.errors import FitError
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.route.curvature import CurvatureProfile
from tssgeom.route.observations import BACK, Shape
from tssgeom.route.order import LIMITS as ORDER
from tssgeom.route.order import shortest_path
from tssgeom.route.pieces import Arcs
from tssgeom.route.route import STATIONS, Route, step_lengths
from tssgeom.route.route_fit import LITTLE, Deferred, Nodes, RouteFit


@dataclass(frozen=True, slots=True)
class AgreementLimits:
    """Whether a fitted route still follows its points."""

    most_ignored: float = 1 / 3
    """Share of the points without weight, above which the fit is refused; share of the inputs of a batch that
    are outlying, above which they are spread instead [1]. Chosen."""
    longest_path: float = 1.3
    """Path from point to point over the length of the route with its noise [1]. Derived: chords are shorter
    than arcs, so 1 plus an allowance for noise."""
    largest_angle_se: float = 20 * math.pi
    """Standard error of Φ above which the fit is refused [rad]. Chosen: ten full loops."""


AGREEMENT = AgreementLimits()
_COMPARED = 41  # points of both ways; numerical
_PATH = "the path through the points is"


def checked(result: RouteFit, shape: Shape, before: RouteFit | None = None) -> RouteFit:
    """Return a fit given the length of the whole route where that is known, unless it lost its points.

    One that goes on from `before` has the warning on the order of its points, where that has it.
    Points that share errors with their neighbours are left alone: their path is longer than noise explains.

    Raises FitError where it lost them.
    """
    if shape.length is not None:
        result = given_length(result, shape.length, shape.length_noise)
    if result.spline is None or result.spline.shared_angle_error == 0.0:
        refuse_lost(result, shape.points)
    return result if before is None else with_order_warning(result, shape, before)


def given_length(fit: RouteFit, length: float, noise: float) -> RouteFit:
    """Posterior of lengths and angles, given the length of the whole route; docs/model.md (95), (96).

    Parameters
    ----------
    fit
        The fit without it.
    length, noise
        The length and its standard deviation [m]. One that is off by more than four standard errors changes
        nothing and is named in a warning.
    """
    arcs = fit.arcs
    k = len(arcs.length)
    shared = arcs.covariance[:, :k].sum(axis=1)  # of all lengths and angles with the whole length
    own = max(float(shared[:k].sum()), 0.0)
    variance = own + noise**2
    off, rounding = length - arcs.total_length, ROUNDING.relative * length
    if abs(off) > CHANCE.rare * math.sqrt(variance) + rounding:
        return fit.warned(_length_warning(-off, length, math.sqrt(variance)))
    if own <= rounding**2:
        return fit
    gain = shared / variance  # docs/model.md (95)
    moved = _stepped(arcs, gain * off, arcs.covariance - np.outer(gain, shared))
    return replace(fit, nodes=Deferred(partial(_nodes_given_length, fit.nodes, arcs, moved)), arcs=moved)


def _length_warning(longer: float, length: float, se: float) -> str:
    return (
        f"the route is {1e3 * abs(longer):.3g} mm {'longer' if longer > 0 else 'shorter'} "
        f"than the stated length of {1e3 * length:.6g} mm, with a standard error of {1e3 * se:.2g} mm: "
        "check for points beyond the ends, a wrong unit or a wrong length"
    )


def _stepped(arcs: Arcs, step: Vector, covariance: Matrix) -> Arcs:
    """Pieces with other lengths and angles, of which none becomes negative."""
    k = len(arcs.length)
    return replace(
        arcs,
        length=read_only(np.maximum(arcs.length + step[:k], 1e-3 * arcs.length)),
        angle=read_only(np.maximum(arcs.angle + step[k:], 0.0)),
        covariance=read_only(covariance),
    )


def _joints(arcs: Arcs) -> Vector:
    return np.append(arcs.s_start, arcs.total_length)


def _nodes_given_length(nodes: Deferred[Nodes], arcs: Arcs, moved: Arcs) -> Nodes:
    route, profile = nodes.value
    return Nodes(_with_ends_stretched(route, arcs, moved), _with_moved_pieces(profile, arcs, moved))


def _with_ends_stretched(route: Route, arcs: Arcs, moved: Arcs) -> Route:
    """Route with both end pieces stretched along their tangents."""
    before, after = _joints(arcs), _joints(moved)
    first = (after[1] - before[1]) / (2.0 if len(before) == 2 else 1.0)  # a single piece grows at both ends
    s, station = np.interp(route.s, before, after), np.interp(route.station, before, after)
    along, foot_along = s - route.s - first, station - route.station - first
    tangent = rows_at(route.station, route.s, route.tangent)
    return replace(
        route,
        s=read_only(s),
        position=read_only(route.position + along[:, None] * route.tangent),
        station=read_only(station),
        residual=read_only(route.residual - foot_along[:, None] * tangent),
    )


def _with_moved_pieces(profile: CurvatureProfile, arcs: Arcs, moved: Arcs) -> CurvatureProfile:
    """Profile whose length and angle are those of the moved pieces."""
    before = _joints(arcs)
    s = np.interp(profile.s, before, _joints(moved))
    piece = np.clip(np.searchsorted(before, profile.s, side="right") - 1, 0, len(arcs.angle) - 1)
    more = np.cumsum(moved.angle - arcs.angle)
    grown = (moved.angle - arcs.angle)[piece] * (profile.s - before[piece]) / arcs.length[piece]
    phi = profile.phi + np.concatenate(([0.0], more))[piece] + grown
    phi[-1] = moved.total_angle
    share = moved.total_angle_se / max(profile.total_angle_se, 1e-300)
    return replace(profile, s=read_only(s), phi=read_only(phi), phi_se=read_only(profile.phi_se * share))


def is_folded(route: Route) -> bool:
    """Whether a route turns straight back between two nodes, which its curvature does not show.

    It may also go straight on there and lose the points, whose residuals along the route are then large.
    """
    tangent = route.tangent
    if np.einsum("ij,ij->i", tangent[1:], tangent[:-1]).min() < 0.0:
        return True
    residual = route.residual[route.weight > 0.0]
    spacing = float(route.s[-1]) / len(route.weight)
    return is_off(float(np.vdot(residual, residual)), len(residual), spacing, route.noise)


def is_off(squares: float, points: int, spacing: float, noise: float) -> bool:
    """Whether points are off a route by more than their spacing and noise [m], by the sum of squares [m²]."""
    return squares > points * (spacing**2 + (CHANCE.clear * noise) ** 2)


def refuse_folded(route: Route) -> None:
    """Refuse a route that turns straight back between two nodes; raises FitError where it does."""
    if is_folded(route):
        raise FitError(
            "no route fits the points: between some of them it turns straight back, or more sharply than "
            "they show: sense it more densely there, and check for points out of order"
        )


def refuse_lost(fit: RouteFit, points: Points) -> None:
    """Refuse a fit that lost its points [m] on the way, as where a route turns back between two of them.

    Raises FitError where a number is not finite, a piece has no length, the angle is unknown, many points
    were ignored, or the path from point to point is longer than the route, or far shorter.
    """
    arcs = fit.arcs
    length, angle_se, shortest, every, ignored, path = core.totals(
        arcs.length, arcs.angle, arcs.covariance, points, fit.weight
    )
    if not math.isfinite(every) or shortest <= 0.0:
        raise FitError("the points give no finite curve: check the unit, and check for outlying points")
    chord = math.hypot(length / len(points), math.sqrt(6.0) * fit.noise)
    too_long = path > AGREEMENT.longest_path * len(points) * chord
    lost = ignored > AGREEMENT.most_ignored * len(points) or too_long
    if lost or length > STATIONS.refusal * path:
        raise FitError(
            f"no route fits the points, {ignored} of {len(points)} lie off it: sense it more densely where "
            "it turns sharply, and check for points out of order"
        )
    if angle_se > AGREEMENT.largest_angle_se:
        raise FitError(
            f"{len(points)} points do not determine how far the route turns: sense it more densely where it "
            "turns sharply, and check for points out of order"
        )


def turns_unobserved(points: Points, weight: Vector, stations: Vector, turned: Vector) -> bool:
    """Whether a route turns between its points by more than these could show.

    Parameters
    ----------
    points, weight
        Sensed points [m], and the weight of each; 0 where it was ignored [1].
    stations, turned
        Arc length [m] and accumulated angle [rad] of the route at the points.
    """
    length = stations[-1] - stations[0]
    detour = length > STATIONS.refusal * core.path_length(points, weight)[1]
    return bool(detour or np.diff(turned[weight > 0.0]).max() > 2.0 * CHAIN_FIT.most_turn)


def order_warning(points: Points, index: Vector | None = None, *, is_uncertain: bool = False) -> str | None:
    """Say that points [n, 3] [m] lie on a much shorter path in another order, or return None.

    Parameters
    ----------
    points, index
        Points, and the count of each in the sensed sequence.
    is_uncertain
        Whether their fit has a warning, or shows little of Φ: a slightly shorter path is then worth a word.

    Raises
    ------
    FitError
        Where the other path is so much shorter that no fit means anything.
    """
    if not 4 <= len(points) <= POINTS.few:
        return None
    path = shortest_path(points)
    given, shortest = float(step_lengths(points).sum()), float(step_lengths(points[path]).sum())
    if given < (ORDER.slightly_shorter if is_uncertain else ORDER.much_shorter) * shortest:
        return None
    order = _described(path, np.arange(len(points)) if index is None else index.astype(int))
    text = f"{_PATH} {1e3 * given:.4g} mm long, {order} {1e3 * shortest:.4g} mm: check their order, "
    if given < STATIONS.refusal * shortest:
        return f'{text}or set [shape] order = "shortest"'
    raise FitError(f'{text}set [shape] order = "shortest", or give their arc lengths if it is right')


def with_order_warning(fit: RouteFit, shape: Shape, before: RouteFit | None = None) -> RouteFit:
    """Return a fit with `order_warning`; one that goes on from `before` where that has it, or turns back.

    A new fit may have the warning of `there_and_back` instead.

    Raises FitError where the points are far out of order.
    """
    if shape.stations is not None:
        return fit
    turns_back = _turns_back(shape.points) or any(BACK in text for text in fit.warnings)
    had_it = before is None or any(text.startswith(_PATH) for text in before.warnings)
    if not (had_it or turns_back):
        return fit
    is_uncertain = turns_back or len(fit.warnings) > 0 or fit.arcs.total_angle_se > LITTLE
    text = there_and_back(shape.points) if before is None else None
    text = text or order_warning(shape.points, shape.index, is_uncertain=is_uncertain)
    return fit if text is None else fit.warned(text)


def _turns_back(points: Points) -> bool:
    """Whether few points [n, 3] turn so sharply from chord to chord as exchanged ones do."""
    if len(points) > POINTS.few:
        return False
    chord = np.diff(points, axis=0)
    along = np.einsum("ij,ij->i", chord[1:], chord[:-1])
    square = np.einsum("ij,ij->i", chord, chord)
    sharpest = math.cos(CHAIN_FIT.most_turn)
    return bool((along < sharpest * np.sqrt(square[1:] * square[:-1])).any())


def there_and_back(points: Points) -> str | None:
    """Say that points [n, 3] [m] run along one route there and back, or return None."""
    at = np.concatenate(([0.0], np.cumsum(step_lengths(points))))
    share = np.linspace(0.0, 0.5, _COMPARED)
    there, back = (rows_at(way * at[-1], at, points) for way in (share, 1.0 - share))
    if float(np.median(np.linalg.norm(there - back, axis=1))) > PLAUSIBLE.slight * 0.5 * at[-1]:
        return None
    return "the points run there and back: give either way as a shape to analyse --same if it is one route"


def _described(path: np.ndarray, index: np.ndarray) -> str:
    """Name what a path exchanges, or else its first points: "with points 3 and 4 exchanged"."""
    moved = np.flatnonzero(path != np.arange(len(path)))
    if len(moved) == 2:  # of more it is not clear which goes where
        return f"with points {' and '.join(map(str, index[moved]))} exchanged"
    listed = index[path]
    return f"in the order {' '.join(map(str, listed if len(path) <= 12 else (*listed[:3], '…')))}"
