"""The one result of every estimator of a route: mean geometry, its covariance, and the evidence for it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from tssgeom.arrays import Vector, read_only
from tssgeom.result import Result
from tssgeom.route.arcs.chain import Chain
from tssgeom.route.curvature import CurvatureProfile
from tssgeom.route.observations import are_few
from tssgeom.route.pieces import Arcs
from tssgeom.route.route import Route
from tssgeom.route.spline.spline import Spline

Value = TypeVar("Value")


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


class SharedErrors(NamedTuple):
    """Variances that are the same in each frame of a route."""

    angle: float
    """Of Φ [rad²]."""
    length: float
    """Of the length [m²]."""
    form: float = 0.0
    """Part of that of Φ for a form that no point shows [rad²]; docs/model.md (267)."""

    def on(self, arcs: Arcs) -> Arcs:
        """Add them to those of the pieces in proportion to angles and lengths, of no angle to lengths."""
        return arcs if self == NO_ERRORS else arcs.with_variances(self.length, self.angle)

    def beside(self, fit: RouteFit) -> RouteFit:
        """Add them to those of a fit."""
        return fit if self == NO_ERRORS else fit.with_variances(self.length, self.angle)

    def of_models(self, fit: RouteFit) -> RouteFit:
        """Add what other models add to a fit; the angle that a straight route may have is that of (124)."""
        fit = (self if fit.arcs.total_angle != 0.0 else self._replace(angle=0.0)).beside(fit)
        form = fit.arcs.form_variance + self.form
        return replace(fit, arcs=replace(fit.arcs, form_variance=form)) if self.form > 0.0 else fit

    def of_stream(self, fit: RouteFit) -> RouteFit:
        """Do as `of_models`, and note that the fit shares them with the one that it goes on from."""
        fit = self.of_models(fit)
        return replace(fit, arcs=replace(fit.arcs, model_variance=self.angle)) if self.angle > 0.0 else fit


NO_ERRORS = SharedErrors(0.0, 0.0)


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
    by_models: SharedErrors = NO_ERRORS
    """What not knowing the model adds."""
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
        return self.with_variances(0.0, variance)

    def with_variances(self, length: float, angle: float) -> RouteFit:
        """Add variances of the length [m²] and of Φ [rad²], spread over the pieces as these are."""
        nodes = self.nodes
        if angle > 0.0:
            nodes = Deferred(partial(_with_angle_variance, nodes, angle))
        return replace(self, arcs=self.arcs.with_variances(length, angle), nodes=nodes)


def _with_angle_variance(nodes: Deferred[Nodes], variance: float) -> Nodes:
    """Return nodes with a variance of Φ [rad²] beside their own."""
    route, profile = nodes.value
    return Nodes(route, profile.with_angle_variance(variance))


def _with_scaled_angle(nodes: Deferred[Nodes], share: float) -> Nodes:
    """Nodes with all angles times a share, and without errors of them."""
    route, profile = nodes.value
    none = read_only(np.zeros(len(profile.s)))
    kappa, phi = read_only(share * profile.kappa), read_only(share * profile.phi)
    return Nodes(route, replace(profile, kappa=kappa, phi=phi, kappa_se=none, phi_se=none))
