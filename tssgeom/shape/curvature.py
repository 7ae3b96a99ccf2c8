"""Curvature and accumulated curve angle of a fitted route, with standard errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.shape.route import Route
from tssgeom.shape.spline import Spline
from tssgeom.shape.stations import accumulated

_NATURAL_ENDS = (
    1e-3  # relative error of an exact circle over the fourth power of its turn from point to point
)
_ROUNDING = 1e-8
_RECTIFIED = 0.3  # share of the Rician excess taken as one standard error; see docs/model.md (26)


@dataclass(frozen=True, slots=True)
class CurvatureProfile:
    """Curvature along a route, on its nodes."""

    s: Vector
    """Arc length [m]."""
    kappa: Vector
    """Curvature, freed of the bias that noise gives to a magnitude [1/m]."""
    phi: Vector
    """Accumulated curve angle [rad]."""
    kappa_se: Vector
    """Standard error of the curvature [1/m]."""
    phi_se: Vector
    """Standard error of the accumulated curve angle [rad]."""

    @property
    def length(self) -> float:
        """Length of the route [m]."""
        return float(self.s[-1])

    @property
    def total_angle(self) -> float:
        """Accumulated curve angle of the whole route, Φ [rad]."""
        return float(self.phi[-1])

    @property
    def total_angle_se(self) -> float:
        """Standard error of Φ [rad]."""
        return float(self.phi_se[-1])


def curvature_profile(spline: Spline) -> CurvatureProfile:
    """Curvature and accumulated curve angle of a fitted route; docs/model.md (23) to (26)."""
    route = spline.route
    square = np.einsum("ij,ij->i", route.curvature_vector, route.curvature_vector)
    variance = spline.covariance[:, 5]
    kappa = _without_noise(square, variance * _noise_share(spline.freedom))
    phi = accumulated(route.s, kappa)
    spread, _ = angle_covariance(spline, np.array([0, len(kappa) - 1]))
    if not spline.stations_known:
        spread = spread + _end_variance(route, kappa)
    spread = spread + (_relative_doubt(spline, phi) * phi) ** 2
    doubt = _RECTIFIED * accumulated(route.s, np.sqrt(square + variance) - np.sqrt(square))
    return CurvatureProfile(
        s=route.s,
        kappa=read_only(kappa),
        phi=read_only(phi),
        kappa_se=read_only(np.sqrt(variance)),
        phi_se=read_only(np.sqrt(spread + doubt * doubt)),
    )


def _end_variance(route: Route, kappa: Vector) -> Vector:
    """Variance from unknown stations of the ends: a point shifted along the route takes its angle along."""
    return np.where(route.s > 0.0, route.noise**2 * (kappa[0] ** 2 + kappa**2), 0.0)


def _relative_doubt(spline: Spline, phi: Vector) -> float:
    """Relative error of angles from errors that points share, and from the natural ends of a spline."""
    turn = float(phi[-1]) / (len(spline.route.weight) - 1)
    return float(np.hypot(spline.angle_doubt, _NATURAL_ENDS * turn**4 + _ROUNDING))


def _noise_share(freedom: float) -> float:
    """Part of the posterior variance of the curvature that is noise, not smoothing; docs/model.md (24)."""
    return (1.0 + 5.0 * min(3.0 / freedom, 1.0) ** 2) / 6.0


def _without_noise(square: Vector, noise: Vector) -> Vector:
    """Magnitude of the curvature vector less what noise adds to its square; docs/model.md (25).

    Well above the noise only the component across the bend lengthens the vector; near zero both do.
    """
    components = 1.0 + 2.0 * noise / (square + 2.0 * noise + 1e-300)
    return np.sqrt(np.maximum(square - components * noise, 0.0))


def angle_covariance(spline: Spline, breaks: np.ndarray) -> tuple[Vector, Matrix]:
    """Variance of φ at each node, covariance of the angles between the nodes `breaks`; docs/model.md (26).

    Returns
    -------
    variance
        Of the accumulated curve angle at each node [rad²].
    covariance
        Of the angles of the len(breaks) - 1 pieces [rad²].
    """
    bend = spline.route.curvature_vector
    normal = bend / np.sqrt(np.einsum("ij,ij->i", bend, bend) + 1e-300)[:, None]
    return _angle_covariance(spline.route.s, spline.covariance, spline.gain, normal, breaks)


@njit(cache=True, nogil=True)
def _full(p: np.ndarray) -> np.ndarray:
    return np.array([[p[0], p[1], p[2]], [p[1], p[3], p[4]], [p[2], p[4], p[5]]])


@njit(cache=True, nogil=True)
def _angle_covariance(
    s: np.ndarray, covariance: np.ndarray, gain: np.ndarray, normal: np.ndarray, breaks: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Carry the covariance of the state with every piece's angle along the route (a Markov process)."""
    pieces = len(breaks) - 1
    variance, out = np.zeros(len(s)), np.zeros((pieces, pieces))
    with_state = np.zeros(
        (pieces, 3, 3)
    )  # of each piece's angle so far with the state, coordinate by coordinate
    here = _full(covariance[0])
    scale = np.sqrt(np.diag(here))
    m = 0
    for k in range(1, len(s)):
        while k > breaks[m + 1]:
            m += 1
        before, here = here, _full(covariance[k])
        cross = gain[k - 1] @ here  # Cov(state before, state here)
        scale = np.sqrt(np.diag(before)) + 1e-300
        regular = before / scale / scale.reshape(3, 1) + 1e-13 * np.eye(3)
        forward = (np.linalg.solve(regular, cross / scale.reshape(3, 1)) / scale.reshape(3, 1)).T
        half = 0.5 * (s[k] - s[k - 1])
        own = 0.0
        for c in range(3):
            a, b = half * normal[k - 1, c], half * normal[k, c]
            own += a * a * before[2, 2] + b * b * here[2, 2] + 2.0 * a * b * cross[2, 2]
        total = own
        for j in range(m + 1):
            shared = 0.0
            for c in range(3):
                a, b = half * normal[k - 1, c], half * normal[k, c]
                carried = forward @ with_state[j, c]
                shared += a * with_state[j, c, 2] + b * carried[2]
                with_state[j, c] = carried
                if j == m:
                    with_state[j, c] += a * cross[2] + b * here[2]
            total += 2.0 * shared
            out[j, m] += shared
            out[m, j] += shared
        out[m, m] += own
        variance[k] = variance[k - 1] + total
    return np.maximum(variance, 0.0), out
