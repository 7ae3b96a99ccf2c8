"""Constant-curvature pieces: what the tendon model needs to know of a route."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.result import Result
from tssgeom.route.curvature import CurvatureProfile
from tssgeom.route.spline.spline import Spline

_SHORTEST = 0.1  # of a piece: what moved bends leave of its length [1]; chosen: the pieces stay in order


@dataclass(frozen=True, slots=True, repr=False)
class Arcs(Result):
    """A route as pieces of constant curvature, proximal to distal; a straight piece has angle 0."""

    length: Vector
    """Arc length of each piece [m]."""
    angle: Vector
    """Accumulated curve angle of each piece, >= 0 [rad]."""
    covariance: Matrix
    """Covariance of all lengths followed by all angles, 2k by 2k [m, rad]."""
    method: str
    """Estimator behind the pieces: "spline", "arcs", or "exact" for given numbers."""
    form_variance: float = 0.0
    """Part of the variance of Φ that comes from a form which no point shows, in `covariance` in proportion to
    the angles: it is the same in each frame [rad²]."""
    model_variance: float = 0.0
    """Part of the variance of Φ from not knowing the model, that of the form included: fits that go on from
    frame to frame share it; 0 of one from nothing [rad²]."""

    @classmethod
    def exact(cls, length: Vector, angle: Vector) -> Arcs:
        """Pieces that are known without error: lengths [m] and angles [rad]."""
        length, angle = np.atleast_1d(length), np.atleast_1d(angle)
        return cls(read_only(length), read_only(angle), read_only(np.zeros((2 * len(length),) * 2)), "exact")

    def with_errors(self, factor: float) -> Arcs:
        """Return the pieces with all of their standard errors times a factor."""
        square = factor**2
        return replace(
            self,
            covariance=square * self.covariance,
            form_variance=square * self.form_variance,
            model_variance=square * self.model_variance,
        )

    def scaled(self, length: float = 1.0, angle: float = 1.0) -> Arcs:
        """Return the pieces with all lengths and all angles times a factor each, as their errors are."""
        if length == angle == 1.0:
            return self
        factor = np.repeat((length, angle), len(self.length))
        covariance = read_only(self.covariance * np.outer(factor, factor))
        return replace(
            self,
            length=read_only(length * self.length),
            angle=read_only(angle * self.angle),
            covariance=covariance,
            form_variance=angle**2 * self.form_variance,
            model_variance=angle**2 * self.model_variance,
        )

    def with_variances(self, length: float, angle: float) -> Arcs:
        """Return the pieces with variances of L [m²] and of Φ [rad²] beside their own.

        They are spread over the pieces in proportion to lengths and angles, that of no angle to lengths.
        """
        k, covariance = len(self.length), np.array(self.covariance)
        if length > 0.0:
            covariance[:k, :k] += spread_over(self.length, length)
        if angle > 0.0:
            covariance[k:, k:] += spread_over(self.angle if self.total_angle > 0.0 else self.length, angle)
        covariance.flags.writeable = False
        return replace(self, covariance=covariance)

    def moved(self, by: Vector) -> Arcs:
        """Return the pieces with all lengths and all angles changed [2k] [m, rad], their errors as they are.

        No piece gets shorter than a tenth, and none turns back.
        """
        length, angle = np.split(np.concatenate((self.length, self.angle)) + by, 2)
        length = np.maximum(length, _SHORTEST * self.length)
        return replace(self, length=read_only(length), angle=read_only(np.maximum(angle, 0.0)))

    @property
    def noise_covariance(self) -> Matrix:
        """Covariance of what differs from frame to frame, as `covariance`; docs/model.md (321)."""
        return self._without(max(self.form_variance, self.model_variance))

    @property
    def noise_angle_se(self) -> float:
        """Standard error of the accumulated curve angle by what differs from frame to frame [rad]."""
        k = len(self.length)
        return math.sqrt(max(float(self.noise_covariance[k:, k:].sum()), 0.0))

    @property
    def covariance_without_form(self) -> Matrix:
        """Covariance without that of a form which no point shows, as `covariance`."""
        return self._without(self.form_variance)

    def _without(self, variance: float) -> Matrix:
        if variance == 0.0 or self.total_angle == 0.0:
            return self.covariance
        k = len(self.length)
        covariance = np.array(self.covariance)
        covariance[k:, k:] -= spread_over(self.angle, variance)
        return covariance

    @property
    def kappa(self) -> Vector:
        """Curvature of each piece [1/m]."""
        return self.angle / self.length

    @property
    def s_start(self) -> Vector:
        """Arc length at which each piece begins [m]."""
        return np.concatenate(([0.0], np.cumsum(self.length)[:-1]))

    @property
    def angle_se(self) -> Vector:
        """Standard error of the angle of each piece, the bend that points may hide included [rad]; (124)."""
        k = len(self.length)
        return np.sqrt(np.maximum(self.covariance.diagonal()[k:], 0.0))

    @property
    def total_length(self) -> float:
        """Arc length of the whole route [m]."""
        return math.fsum(self.length)

    @property
    def total_angle(self) -> float:
        """Accumulated curve angle of the whole route, Φ [rad]; docs/model.md (1)."""
        return math.fsum(self.angle)

    @property
    def total_angle_se(self) -> float:
        """Standard error of the accumulated curve angle [rad]."""
        k = len(self.length)
        return math.sqrt(max(float(self.covariance[k:, k:].sum()), 0.0))

    @property
    def total_length_se(self) -> float:
        """Standard error of the arc length of the whole route [m]."""
        k = len(self.length)
        return math.sqrt(max(float(self.covariance[:k, :k].sum()), 0.0))


def smooth_geometry(spline: Spline) -> tuple[CurvatureProfile, Arcs]:
    """Curvature of a fitted route, and its pieces of constant curvature that keep its length and angle.

    The joints come from exact dynamic programming on the curvature vector in the parallel-transport
    frame, their number from the Bayesian information criterion; docs/model.md (23) to (27).
    """
    route = spline.route
    profile, pieces, covariance = core.curvature_profile(
        route.s,
        route.tangent,
        route.curvature_vector,
        spline.covariance,
        spline.gain,
        spline.freedom,
        route.noise,
        spline.stations_known,
        spline.shared_angle_error,
        spline.tangent_share,
        route.station,
        spline.joints,
    )
    for array in (profile, pieces, covariance):
        array.flags.writeable = False
    kappa, phi, kappa_se, phi_se = profile
    length, angle = pieces
    return CurvatureProfile(route.s, kappa, phi, kappa_se, phi_se), Arcs(length, angle, covariance, "spline")


def curvature_profile(spline: Spline) -> CurvatureProfile:
    """Return curvature and accumulated curve angle of a fitted route; docs/model.md (23) to (26).

    Parameters
    ----------
    spline
        A fitted route, as of `fit`.

    Returns
    -------
    CurvatureProfile
        Curvature [m] [1/m] and curve angle [m] [rad] at the nodes, with standard errors.

    Examples
    --------
    >>> from tssgeom import clean, curvature_profile, fit
    >>> import numpy as np
    >>> angle = np.linspace(0.0, np.pi, 40)  # a half circle of 0.5 m
    >>> points = 0.5 / np.pi * np.column_stack((np.sin(angle), 1 - np.cos(angle), 0 * angle))
    >>> round(float(curvature_profile(fit(clean(points), noise=1e-4)).total_angle), 2)  # [rad]
    3.14
    """
    return smooth_geometry(spline)[0]


def constant_curvature_pieces(spline: Spline) -> Arcs:
    """Cut a fitted route into pieces of constant curvature, as `smooth_geometry` does.

    Parameters
    ----------
    spline
        A fitted route, as of `fit`.

    Returns
    -------
    Arcs
        Length [k] [m] and curve angle [k] [rad] of each piece, with their covariance.

    Examples
    --------
    >>> from tssgeom import clean, constant_curvature_pieces, fit
    >>> import numpy as np
    >>> angle = np.linspace(0.0, np.pi, 40)  # a half circle of 0.5 m
    >>> points = 0.5 / np.pi * np.column_stack((np.sin(angle), 1 - np.cos(angle), 0 * angle))
    >>> len(constant_curvature_pieces(fit(clean(points), noise=1e-4)).length)
    1
    """
    return smooth_geometry(spline)[1]


def spread_over(value: Vector, variance: float) -> Matrix:
    """Spread the variance of a sum of angles or lengths over the pieces in proportion to these [k, k]."""
    share = value / max(value.sum(), 1e-12)  # a chain that is refused may even turn back
    return (variance * share)[:, None] * share
