"""Where the model and the readings disagree, and the friction that fits the readings.

By channel, phase, run and tension; along the route; where no name fits, over what friction may depend on.

Source: docs/model.md (108), (109), (118).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.core.constants import CHANCE
from tssgeom.effects import HiddenBend
from tssgeom.identify.drive import turning_points
from tssgeom.identify.finding import PHASES, HeatMap, MisfitShare, RouteMisfit, Shape
from tssgeom.identify.fit import FIT, Fit, Point, Problem
from tssgeom.identify.misfit import phases, simulated_run
from tssgeom.identify.prediction import run_channels
from tssgeom.identify.readings import Reading
from tssgeom.least_squares import SOLVER


@dataclass(frozen=True, slots=True)
class AttributionSettings:
    """How finely a misfit is attributed; no verdict depends on it."""

    smooth: float = 2.0
    """Stretches over which friction that is missing is alike [1]; chosen: of one no stretch stands out, and
    of four the stretch about a hidden bend is twice as long."""


ATTRIBUTION = AttributionSettings()
_BINS = 3  # of tension in the heat map; arrangement
_STRETCHES = 12  # of a route; arrangement
_KNOTS = 6  # of friction over what it may depend on; arrangement
_LISTED = 8  # cells of the heat map that are listed at most; arrangement
_WORTH = 0.02  # share of all excess below which a cell is not listed [1]; arrangement


def heat_map(problem: Problem, at: Point) -> tuple[HeatMap, tuple[MisfitShare, ...]]:
    """Return residual power by channel and run over phase and tension and its worst cells; (108)."""
    stack, most = problem.stack, _BINS
    whitened = problem.whitening.whitened(problem.left(at))[: stack.size]
    runs = [simulated_run(reading, problem.rig, at) for reading in stack.readings]
    force = [_tension(reading, view.channels) for reading, view in zip(stack.readings, runs, strict=True)]
    edges = np.quantile(np.concatenate(force), np.linspace(0.0, 1.0, most + 1))
    phase = [phases(reading, view.slip_out) for reading, view in zip(stack.readings, runs, strict=True)]
    cells: list[tuple[float, MisfitShare]] = []
    power = np.full((len(stack.blocks), len(PHASES) * most), np.nan)
    for row, block in enumerate(stack.blocks):
        reading = stack.readings[block.run]
        bins = np.clip(np.searchsorted(edges, force[block.run][block.kept], side="right") - 1, 0, _BINS - 1)
        cell_of = phase[block.run][block.kept] * most + bins
        square = np.square(whitened[block.rows])
        for cell in np.unique(cell_of):
            inside = cell_of == cell
            power[row, cell] = square[inside].mean()
            excess = float(np.sum(square[inside] - 1.0))
            low, high = edges[cell % most], edges[cell % most + 1]
            title = PHASES[cell // most]
            cells.append(
                (
                    excess,
                    MisfitShare(block.channel, title, reading.name, (float(low), float(high)), None, excess),
                )
            )
    rows = tuple(f"{block.channel} {stack.readings[block.run].name}" for block in stack.blocks)
    names = tuple(f"{title} {edges[k]:.1f}–{edges[k + 1]:.1f} N" for title in PHASES for k in range(_BINS))
    return HeatMap(rows, names, power), _worst(cells, float(np.square(whitened).sum()))


def _tension(reading: Reading, channels: Mapping[str, Vector]) -> Vector:
    """Return the tension by which samples are sorted: the model's, else what was measured [N]."""
    for name in ("tension_in_N", "tension_out_N"):
        if name in channels:
            return channels[name]
        if name in reading.given:
            return reading.given[name]
    return np.abs(reading.given[reading.drive])


def _worst(cells: list[tuple[float, MisfitShare]], power: float) -> tuple[MisfitShare, ...]:
    cells.sort(key=lambda cell: -cell[0])
    out = []
    for excess, share_of in cells[:_LISTED]:
        share = excess / max(power, 1e-12)
        if share < _WORTH:
            break
        out.append(replace(share_of, share=share))
    return tuple(out)


def along_routes(
    problem: Problem, at: Point, base: Matrix
) -> tuple[tuple[RouteMisfit, ...], tuple[float, ...]]:
    """Return the fitted curve angle beyond the model, by stretches of each route; (109).

    With it how much χ² falls by that of each route.
    """
    residual = problem.whitening.whitened(problem.left(at))
    names = list(dict.fromkeys(reading.route.name for reading in problem.stack.readings))
    results = [_along(problem, at, base, residual, name) for name in names]
    return tuple(misfit for misfit, _ in results), tuple(gain for _, gain in results)


def _along(
    problem: Problem, at: Point, base: Matrix, residual: Vector, name: str
) -> tuple[RouteMisfit, float]:
    readings = problem.stack.readings
    route = next(reading.route for reading in readings if reading.route.name == name)
    length, count = route.arcs.total_length, _STRETCHES
    middle = (np.arange(count) + 0.5) * length / count
    before = _channels(readings, problem, at, name, None)
    tried = []
    for centre in middle:
        bend = HiddenBend(at_m=centre, angle_rad=SOLVER.coarse_step, width_m=length / count)
        after = _channels(readings, problem, at, name, bend)
        change = np.zeros(problem.stack.size)
        for block in problem.stack.blocks:
            if block.run in after:
                shift = after[block.run][block.channel] - before[block.run][block.channel]
                change[block.rows] = shift[block.kept]
        tried.append(change / (SOLVER.coarse_step * count / length))
    own = problem.whitening.whitened(np.column_stack(tried))
    step = np.subtract.outer(np.arange(_STRETCHES), np.arange(_STRETCHES)) / ATTRIBUTION.smooth
    wide = HiddenBend.parameters["angle_rad"].prior_sd * count / length  # of one hidden bend in each [rad/m]
    prior = wide**2 * (np.exp(-0.5 * step**2) + 1e-4 * np.eye(count))
    jacobian = np.column_stack([base, own])
    precision = np.zeros((jacobian.shape[1],) * 2)
    precision[2:, 2:] = np.linalg.inv(prior)
    precision[:2, :2] = np.eye(2)
    covariance = np.linalg.inv(jacobian.T @ jacobian + precision)
    wanted = covariance @ (jacobian.T @ residual)
    spread = np.sqrt(np.diag(covariance))
    gone = residual - jacobian @ wanted
    gain = float(residual @ residual - gone @ gone)
    return RouteMisfit(name, read_only(middle), read_only(wanted[2:]), read_only(spread[2:])), gain


def _channels(
    readings: Sequence[Reading], problem: Problem, at: Point, name: str, bend: HiddenBend | None
) -> dict[int, dict[str, Vector]]:
    effects = at.effects if bend is None else (*at.effects, bend)
    rig = at.rig(problem.rig)
    return {k: run_channels(r, rig, effects) for k, r in enumerate(readings) if r.route.name == name}


def pointed(
    where: tuple[MisfitShare, ...], along: tuple[RouteMisfit, ...], routes: Mapping[str, str]
) -> tuple[MisfitShare, ...]:
    """Return the shares with the stretch of the route that the readings point at; `routes` by run."""
    ranges = {misfit.route: _stretch(misfit) for misfit in along}
    return tuple(replace(share, route_range_m=ranges.get(routes[share.run])) for share in where)


def _stretch(misfit: RouteMisfit) -> tuple[float, float] | None:
    """Return the one stretch that stands out, if less than half of the route does."""
    high = np.flatnonzero(misfit.extra_angle_rad_per_m > CHANCE.clear * misfit.se_rad_per_m)
    if not len(high):
        return None
    span = int(high[-1] - high[0]) + 1
    if span > len(misfit.s_m) // 2 or len(high) < span:
        return None
    half = 0.5 * float(misfit.s_m[1] - misfit.s_m[0])
    return float(misfit.s_m[high[0]] - half), float(misfit.s_m[high[-1]] + half)


def missing_shapes(
    problem: Problem, fit: Fit, along: Sequence[RouteMisfit], gains: Sequence[float]
) -> tuple[Shape, ...]:
    """Return the friction that fits the readings, over each quantity that it may depend on."""
    moved = np.zeros(2 + len(fit.at.free))
    moved[0] = SOLVER.coarse_step
    slope = (fit.left - problem.left(fit.at.moved(moved))) / SOLVER.coarse_step
    over = {
        "tension_N": _rows(problem, [_measured_tension(reading) for reading in problem.stack.readings]),
        "speed_m_per_s": _rows(problem, [_speed(reading) for reading in problem.stack.readings]),
        "cycle": _rows(problem, [_cycle(reading) for reading in problem.stack.readings]),
    }
    shapes = [_shape(problem, fit, slope, name, x) for name, x in over.items() if np.ptp(x) > 0.0]
    excess = max(float(fit.residual @ fit.residual) - problem.stack.size, 1e-9)
    return (*shapes, *_over_arc_length(problem, fit.at, along, [gain / excess for gain in gains]))


def _rows(problem: Problem, columns: Sequence[Vector]) -> Vector:
    out = np.empty(problem.stack.size)
    for block in problem.stack.blocks:
        out[block.rows] = columns[block.run][block.kept]
    return out


def _measured_tension(reading: Reading) -> Vector:
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
    """Fit ln μ as a broken line over x, instead of one number; docs/model.md (118)."""
    knots = np.unique(np.quantile(x, np.linspace(0.0, 1.0, _KNOTS)))
    hats = _hats(x, knots)
    column = problem.whitening.whitened(slope[:, None] * hats)
    rest = fit.jacobian[:, 1:]
    jacobian = np.column_stack([column, rest])
    precision = np.diag(np.concatenate([np.full(len(knots), FIT.log_sd**-2.0), np.full(rest.shape[1], 1e-6)]))
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


def _over_arc_length(
    problem: Problem, at: Point, along: Sequence[RouteMisfit], shares: Sequence[float]
) -> list[Shape]:
    """Return the fitted friction beyond the model along the routes, as friction on their mean curvature."""
    out = []
    routes = {reading.route.name: reading.route.arcs for reading in problem.stack.readings}
    for misfit, share in zip(along, shares, strict=True):
        arcs = routes.get(misfit.route)
        mean = 0.0 if arcs is None else arcs.total_angle / arcs.total_length
        if mean > 0.0:
            friction = read_only(at.friction * (1.0 + misfit.extra_angle_rad_per_m / mean))
            spread = read_only(at.friction * misfit.se_rad_per_m / mean)
            out.append(Shape("s_m", misfit.s_m, friction, spread, float(np.clip(share, 0.0, 1.0))))
    return out
