"""Φ and the length of a route by few points, by what curvature may do between them; docs/model.md (235).

Four priors are compared by their evidence: turns at the points alone, curvature that is a random walk, as it
is in the mean for arcs, curvature that oscillates, and curvature whose rate is a random walk. Each is sampled
given the points.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Points, Vector, rows_at
from tssgeom.route.bend_priors import Form, Prior, at_points, cells, form_of, oscillations, walk
from tssgeom.route.bounds import polygon
from tssgeom.route.direction_rows import DirectionRows, direction_rows
from tssgeom.route.error_posterior import GRID
from tssgeom.route.model_choice import log_sum
from tssgeom.route.observations import NOISE_PRIOR, noise_price
from tssgeom.route.ratio_average import GRID as RATIO
from tssgeom.route.resolution import bend_without_twist, without_twist
from tssgeom.route.route import STATIONS, Route, step_lengths
from tssgeom.route.route_fit import RouteFit, Turned
from tssgeom.threads import single_threaded


class _Curve(NamedTuple):
    """A route of even cells of constant curvature; lengths are over that of the first fit."""

    start: Vector
    """First position [3]."""
    axes: Matrix
    """Tangent and two normals there, in columns [3, 3]."""
    bend: Matrix
    """Curvature along both normals, which are carried without twist [cells, 2]."""
    length: float


class _Nodes(NamedTuple):
    """A curve at the edges of its cells."""

    s: Vector
    position: Points
    axes: np.ndarray
    """Tangent and both normals, in columns [cells + 1, 3, 3]."""


class _Linear(NamedTuple):
    """Where points lie across a route, and directions point, as its curvature moves them."""

    across: Vector
    """What lies across, by both normals at each point, then at each direction [2 (n + k)]."""
    by_bend: np.ndarray
    """What the curvature of each cell moves [2 (n + k), cells, 2]."""
    by_start: Matrix
    """What position and direction of the first point move [2 (n + k), 4]."""
    station: Vector
    """Feet of the points [n]."""


class _Turns(NamedTuple):
    """What draws of the curvature turn [draws]; lengths are over that of the first fit."""

    angle: Vector
    """Φ [rad]."""
    length: Vector
    between: Vector
    """Greatest turn between two points [rad]."""


class _Posterior(NamedTuple):
    """What points show of the components, whatever the start of the route."""

    prior: Prior
    by_scaled: Matrix
    """Points by the components of both normals, turned so that these make independent ones [m, 2 r]."""
    by_fixed: Matrix
    """The same of those of a known size [m, 2 f]."""
    sensed: Vector
    """The points [m]."""
    log_evidence: Matrix
    """ln of evidence and prior for each intensity and noise."""


def turned_between(
    points: Points, smooth: RouteFit, noise: float | None, direction_noise: float = 0.0
) -> tuple[Turned, ...]:
    """Return Φ and length of routes by points [n, 3] [m] beyond a smooth fit, by prior.

    The last prior is smooth, the one before it oscillates. The noise [m] is averaged over where it is not
    known. The directions that the fit used count with their noise [rad]; (330).

    Notes
    -----
    Source: docs/model.md (229), (235) to (237), (330).
    """
    route, arcs = smooth.route, smooth.arcs
    used, unit = route.weight > 0.0, float(route.s[-1])
    noises, price = _noises(route, noise)
    with single_threaded():  # matrices are small
        curve, linear, turn = _followed(
            points[used] / unit,
            direction_rows(smooth, used, direction_noise),
            route.station[used] / unit,
            _first(route),
            noises,
            price,
        )
        rng = np.random.default_rng(0)
        waves = oscillations(int(np.count_nonzero(used)))
        priors = ((at_points(linear.station),), (walk(1, turn),), waves, (walk(2, turn),))
        every = [[_posterior(linear, one, noises, price) for one in alike] for alike in priors]
        draws = [
            _turns(*_sampled(alike, len(linear.station), noises, rng), linear.station, curve)
            for alike in every
        ]
    evidence = [log_sum(_log_evidence(alike).ravel()) for alike in every]
    draws[-2], share = _observed(draws[-2])
    evidence[-2] += math.log(share) if share > 0.0 else -math.inf
    return tuple(
        Turned(
            float(one.angle.mean()) - arcs.total_angle,
            float(one.angle.var()),
            unit * float(one.length.mean()) - arcs.total_length,
            unit**2 * float(one.length.var()),
            known,
        )
        for one, known in zip(draws, evidence, strict=True)
    )


def _noises(route: Route, noise: float | None) -> tuple[Vector, Vector]:
    """Return noises over the length, and ln of the prior of each."""
    length = float(route.s[-1])
    if noise is not None:
        return np.array([max(noise / length, float(np.finfo(np.float64).eps))]), np.zeros(1)
    every = NOISE_PRIOR.typical * 10.0 ** (NOISE_PRIOR.decades * np.array(GRID.sizes))
    every = np.append(every, max(route.noise / length, float(every[0])))
    return every, -0.5 * np.array([noise_price(float(one)) for one in every])


def _first(route: Route) -> _Curve:
    unit, (first, second) = float(route.s[-1]), without_twist(route.tangent)
    axes = np.column_stack((route.tangent[0], first[0], second[0]))
    bend = unit * rows_at(unit * cells(), route.s, bend_without_twist(route))
    return _Curve(route.position[0] / unit, axes, bend, 1.0)


def _nodes(curve: _Curve) -> _Nodes:
    """Follow a curve from cell to cell."""
    step = curve.length / len(curve.bend)
    a, b = (curve.bend * step).T
    angle, none = np.hypot(a, b), np.zeros(len(a))
    about = np.array([[none, -a, -b], [a, none, none], [b, none, none]]).transpose(2, 0, 1)
    sine, rest = np.sinc(angle / np.pi), 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    turned = np.eye(3) + sine[:, None, None] * about + rest[:, None, None] * (about @ about)
    doubled = 1
    while doubled < len(turned):  # the product of all turns up to each
        turned[doubled:] = turned[:-doubled] @ turned[doubled:]
        doubled *= 2
    axes = np.concatenate((curve.axes[None], curve.axes @ turned))
    chord = axes[:-1, :, 0] + axes[1:, :, 0]
    chord *= (step * np.sinc(0.5 * angle / np.pi) / np.linalg.norm(chord, axis=1))[:, None]
    position = curve.start + np.concatenate((np.zeros((1, 3)), np.cumsum(chord, axis=0)))
    return _Nodes(np.linspace(0.0, curve.length, len(turned) + 1), position, axes)


def _linearised(points: Points, tangents: DirectionRows | None, station: Vector, curve: _Curve) -> _Linear:
    """Linearise where points lie across a curve, and directions point, in its curvature and start; (235)."""
    nodes, step = _nodes(curve), curve.length / len(curve.bend)
    at = rows_at(station, nodes.s, nodes.position)
    axes = rows_at(station, nodes.s, nodes.axes.reshape(-1, 9)).reshape(-1, 3, 3)
    tangent = axes[:, :, 0] / np.linalg.norm(axes[:, :, 0], axis=1, keepdims=True)
    normals, off = axes[:, :, 1:], points - at
    normals = normals - tangent[:, :, None] * np.einsum("ni,nij->nj", tangent, normals)[:, None]
    before = np.clip(station[:, None] - nodes.s[:-1], 0.0, step)  # length of each cell before each point
    middle = 0.5 * (nodes.axes[1:] + nodes.axes[:-1])
    arm = at[:, None] - nodes.position[:-1] - 0.5 * before[..., None] * middle[:, :, 0]
    moved = _swung(arm, middle) * before[..., None, None]
    swung = _swung(at - curve.start, curve.axes)
    start = np.concatenate((np.broadcast_to(curve.axes[:, 1:], swung.shape), swung), axis=2)
    if tangents is not None:
        row, unit, weight = tangents
        normals = np.concatenate((normals, normals[row] * weight[:, None, None]))
        off = np.concatenate((off, unit - tangent[row]))
        turned = _swung(np.broadcast_to(tangent[row][:, None], (len(row), len(middle), 3)), middle)
        moved = np.concatenate((moved, turned * before[row][..., None, None]))
        tilted = _swung(tangent[row], curve.axes)
        start = np.concatenate((start, np.concatenate((np.zeros_like(tilted), tilted), axis=2)))
    by_bend = np.einsum("nie,ncij->necj", normals, moved).reshape(2 * len(off), -1, 2)
    across = np.einsum("nie,ni->ne", normals, off).ravel() + np.tensordot(by_bend, curve.bend, 2)
    by_start = np.einsum("nie,nij->nej", normals, start).reshape(-1, 4)
    further = np.einsum("ni,ni->n", off[: len(points)], tangent)
    return _Linear(across, by_bend, by_start, station + further)


def _swung(arm: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Return how turns of a tangent towards both normals move what an arm from there reaches [..., 3, 2]."""
    forward = np.einsum("...i,...i->...", arm, axes[..., 0])
    aside = np.einsum("...i,...ij->...j", arm, axes[..., 1:])
    return forward[..., None, None] * axes[..., 1:] - aside[..., None, :] * axes[..., :1]


def _followed(
    points: Points,
    tangents: DirectionRows | None,
    station: Vector,
    curve: _Curve,
    noises: Vector,
    price: Vector,
) -> tuple[_Curve, _Linear, float]:
    """Return the likeliest curve whose curvature is a random walk, where points lie, and what these turn."""
    turn, every = float(polygon(points, np.ones(len(points))).turn.sum()), []
    for _ in range(RATIO.passes):
        station = np.maximum.accumulate(station - station[0])
        curve = curve._replace(length=float(station[-1]))
        linear = _linearised(points, tangents, station, curve)
        posterior = _posterior(linear, walk(1, turn), noises, price)
        every.append((float(posterior.log_evidence.max()), curve, linear._replace(station=station)))
        if len(every) > 1 and every[-1][0] < every[-2][0] + RATIO.converged:
            break
        curve, station = _stepped(curve, linear, posterior, noises), linear.station
    return (*max(every, key=lambda one: one[0])[1:], turn)


def _stepped(curve: _Curve, linear: _Linear, posterior: _Posterior, noises: Vector) -> _Curve:
    """Return the likeliest curve."""
    i, j = np.unravel_index(int(posterior.log_evidence.argmax()), posterior.log_evidence.shape)
    bend = _bend(posterior.prior, _given(posterior, float(_intensities()[i]), float(noises[j])))[..., 0]
    left = linear.across - np.tensordot(linear.by_bend, bend, 2)
    moved = np.linalg.lstsq(linear.by_start, left, rcond=None)[0].astype(np.float64)
    tilted = _nodes(_Curve(np.zeros(3), curve.axes, moved[np.newaxis, 2:], 1.0)).axes[-1]
    return curve._replace(start=curve.start + curve.axes[:, 1:] @ moved[:2], axes=tilted, bend=bend)


@cache
def _intensities() -> Vector:
    return np.geomspace(GRID.gentlest, GRID.sharpest, GRID.intensities)


def _posterior(linear: _Linear, prior: Prior, noises: Vector, price: Vector) -> _Posterior:
    """Evidence of the points for each intensity and noise, whatever the start of the route; (236)."""
    apart = np.linalg.qr(linear.by_start, mode="complete")[0][:, 4:]
    by_bend = np.tensordot(apart, linear.by_bend, (0, 0))
    by_scaled, by_fixed = (
        np.tensordot(by_bend, one, (1, 0)).transpose(0, 2, 1).reshape(len(by_bend), -1) for one in prior[:2]
    )
    ratio, turned = np.linalg.eigh(by_scaled @ by_scaled.T)
    by_scaled, by_fixed, sensed = (turned.T @ one for one in (by_scaled, by_fixed, apart.T @ linear.across))
    own = _intensities()[:, None, None] * np.maximum(ratio, 0.0) + noises[:, None] ** 2
    inner = np.eye(by_fixed.shape[1]) + np.matmul(by_fixed.T / own[..., None, :], by_fixed)
    moved = ((sensed / own) @ by_fixed)[..., None]
    known = np.sum(moved * np.linalg.solve(inner, moved), axis=(-2, -1))
    square, volume = (sensed**2 / own).sum(axis=-1) - known, np.log(own).sum(axis=-1)
    log_evidence = price + prior.log_share - 0.5 * (square + volume + np.linalg.slogdet(inner)[1])
    return _Posterior(prior, by_scaled, by_fixed, sensed, log_evidence)


def _given(
    posterior: _Posterior,
    intensity: float,
    noise: float,
    rng: np.random.Generator | None = None,
    count: int = 1,
) -> np.ndarray:
    """Components given the points: their mean, or draws of a generator [2 r + 2 f, count]."""
    size = math.sqrt(intensity)
    moved = np.column_stack((size * posterior.by_scaled, posterior.by_fixed))
    rows, columns = moved.shape
    free, error = np.zeros((columns, count)), np.zeros((rows, count))
    if rng is not None:
        free, error = rng.standard_normal(free.shape), noise * rng.standard_normal(error.shape)
    variance = moved @ moved.T + noise**2 * np.eye(rows)
    free = free + moved.T @ np.linalg.solve(variance, posterior.sensed[:, None] - moved @ free - error)
    free[: posterior.by_scaled.shape[1]] *= size
    return free


def _bend(prior: Prior, free: Matrix) -> np.ndarray:
    """Curvature of components [2 r + 2 f, count] along both normals [cells, 2, count]."""
    return np.tensordot(np.column_stack(prior[:2]), free.reshape(-1, 2, free.shape[1]), 1)


def _log_evidence(alike: Sequence[_Posterior]) -> np.ndarray:
    """Evidence and prior of posteriors that are as likely beforehand, ln, by intensity and noise."""
    return np.array([one.log_evidence for one in alike])


def _sampled(
    alike: Sequence[_Posterior], points: int, noises: Vector, rng: np.random.Generator
) -> tuple[np.ndarray, Form]:
    """Draws of curvature over posteriors, intensities and noises [cells, 2, draws], and the form of each."""
    log_evidence = _log_evidence(alike)
    probability = np.exp(log_evidence - log_sum(log_evidence.ravel()))
    count = rng.multinomial(GRID.draws, (probability / probability.sum()).ravel()).reshape(probability.shape)
    every, form = list[np.ndarray](), list[Form]()
    for k, i, j in np.argwhere(count):
        one, intensity, noise = alike[k], float(_intensities()[i]), float(noises[j])
        every.append(_bend(one.prior, _given(one, intensity, noise, rng, int(count[k, i, j]))))
        form.append(form_of(one.prior.half_waves, every[-1], points, noise, rng))
    return np.concatenate(every, axis=2), Form(*map(np.concatenate, zip(*form, strict=True)))


def _turns(bend: np.ndarray, form: Form, station: Vector, curve: _Curve) -> _Turns:
    """Turn and length of draws of the curvature [cells, 2, draws], and their turn between points; (237)."""
    nodes, step = _nodes(curve), curve.length / len(bend)
    turn = step * np.linalg.norm(bend, axis=1)
    chords = float(step_lengths(rows_at(station, nodes.s, nodes.position)).sum())
    turned = np.cumsum(bend, axis=0) * step
    interval = np.clip(
        np.searchsorted(station, nodes.s[1:] - 0.5 * step, side="right") - 1, 0, len(station) - 2
    )
    within = (interval[:, None] == interval).astype(np.float64)
    chord = np.tensordot(within / within.sum(axis=1, keepdims=True), turned, 1)
    length = chords + 0.5 * step * np.sum((turned - chord) ** 2, axis=(0, 1))
    of_chords = np.linalg.norm(np.diff(chord, axis=0), axis=1).sum(axis=0)
    of_sines = turn.sum(axis=0)
    angle = form.turn(of_sines, of_chords)
    share = angle / np.maximum(of_sines, np.finfo(np.float64).tiny)
    return _Turns(angle, length, share * (within @ turn).max(axis=0))


def _observed(draws: _Turns) -> tuple[_Turns, float]:
    """Return the draws that do not wind between two points, and their share; all where there is none."""
    straight = draws.between <= STATIONS.most_turn_over_chord
    if not straight.any():
        return draws, 0.0
    return _Turns(*(one[straight] for one in draws)), float(straight.mean())
