"""The one result of every estimator of a route: mean geometry, its covariance, and the evidence for it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Points, Vector, read_only, rows_at
from tssgeom.core.constants import CHANCE, ROUNDING
from tssgeom.core.constants_arcs import CHAIN_FIT
from tssgeom.errors import FitError
from tssgeom.result import Result
from tssgeom.route.arcs.chain import Chain
from tssgeom.route.curvature import CurvatureProfile
from tssgeom.route.observations import are_few
from tssgeom.route.pieces import Arcs
from tssgeom.route.route import STATIONS, Route
from tssgeom.route.spline.spline import Spline

Value = TypeVar("Value")


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
LITTLE = math.radians(
    45.0
)  # s.e. of Φ from which it is hardly known: 11 % of T_out with the paper's μ; chosen
LOST = 2.0 * math.pi  # standard error of Φ from which a frame is no start for the next [rad]; chosen: a turn


class Turned(NamedTuple):
    """What a route may turn between few points by a prior of its curvature; docs/model.md (235)."""

    angle: float
    """Mean of Φ less that of the smooth fit [rad]."""
    angle_variance: float
    """Variance of Φ [rad²]."""
    length: float
    """Mean length less that of the smooth fit [m]."""
    length_variance: float
    """Variance of the length [m²]."""
    log_evidence: float
    """ln of the evidence for the prior."""


class Nodes(NamedTuple):
    """A route and its curvature on the same nodes."""

    route: Route
    profile: CurvatureProfile


@dataclass(frozen=True)  # without slots: the value is kept
class Deferred(Generic[Value]):
    """A value that is computed when it is first asked for, and kept."""

    compute: Callable[[], Value]

    @property
    def value(self) -> Value:
        """The value.

        Threads do not wait for each other, as those of `cached_property` do, also where the values differ:
        two that ask at once compute it twice.
        """
        if "_known" not in self.__dict__:
            self.__dict__["_known"] = self.compute()
        return self.__dict__["_known"]


def available(value: Value) -> Deferred[Value]:
    """Return a value that needs no computing, where one that is deferred is expected."""
    return Deferred(partial(_same, value))


def _same(value: Value) -> Value:
    return value


@dataclass(frozen=True, slots=True, repr=False)
class RouteFit(Result):
    """A route estimated from one frame, by whichever estimator.

    A stream needs the pieces of every frame; nodes and evidence cost more than those and are computed when
    they are first asked for.
    """

    arcs: Arcs
    """Pieces of constant curvature, with the covariance of their lengths and angles."""
    noise: float
    """Standard deviation of one coordinate of the points, known or estimated [m]."""
    weight: Vector
    """Weight of each sensed point: 1, or 0 for an outlier."""
    nodes: Deferred[Nodes]
    """Route and curvature profile on nodes."""
    evidence: Deferred[float]
    """ln of the evidence of the observations."""
    warnings: tuple[str, ...] = ()
    """What the user should know of the fit."""
    by_models: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """What not knowing the model adds to the variances of Φ [rad²] and of the length [m²], and the part
    of the former for a form that no point shows [rad²]."""
    turned: tuple[Turned, ...] = ()
    """What few points allow beside the smooth fit, by priors of which the last one is smooth."""
    resolution: float = 0.0
    """Length of the shortest wave that counts [m]; 0 where all do that were fitted."""
    spline: Spline | None = None
    """The smooth fit, where one was made: the next fit of a moving route starts from it."""
    chain: Chain | None = None
    """The chain of arcs, where it was selected: the next fit of a moving route starts from it."""

    @property
    def route(self) -> Route:
        """Mean of the route on its nodes, and where the points lie beside it."""
        return self.nodes.value.route

    @property
    def profile(self) -> CurvatureProfile:
        """Curvature and accumulated angle on the same nodes, with standard errors."""
        return self.nodes.value.profile

    @property
    def log_evidence(self) -> float:
        """Evidence of the points or curvatures (natural logarithm); to compare fits of the same only."""
        return self.evidence.value

    def strip(self) -> RouteFit:
        """Return the fit without what only the next fit needs."""
        return replace(self, spline=None, chain=None, turned=())

    def warned(self, text: str) -> RouteFit:
        """Return the fit with one warning more."""
        return replace(self, warnings=(*self.warnings, text))

    def scaled(self, share: float, arcs: Arcs) -> RouteFit:
        """Return the fit with other pieces, whose angles are all this share, and without errors of angles."""
        return replace(self, arcs=arcs, nodes=Deferred(partial(_with_scaled_angle, self.nodes, share)))

    @property
    def is_of_few(self) -> bool:
        """Whether its points are so few that models and λ are averaged; docs/model.md (150)."""
        return are_few(self.weight)

    def with_angle_variance(self, variance: float) -> RouteFit:
        """Add a variance of Φ [rad²], spread over profile and pieces as the angle is; not where none is."""
        if variance == 0.0 or self.arcs.total_angle == 0.0:
            return self
        nodes = Deferred(partial(nodes_with_angle_variance, self.nodes, variance))
        return replace(self, nodes=nodes, arcs=self.arcs.with_variances(0.0, variance))


def nodes_with_angle_variance(nodes: Deferred[Nodes], variance: float) -> Nodes:
    """Return nodes with a variance of Φ [rad²] beside their own."""
    route, profile = nodes.value
    return Nodes(route, profile.with_angle_variance(variance))


def _with_scaled_angle(nodes: Deferred[Nodes], share: float) -> Nodes:
    """Nodes with all angles times a share, and without errors of them."""
    route, profile = nodes.value
    none = read_only(np.zeros(len(profile.s)))
    kappa, phi = read_only(share * profile.kappa), read_only(share * profile.phi)
    return Nodes(route, replace(profile, kappa=kappa, phi=phi, kappa_se=none, phi_se=none))


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
    length, _, angle_se, shortest, every = core.totals(arcs.length, arcs.angle, arcs.covariance)
    if not math.isfinite(every) or shortest <= 0.0:
        raise FitError("the points give no finite curve: check the unit, and check for outlying points")
    ignored, path = core.path_length(points, fit.weight)
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
