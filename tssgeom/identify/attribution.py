"""Where the model and the readings disagree: by channel, phase, run and tension, and along the route.

Source: docs/model.md (108), (109).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.effects import HiddenBend
from tssgeom.identify.finding import PHASES, Blame, HeatMap, RouteBlame
from tssgeom.identify.outcome import seen
from tssgeom.identify.phases import phases
from tssgeom.identify.problem import Point, Problem
from tssgeom.identify.readings import Reading
from tssgeom.identify.stack import run_channels

_BINS = 3  # of tension
_TOLD = 8  # places that are told
_WORTH = 0.02  # of all excess: less is no place
_STRETCHES = 12  # of a route
_TRIAL = 0.02  # rad of a bend that is tried
_SMOOTH = 2.0  # stretches over which friction that is missing is alike
_WIDE = 20.0  # rad/m: prior of what may be missing
_CLEAR = 3.0  # standard errors from which a stretch is to blame


def heat_map(problem: Problem, at: Point) -> tuple[HeatMap, tuple[Blame, ...]]:
    """Return calibrated residual power by channel and run over phase and tension, and its worst places."""
    stack = problem.stack
    weighed = problem.weighing.weighed(problem.left(at))[: stack.size]
    views = [seen(reading, problem.rig, at) for reading in stack.readings]
    force = [_tension(reading, view.channels) for reading, view in zip(stack.readings, views, strict=True)]
    edges = np.quantile(np.concatenate(force), np.linspace(0.0, 1.0, _BINS + 1))
    phase = [phases(reading, view.slip_out) for reading, view in zip(stack.readings, views, strict=True)]
    cells: list[tuple[float, Blame]] = []
    power = np.full((len(stack.blocks), len(PHASES) * _BINS), np.nan)
    for row, block in enumerate(stack.blocks):
        reading = stack.readings[block.run]
        bins = np.clip(np.searchsorted(edges, force[block.run][block.kept], side="right") - 1, 0, _BINS - 1)
        place = phase[block.run][block.kept] * _BINS + bins
        square = np.square(weighed[block.rows])
        for cell in np.unique(place):
            inside = place == cell
            power[row, cell] = square[inside].mean()
            excess = float(np.sum(square[inside] - 1.0))
            low, high = edges[cell % _BINS], edges[cell % _BINS + 1]
            title = PHASES[cell // _BINS]
            cells.append(
                (excess, Blame(block.channel, title, reading.name, (float(low), float(high)), None, excess))
            )
    rows = tuple(f"{block.channel} {stack.readings[block.run].name}" for block in stack.blocks)
    names = tuple(f"{title} {edges[k]:.1f}–{edges[k + 1]:.1f} N" for title in PHASES for k in range(_BINS))
    return HeatMap(rows, names, power), _worst(cells, float(np.square(weighed).sum()))


def _tension(reading: Reading, channels: Mapping[str, Vector]) -> Vector:
    """Return the tension by which samples are sorted: the model's, else what was measured [N]."""
    for name in ("tension_in_N", "tension_out_N"):
        if name in channels:
            return channels[name]
        if name in reading.given:
            return reading.given[name]
    return np.abs(reading.given[reading.drive])


def _worst(cells: list[tuple[float, Blame]], power: float) -> tuple[Blame, ...]:
    cells.sort(key=lambda cell: -cell[0])
    out = []
    for excess, blame in cells[:_TOLD]:
        share = excess / max(power, 1e-12)
        if share < _WORTH:
            break
        out.append(replace(blame, share=share))
    return tuple(out)


def along_routes(
    problem: Problem, at: Point, base: Matrix
) -> tuple[tuple[RouteBlame, ...], tuple[float, ...]]:
    """Return the curve angle that readings want beyond the model, by stretches of each route; (109).

    With it how much χ² falls by that of each route.
    """
    residual = problem.weighing.weighed(problem.left(at))
    names = list(dict.fromkeys(reading.route.name for reading in problem.stack.readings))
    told = [_along(problem, at, base, residual, name) for name in names]
    return tuple(blame for blame, _ in told), tuple(gain for _, gain in told)


def _along(
    problem: Problem, at: Point, base: Matrix, residual: Vector, name: str
) -> tuple[RouteBlame, float]:
    readings = problem.stack.readings
    route = next(reading.route for reading in readings if reading.route.name == name)
    length = route.arcs.total_length
    middle = (np.arange(_STRETCHES) + 0.5) * length / _STRETCHES
    before = _channels(readings, problem, at, name, None)
    tried = []
    for place in middle:
        bend = HiddenBend(at_m=place, angle_rad=_TRIAL, width_m=length / _STRETCHES)
        after = _channels(readings, problem, at, name, bend)
        change = np.zeros(problem.stack.size)
        for block in problem.stack.blocks:
            if block.run in after:
                told = after[block.run][block.channel] - before[block.run][block.channel]
                change[block.rows] = told[block.kept]
        tried.append(change / (_TRIAL * _STRETCHES / length))
    own = problem.weighing.weighed(np.column_stack(tried))
    step = np.subtract.outer(np.arange(_STRETCHES), np.arange(_STRETCHES)) / _SMOOTH
    prior = _WIDE**2 * (np.exp(-0.5 * step**2) + 1e-4 * np.eye(_STRETCHES))
    jacobian = np.column_stack([base, own])
    precision = np.zeros((jacobian.shape[1],) * 2)
    precision[2:, 2:] = np.linalg.inv(prior)
    precision[:2, :2] = np.eye(2)
    covariance = np.linalg.inv(jacobian.T @ jacobian + precision)
    wanted = covariance @ (jacobian.T @ residual)
    spread = np.sqrt(np.diag(covariance))
    gone = residual - jacobian @ wanted
    gain = float(residual @ residual - gone @ gone)
    return RouteBlame(name, read_only(middle), read_only(wanted[2:]), read_only(spread[2:])), gain


def _channels(
    readings: Sequence[Reading], problem: Problem, at: Point, name: str, bend: HiddenBend | None
) -> dict[int, dict[str, Vector]]:
    effects = at.effects if bend is None else (*at.effects, bend)
    rig = at.rig(problem.rig)
    return {k: run_channels(r, rig, effects) for k, r in enumerate(readings) if r.route.name == name}


def pointed(
    where: tuple[Blame, ...], along: tuple[RouteBlame, ...], routes: Mapping[str, str]
) -> tuple[Blame, ...]:
    """Return the places with the stretch of the route that the readings point at; `routes` by run."""
    ranges = {told.route: _stretch(told) for told in along}
    return tuple(replace(blame, route_range_m=ranges.get(routes[blame.run])) for blame in where)


def _stretch(told: RouteBlame) -> tuple[float, float] | None:
    """Return the one stretch that stands out, if less than half of the route does."""
    places = np.flatnonzero(told.extra_angle_rad_per_m > _CLEAR * told.se)
    if not len(places):
        return None
    span = int(places[-1] - places[0]) + 1
    if span > len(told.s) // 2 or len(places) < span:
        return None
    half = 0.5 * float(told.s[1] - told.s[0])
    return float(told.s[places[0]] - half), float(told.s[places[-1]] + half)
