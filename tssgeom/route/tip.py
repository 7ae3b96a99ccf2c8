"""A route of which only the base and the tip are sensed, and the length is known; docs/model.md (169)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.core.constants import CHANCE
from tssgeom.errors import FitError, ShapeError
from tssgeom.route.curvature import CurvatureProfile
from tssgeom.route.pieces import Arcs
from tssgeom.route.route import Route
from tssgeom.route.route_fit import Nodes, RouteFit, available
from tssgeom.statistics import EVIDENCE_SCALE


@dataclass(frozen=True, slots=True)
class TipPrior:
    """What is known beforehand of a route, and how it is computed."""

    waves: int = 4
    """Cosines of each component of the curvature. Chosen: three segments and their joints."""
    turn: float = 2.0
    """Standard deviation of the turn by the first; it falls with the root of the number of the others
    [rad]. Chosen: catheters and segments of tendon robots turn by a quarter to a half circle."""
    cells: int = 24
    """Even cells. Chosen: a cell turns by 0.2 rad."""

    @property
    def pieces(self) -> int:
        """Pieces of constant curvature that are reported: two for each wave."""
        return 2 * self.waves


PRIOR = TipPrior()


_NOT_SENSED = ("the route between base and tip is not sensed: Φ is the mean of all that fit both",)


class TipReadings(NamedTuple):
    """What was sensed."""

    base: Vector
    """Position of the base [3] [m]."""
    base_direction: Vector
    """Unit tangent there [3]."""
    tip: Vector
    """Position of the tip [3] [m]."""
    tip_direction: Vector | None
    """Unit tangent there [3], where it was sensed."""
    length: float
    """Length of the route between both [m]."""
    length_noise: float
    """Standard deviation of the length [m]."""
    noise: float
    """Standard deviation of a coordinate of the tip [m]."""
    direction_noise: float
    """Standard deviation of a component of a direction [rad]."""


def fit_tip(sensed: TipReadings) -> RouteFit:
    """Return the mean of all routes from the base to the tip, with the spread between them.

    Raises ShapeError where the tip is farther from the base than the route is long; FitError where no route
    fits both.
    """
    chord = float(np.linalg.norm(sensed.tip - sensed.base))
    allowed = math.hypot(sensed.noise, sensed.length_noise)
    if chord > sensed.length + CHANCE.clear * allowed:
        raise ShapeError(
            f"the tip lies {1e3 * chord:.5g} mm from the base, the route is {1e3 * sensed.length:.5g} mm "
            "long: check the length, the unit, and where the base is"
        )
    warnings = _NOT_SENSED
    if chord > sensed.length:
        warnings += (
            f"the tip lies {1e3 * (chord - sensed.length):.2g} mm farther from the base than the length of "
            f"{1e3 * sensed.length:.5g} mm: check the length, and where the base is",
        )
    mean, covariance = _posterior(sensed)
    root = np.linalg.cholesky(covariance)
    draws = mean + np.random.default_rng(0).standard_normal((EVIDENCE_SCALE.draws, len(mean))) @ root.T
    # routes with the fewest waves are the commonest: the likeliest one counts as much as all others
    turn, length = _turns(draws), sensed.length + sensed.length_noise * draws[:, -1]
    turn = np.vstack((turn, np.tile(_turns(mean[None]), (EVIDENCE_SCALE.draws, 1))))
    length = np.tile(length, 2)
    per_piece = turn.reshape(len(turn), PRIOR.pieces, -1).sum(axis=2)
    lengths = np.repeat(length[:, None] / PRIOR.pieces, PRIOR.pieces, axis=1)
    arcs = Arcs(
        length=read_only(lengths.mean(axis=0)),
        angle=read_only(per_piece.mean(axis=0)),
        covariance=read_only(np.cov(np.hstack((lengths, per_piece)).T)),
        method="tip",
    )
    return RouteFit(
        arcs=arcs,
        noise=sensed.noise,
        weight=read_only(np.ones(2)),
        nodes=available(_nodes(sensed, mean, turn, float(length.mean()))),
        evidence=available(0.0),
        warnings=warnings,
    )


def _posterior(sensed: TipReadings) -> tuple[Vector, Matrix]:
    """Most likely coefficients, each over its prior standard deviation, and their covariance."""
    from scipy.optimize import least_squares

    at = np.zeros(2 * PRIOR.waves + 3)  # waves of both components, tilt of the base twice, length
    at[0], at[PRIOR.waves] = _arc(sensed) / PRIOR.turn  # a straight route would be a saddle
    fit = least_squares(
        lambda u: np.concatenate((_left(sensed, u[None])[0], u)),
        at,
        lambda u: np.vstack((_slope(sensed, u), np.eye(len(u)))),  # pyright: ignore[reportArgumentType]
        method="lm",
        max_nfev=100,
    )
    covariance = np.asarray(np.linalg.inv(fit.jac.T @ fit.jac), dtype=np.float64)
    if not np.isfinite(covariance).all():
        raise FitError("no route of this length joins the base and the tip: check both, and the length")
    return fit.x, covariance


def _slope(sensed: TipReadings, at: Vector) -> Matrix:
    """Return how what is left changes with each coefficient."""
    step = 1e-5 * np.eye(len(at))
    after, before = _left(sensed, np.vstack((at + step, at - step))).reshape(2, len(at), -1)
    return (after - before).T / 2e-5


def _arc(sensed: TipReadings) -> Vector:
    """Turn of the arc from the base through the tip, along both axes across the base [2] [rad]."""
    first, second = core.normals(sensed.base_direction)
    chord = sensed.tip - sensed.base
    forward, aside = chord @ sensed.base_direction, np.array([chord @ first, chord @ second])
    turn = 2.0 * math.atan2(float(np.linalg.norm(aside)), forward)
    return aside * (turn / max(float(np.linalg.norm(aside)), 1e-300))


def _bend(at: Matrix) -> np.ndarray:
    """Turn of each cell along both axes [draws, cells, 2] [rad]."""
    k, middle = np.arange(PRIOR.waves), (np.arange(PRIOR.cells) + 0.5) / PRIOR.cells
    wave = PRIOR.turn / np.sqrt(1.0 + k)[:, None] * np.cos(np.pi * k[:, None] * middle) / PRIOR.cells
    both = at[:, : 2 * PRIOR.waves].reshape(len(at), 2, PRIOR.waves)
    return np.einsum("nck,km->nmc", both, wave)


def _turns(at: Matrix) -> Matrix:
    """Angle of each cell [draws, cells] [rad]."""
    return np.linalg.norm(_bend(at), axis=2)


def _frames(sensed: TipReadings, at: Matrix) -> tuple[np.ndarray, np.ndarray]:
    """Positions from the base over the length, and axes, at the edges of the cells."""
    bend, count = _bend(at), len(at)
    first, second = core.normals(sensed.base_direction)
    axes = np.empty((count, PRIOR.cells + 1, 3, 3))  # rows: tangent, first, second
    position = np.zeros((count, PRIOR.cells + 1, 3))
    tilt = sensed.direction_noise * at[:, -3:-1]
    axes[:, 0] = _turned(np.array([sensed.base_direction, first, second]), tilt)
    for k in range(PRIOR.cells):
        axes[:, k + 1] = _turned(axes[:, k], bend[:, k])
    middle = axes[:, 1:, 0] + axes[:, :-1, 0]  # of an arc it has the direction of the chord
    angle = np.linalg.norm(bend, axis=2)
    chord = np.sinc(angle / (2.0 * np.pi)) / PRIOR.cells / np.linalg.norm(middle, axis=2)
    position[:, 1:] = np.cumsum(chord[..., None] * middle, axis=1)
    return position, axes


def _turned(axes: np.ndarray, by: Matrix) -> np.ndarray:
    """Turn the tangent by angles towards the other two axes [draws, 2] [rad], without twist."""
    angle = np.linalg.norm(by, axis=1)
    unit = by / np.maximum(angle, 1e-300)[:, None]
    c, s = np.cos(angle), np.sin(angle)
    turn = np.empty((len(by), 3, 3))
    turn[:, 0, 0] = c
    turn[:, 0, 1:] = s[:, None] * unit
    turn[:, 1:, 0] = -s[:, None] * unit
    turn[:, 1:, 1:] = np.eye(2) - (1.0 - c)[:, None, None] * unit[:, :, None] * unit[:, None, :]
    return turn @ axes


def _left(sensed: TipReadings, at: Matrix) -> Matrix:
    """Return what is left between readings and routes, over the noise of each."""
    position, axes = _frames(sensed, at)
    length = sensed.length + sensed.length_noise * at[:, -1]
    off = (sensed.base + length[:, None] * position[:, -1] - sensed.tip) / sensed.noise
    if sensed.tip_direction is None:
        return off
    turned = (axes[:, -1, 0] - sensed.tip_direction) / sensed.direction_noise
    return np.hstack((off, turned))


def _nodes(sensed: TipReadings, mean: Vector, turn: Matrix, length: float) -> Nodes:
    """Likeliest route, with the angle of the mean over all and the spread between them."""
    position, axes = _frames(sensed, mean[None])
    bend, n = _bend(mean[None])[0], PRIOR.cells + 1
    s = np.linspace(0.0, length, n)
    phi = np.hstack((np.zeros((len(turn), 1)), np.cumsum(turn, axis=1)))
    at_edges = np.vstack((bend[:1], 0.5 * (bend[1:] + bend[:-1]), bend[-1:])) * (PRIOR.cells / length)
    kappa = np.hstack((turn[:, :1], 0.5 * (turn[:, 1:] + turn[:, :-1]), turn[:, -1:])) * (
        PRIOR.cells / length
    )
    route = Route(
        s=read_only(s),
        position=read_only(sensed.base + length * position[0]),
        tangent=read_only(axes[0, :, 0]),
        curvature_vector=read_only(np.einsum("nc,nci->ni", at_edges, axes[0, :, 1:])),
        noise=sensed.noise,
        weight=read_only(np.ones(2)),
        station=read_only(np.array([0.0, length])),
        residual=read_only(np.array([np.zeros(3), sensed.tip - sensed.base - length * position[0, -1]])),
    )
    profile = CurvatureProfile(
        s=read_only(s),
        kappa=read_only(kappa.mean(axis=0)),
        phi=read_only(phi.mean(axis=0)),
        kappa_se=read_only(kappa.std(axis=0)),
        phi_se=read_only(phi.std(axis=0)),
    )
    return Nodes(route, profile)
