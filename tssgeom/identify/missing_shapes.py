"""What is missing where no name fits: friction over tension, speed, cycle and place, in straight lines.

Source: docs/model.md (118).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.identify.drive import turning_points
from tssgeom.identify.finding import RouteBlame, Shape
from tssgeom.identify.problem import Fit, Point, Problem
from tssgeom.identify.readings import Reading

_KNOTS = 6
_WIDE = 1.0  # prior of the relative change of friction
_STEP = 0.02  # of ln μ


def missing_shapes(
    problem: Problem, fit: Fit, along: Sequence[RouteBlame], gains: Sequence[float]
) -> tuple[Shape, ...]:
    """Return the friction that the readings want, over each thing that it may depend on."""
    moved = np.zeros(2 + len(fit.at.free))
    moved[0] = _STEP
    slope = (fit.left - problem.left(fit.at.moved(moved))) / _STEP
    over = {
        "tension_N": _rows(problem, [_tension(reading) for reading in problem.stack.readings]),
        "speed_m_per_s": _rows(problem, [_speed(reading) for reading in problem.stack.readings]),
        "cycle": _rows(problem, [_cycle(reading) for reading in problem.stack.readings]),
    }
    told = [_shape(problem, fit, slope, name, x) for name, x in over.items() if np.ptp(x) > 0.0]
    excess = max(float(fit.residual @ fit.residual) - problem.stack.size, 1e-9)
    return (*told, *_over_place(problem, fit.at, along, [gain / excess for gain in gains]))


def _rows(problem: Problem, columns: Sequence[Vector]) -> Vector:
    out = np.empty(problem.stack.size)
    for block in problem.stack.blocks:
        out[block.rows] = columns[block.run][block.kept]
    return out


def _tension(reading: Reading) -> Vector:
    for name in ("tension_in_N", "tension_out_N"):
        column = reading.measured.get(name, reading.given.get(name))
        if column is not None:
            there = np.isfinite(column)
            return np.interp(reading.time, reading.time[there], column[there])
    return np.zeros(len(reading.time))


def _speed(reading: Reading) -> Vector:
    return np.abs(np.gradient(reading.given[reading.drive], reading.time))


def _cycle(reading: Reading) -> Vector:
    turns = turning_points(reading.given[reading.drive], reading.noise[reading.drive])
    legs = np.searchsorted(np.array(turns), np.arange(len(reading.time)))
    return np.asarray(legs // 2 + 1, dtype=np.float64)


def _shape(problem: Problem, fit: Fit, slope: Vector, name: str, x: Vector) -> Shape:
    """Fit ln μ as a broken line over x, in place of one number; docs/model.md (118)."""
    knots = np.unique(np.quantile(x, np.linspace(0.0, 1.0, _KNOTS)))
    hats = _hats(x, knots)
    column = problem.weighing.weighed(slope[:, None] * hats)
    rest = fit.jacobian[:, 1:]
    jacobian = np.column_stack([column, rest])
    precision = np.diag(np.concatenate([np.full(len(knots), _WIDE**-2.0), np.full(rest.shape[1], 1e-6)]))
    covariance = np.asarray(np.linalg.inv(jacobian.T @ jacobian + precision), dtype=np.float64)
    want = covariance @ (jacobian.T @ fit.residual)
    gone = fit.residual - jacobian @ want
    before = float(fit.residual @ fit.residual) - problem.stack.size
    gain = float(fit.residual @ fit.residual - gone @ gone)
    spread = np.sqrt(np.diag(covariance))[: len(knots)]
    friction = fit.at.friction * np.exp(np.clip(want[: len(knots)], -2.0, 2.0))
    share = float(np.clip(gain / max(before, 1e-9), 0.0, 1.0))
    return Shape(name, read_only(knots), read_only(friction), read_only(friction * spread), share)


def _hats(x: Vector, knots: Vector) -> Matrix:
    hats = [np.interp(x, knots, row) for row in np.eye(len(knots))]
    return np.asarray(np.column_stack(hats), dtype=np.float64)


def _over_place(
    problem: Problem, at: Point, along: Sequence[RouteBlame], shares: Sequence[float]
) -> list[Shape]:
    """Tell what the routes want along their length as friction on their mean curvature."""
    out = []
    routes = {reading.route.name: reading.route.arcs for reading in problem.stack.readings}
    for told, share in zip(along, shares, strict=True):
        arcs = routes.get(told.route)
        mean = 0.0 if arcs is None else arcs.total_angle / arcs.total_length
        if mean > 0.0:
            friction = read_only(at.friction * (1.0 + told.extra_angle_rad_per_m / mean))
            spread = read_only(at.friction * told.se / mean)
            out.append(Shape("s_m", told.s, friction, spread, float(np.clip(share, 0.0, 1.0))))
    return out
