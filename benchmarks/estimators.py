"""Estimators of the geometry, ours and the peers', and the least error that any of them can have.

Cramér–Rao bound: the least standard deviation that any unbiased estimator can have on a chain of arcs. The
chain is described by its start, its first direction, the curvature vectors of its curved pieces, its joints
and, where stations are unknown, its length. That a piece is straight, and how many pieces there are, counts
as known. With C the inverse of JᵀJ/σ², J the derivatives of all points, a quantity with gradient g has the
bound √(gᵀCg).

Where stations are unknown, each is one more parameter, which removes the information of its point along the
tangent. The first and the last point lie at the ends of the route, so they keep all three components; that
brings the variance σ²(κ_first² + κ_last²) of angles at unknown ends by itself.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from csaps import csaps
from scipy.interpolate import make_smoothing_spline, make_splprep, splev, splprep
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from tests.known_routes import arc_positions
from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.rig import Rig, Source
from tssgeom.route.geometry import Method, measure
from tssgeom.route.observations import clean
from tssgeom.route.shared_errors import with_shared_errors
from tssgeom.route.synthetic import Course
from tssgeom.tendon.capstan import pretensioned, step, transmit

RIG = Rig()
TENSION_IN = 15.0
"""Tension at the proximal end, from a slack tendon [N]."""


def first_pull(length: Vector, angle: Vector) -> float:
    """Elongation [m] on pieces of the given lengths [m] and angles [rad]; docs/model.md (9), T_0 = 0."""
    turn = RIG.friction.coefficient * angle
    reaching = TENSION_IN * np.exp(-(np.cumsum(turn) - turn))
    mean = np.where(turn > 1e-12, -np.expm1(-turn) / np.maximum(turn, 1e-300), 1.0)
    return float(RIG.tendon.compliance_per_N * (length * mean) @ reaching)


_STEP = 1e-6  # of a length of the route, of an angle of 1, of a curvature of one over the length
_SINGULAR = 1e-9  # smallest singular value over the largest, with columns of equal length


@dataclass(frozen=True, slots=True)
class Bound:
    """Least standard deviations; infinite where the points do not determine the chain."""

    angle: float
    """Of Φ [rad]."""
    elongation: float
    """Of the elongation on the first pull to 15 N [m]."""


def cramer_rao(course: Course, station: Vector, noise: float, *, stations_known: bool) -> Bound:
    """Bound for one layout of stations.

    Parameters
    ----------
    course
        True chain of arcs.
    station
        True arc length of each usable point, the first 0 and the last the length of the route [m].
    noise
        Standard deviation of each coordinate [m].
    stations_known
        Whether stations are known.
    """
    chain = _Chain(course, stations_known)
    jacobian = chain.jacobian(lambda theta: chain.points(theta, station))
    if not stations_known:
        jacobian = _across(jacobian, chain.tangents(station))
    gradient = chain.jacobian(chain.quantities)
    deviation = noise * _deviations(jacobian.reshape(-1, chain.size), gradient)
    return Bound(float(deviation[0]), float(deviation[1]))


class _Chain:
    """A chain of arcs as a function of its parameters, which are all 0 at the truth."""

    def __init__(self, course: Course, stations_known: bool) -> None:
        self.course = course
        self.curved = np.flatnonzero(np.any(course.bend != 0.0, axis=1))
        self.edges = np.concatenate(([0.0], np.cumsum(course.length)))
        self.known = stations_known
        self.bends = 5 + 2 * len(self.curved)  # where the joints begin
        self.size = self.bends + len(course.length) - int(stations_known)

    def at(self, theta: Vector) -> Course:
        """Pieces for parameters `theta`."""
        bend, edges = self.course.bend.copy(), self.edges.copy()
        bend[self.curved] += theta[5 : self.bends].reshape(-1, 2)
        edges[1 : 1 + self.size - self.bends] += theta[self.bends :]
        return Course(np.diff(edges), bend)

    def points(self, theta: Vector, station: Vector) -> Points:
        """Points at the stations; the last one moves with the length, where that is free."""
        moved = station.copy()
        course = self.at(theta)
        if not self.known:
            moved[-1] = course.length.sum()
        turn = Rotation.from_rotvec([0.0, theta[3], theta[4]])
        return turn.apply(arc_positions(course)(moved)) + theta[:3]

    def quantities(self, theta: Vector) -> Vector:
        """Φ [rad] and elongation [m]."""
        course = self.at(theta)
        angle = np.hypot(*course.bend.T) * course.length
        return np.array([angle.sum(), first_pull(course.length, angle)])

    def tangents(self, station: Vector) -> Points:
        """Return the unit tangents at the stations."""
        position, step = arc_positions(self.course), _STEP * self.edges[-1]
        return (position(station + step) - position(station - step)) / (2 * step)

    def jacobian(self, function: Callable[[Vector], np.ndarray]) -> np.ndarray:
        """Differentiate a function by every parameter, in a last axis, by central differences."""
        steps = np.full(self.size, _STEP * self.edges[-1])
        steps[3:5] = _STEP
        steps[5 : self.bends] = _STEP / self.edges[-1]
        columns = [(function(h) - function(-h)) / (2 * h.sum()) for h in np.diag(steps)]
        return np.stack(columns, axis=-1)


def _across(jacobian: np.ndarray, tangent: Points) -> np.ndarray:
    """Drop the residuals of inner points along the tangent [n, 3, parameters]."""
    along = np.einsum("nc,ncp->np", tangent, jacobian)
    along[[0, -1]] = 0.0
    return jacobian - tangent[:, :, None] * along[:, None, :]


def _deviations(jacobian: Matrix, gradient: Matrix) -> Vector:
    """√(g (JᵀJ)⁻¹ gᵀ) of each row g, infinite where J lacks rank."""
    scale = np.linalg.norm(jacobian, axis=0) + 1e-300
    _, singular, directions = np.linalg.svd(jacobian / scale, full_matrices=False)
    if len(singular) < jacobian.shape[1] or singular[-1] < _SINGULAR * singular[0]:
        return np.full(len(gradient), np.inf)
    return np.linalg.norm((gradient / scale) @ directions.T / singular, axis=1)


@dataclass(frozen=True, slots=True)
class Sighting:
    """Input of an estimator."""

    points: Points
    """A row of NaN is a missing point [m]."""
    stations: Vector | None
    """Arc length at each point, where it is known [m]."""
    noise: float | None
    """Standard deviation of each coordinate, where the sensor's is known [m]."""
    true_noise: float
    """The same in truth, for peers that cannot do without it [m]."""
    source: Source = "markers"
    """Where the points come from, for the estimators of this project."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """Result of one estimator; a standard error that it does not give is NaN, a count 0."""

    s: Vector
    """Arc length from the proximal end [m]."""
    phi: Vector
    """Accumulated curve angle there [rad]."""
    elongation: float
    """On the first pull to 15 N [m]."""
    angle_se: float = math.nan
    """Standard error of Φ [rad]."""
    elongation_se: float = math.nan
    """Standard error of the elongation from geometry [m]."""
    pieces: int = 0
    """Number of pieces of constant curvature."""

    @classmethod
    def of_profile(cls, s: Vector, phi: Vector) -> Estimate:
        """Answer of an estimator that gives the accumulated angle `phi` [rad] at `s` [m] and no more."""
        return cls(s, phi, first_pull(np.diff(s), np.diff(phi)))

    @property
    def total_angle(self) -> float:
        """Accumulated curve angle of the whole route, Φ [rad]."""
        return float(self.phi[-1])


def ours(method: Method, sighting: Sighting) -> Estimate:
    """Answer of this project, with its error bars."""
    sensed = measure(clean(sighting.points, sighting.stations), sighting.noise, method)
    fit, shared = with_shared_errors(sensed, sighting.source, None)
    result = shared.beside(fit)
    pulled = step(pretensioned(RIG), TENSION_IN, RIG.friction.coefficient)
    moved = transmit(pulled, result.arcs, RIG)
    return Estimate(
        s=result.profile.s,
        phi=result.profile.phi,
        elongation=moved.elongation,
        angle_se=result.arcs.total_angle_se,
        elongation_se=moved.elongation_se,
        pieces=len(result.arcs.length),
    )


OURS: dict[str, Callable[[Sighting], Estimate]] = {
    "spline": partial(ours, "spline"),
    "arcs": partial(ours, "arcs"),
    "auto": partial(ours, "auto"),
}


_GRID = 4000
_VMTK_ROUNDS, _VMTK_FACTOR = 100, 0.1  # defaults of vmtkcenterlinesmoothing and vmtkcenterlinegeometry
_TAUBIN_ROUNDS, _LAMBDA, _PASS_BAND = 100, 0.6307, 0.1  # Taubin 1995; VMTK's own example of a pass band


def _sensed(sighting: Sighting) -> tuple[Points, Vector]:
    """Points that are not missing, with their stations or chord lengths from 0 [m]."""
    sensed = ~np.isnan(sighting.points).any(axis=1)
    points = sighting.points[sensed]
    if sighting.stations is not None:
        return points, sighting.stations[sensed]
    return points, chord_lengths(points)


def chord_lengths(points: Points) -> Vector:
    """Return the length of the polygon up to each point [n] [m]."""
    return np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))


def of_curve(u: Vector, first: Points, second: Points, *, known: bool) -> Estimate:
    """Angle along a curve from its derivatives at `u`, which is arc length where stations are known."""
    speed = np.linalg.norm(first, axis=1)
    turning = np.linalg.norm(np.cross(first, second), axis=1) / np.maximum(speed, 1e-12) ** 2
    return Estimate.of_profile(u if known else _integral(u, speed), _integral(u, turning))


def _integral(u: Vector, rate: Vector) -> Vector:
    return np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(u))))


def scipy_splprep(sighting: Sighting) -> Estimate:
    """Quintic smoothing spline of FITPACK with the residual that the true noise leaves, s = 3Nσ²."""
    points, u = _sensed(sighting)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # FITPACK warns where it cannot meet s; its best curve is used then
        tck, _ = splprep(points.T, u=u, k=min(5, len(u) - 1), s=points.size * sighting.true_noise**2)
    at = np.linspace(u[0], u[-1], _GRID)
    first, second = (np.array(splev(at, tck, order)).T for order in (1, 2))
    return of_curve(at, first, second, known=sighting.stations is not None)


def scipy_make_splprep(sighting: Sighting) -> Estimate:
    """Successor of splprep in scipy, with the same degree and residual."""
    points, u = _sensed(sighting)
    left: Any = points.size * sighting.true_noise**2  # a float, which scipy's own default of 0 hides
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        spline, _ = make_splprep(points.T, u=u, k=min(5, len(u) - 1), s=left)
    at = np.linspace(u[0], u[-1], _GRID)
    return of_curve(at, spline(at, 1).T, spline(at, 2).T, known=sighting.stations is not None)


def scipy_smoothing_spline(sighting: Sighting) -> Estimate:
    """Cubic smoothing spline, its weight by generalised cross-validation.

    The search of scipy takes a weight of order one for granted, so stations are in units of their spacing; in
    metres it never comes near the minimum, and exact points of a half circle are 6 % off.
    """
    points, u = _sensed(sighting)
    spacing = float(u[-1] - u[0]) / (len(u) - 1)
    spline = make_smoothing_spline(u / spacing, points)
    at = np.linspace(u[0], u[-1], _GRID)
    first, second = spline(at / spacing, 1) / spacing, spline(at / spacing, 2) / spacing**2
    return of_curve(at, first, second, known=sighting.stations is not None)


def csaps_spline(sighting: Sighting) -> Estimate:
    """Cubic smoothing spline of csaps, its weight by the rule of that package."""
    points, u = _sensed(sighting)
    spline = csaps(u, points.T).spline
    at = np.linspace(u[0], u[-1], _GRID)
    first, second = (np.asarray(spline(at, nu=order)).T for order in (1, 2))
    return of_curve(at, first, second, known=sighting.stations is not None)


def turning_angles(sighting: Sighting) -> Estimate:
    """Plain sum of the angles between the steps from point to point."""
    return _of_polyline(*_sensed(sighting))


def vmtk_smoothing(sighting: Sighting) -> Estimate:
    """Sum turning angles after VMTK's smoothing of centre lines, with its defaults."""
    points, u = _sensed(sighting)
    smoothed = points.copy()
    for _ in range(_VMTK_ROUNDS):
        _relax(smoothed, _VMTK_FACTOR)
    return _of_polyline(smoothed, u if sighting.stations is not None else chord_lengths(smoothed))


def taubin_smoothing(sighting: Sighting) -> Estimate:
    """Sum turning angles after Taubin's λ|μ smoothing, which shrinks curves less."""
    points, u = _sensed(sighting)
    mu = 1.0 / (_PASS_BAND - 1.0 / _LAMBDA)
    for factor in (_LAMBDA, mu) * _TAUBIN_ROUNDS:
        points = points.copy()
        points[1:-1] += factor * (0.5 * (points[:-2] + points[2:]) - points[1:-1])
    return _of_polyline(points, u if sighting.stations is not None else chord_lengths(points))


def _relax(points: np.ndarray, factor: float) -> None:
    """Pull each inner point towards the middle of its neighbours, one after the other."""
    share = 0.5 * factor  # of the neighbour before, which has been pulled already
    free = (1.0 - factor) * points[1:-1] + share * points[2:]
    points[1:-1] = lfilter([1.0], [1.0, -share], free, axis=0, zi=share * points[:1])[0]


def _of_polyline(points: Points, s: Vector) -> Estimate:
    steps = np.diff(points, axis=0)
    sine = np.linalg.norm(np.cross(steps[1:], steps[:-1]), axis=1)
    cosine = np.einsum("ij,ij->i", steps[1:], steps[:-1])
    turns = np.arctan2(sine, cosine)
    middle = np.concatenate((s[:1], 0.5 * (s[1:] + s[:-1]), s[-1:]))  # an angle turns over half of both steps
    return Estimate.of_profile(middle, np.concatenate(([0.0, 0.0], np.cumsum(turns), [turns.sum()])))


PEERS: dict[str, Callable[[Sighting], Estimate]] = {
    "splprep": scipy_splprep,
    "make_splprep": scipy_make_splprep,
    "GCV spline": scipy_smoothing_spline,
    "csaps": csaps_spline,
    "VMTK": vmtk_smoothing,
    "Taubin": taubin_smoothing,
    "turning": turning_angles,
}
SLOW = ("GCV spline",)
"""Peers that take a fifth of a second for 200 points, and so get fewer trials of many points."""
