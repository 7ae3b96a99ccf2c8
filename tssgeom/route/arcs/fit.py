"""Fitting a chain of arcs to points by Levenberg and Marquardt, with the covariance of its parameters."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.route.arcs.dense import factor, inverse, solve
from tssgeom.route.arcs.equations import normal_equations
from tssgeom.route.arcs.positions import joint_frames

KINK = 0.1
"""Shortest piece of a chain with kinks, in spacings [1]."""

LEAST_INFORMATION = 1e-13
"""Of a parameter's own, where the others tell nearly all of it [1]."""

_SETTLED = 1e-3  # of the noise variance: a step that saves less of the cost is the last
_MOST_STEPS = 40
_LEAST_VARIANCE = 1e-26  # rounding of coordinates [m²]
_FIRST_DAMPING = 1e-9
_STEPS_OF_GRACE = 2  # before a fit is given up
_HOPE = 4.0  # times what the next step promises may still come
_CLEARLY = 0.9
_MOST_TURN = 2.0  # from point to point [rad]
_MOST_TURN_UNSEEN = 4.0  # where points between them were not seen [rad]
_WIDE = 3.0  # mean spacings: points farther apart have others between them that were not seen


class Data(NamedTuple):
    """Points and what is known of them, lengths in metres."""

    points: Points
    weight: Vector
    free: bool
    """True where stations are unknown."""
    variance: float
    """Known noise variance of a coordinate, 0 where unknown [m²]."""
    gap: float
    """Mean spacing [m]."""
    told: tuple[Points, Vector, Vector] | None = None
    """Sensed directions [n, 3], the noise variance of the points over that of each direction [n] [m²], and
    that variance [n] [rad²], both 0 where none was sensed."""
    shortest: float = 1.0
    """Shortest piece, in spacings: `KINK` where there are kinks, or noise would look like them [1]."""


class Chain(NamedTuple):
    """A fitted chain; see `equations.normal_equations` for its parameters."""

    start: Vector
    axes: Matrix
    joints: Vector
    bend: Points
    curved: np.ndarray
    stations: Vector
    matrix: Matrix
    cost: float
    square: Vector
    """Squared distance of each point, across the chain where stations are free [n] [m²]."""


@njit(cache=True, nogil=True)
def has_kink(chain: Chain, spacing: float) -> bool:
    """Whether an inner piece is clearly shorter than the mean spacing [m]."""
    least, joints = math.inf, chain.joints
    for j in range(1, len(joints) - 1):
        least = min(least, joints[j + 1] - joints[j])
    return least < _CLEARLY * spacing


@njit(cache=True, nogil=True)
def values(data: Data) -> int:
    """Return the number of values that are fitted."""
    used = 0
    for weight in data.weight:
        used += 1 if weight > 0.0 else 0
    return (2 if data.free else 3) * used + 2 * direction_count(data.told)


@njit(cache=True, nogil=True)
def direction_count(told: tuple[Points, Vector, Vector] | None) -> int:
    """Return the number of directions that are fitted."""
    if told is None:
        return 0
    return int(np.sum(told[1] > 0.0))


@njit(cache=True, nogil=True)
def first_joint_column(free: bool) -> int:
    """Return the parameter of the first inner joint: before it stand the start and two turns."""
    return (2 if free else 3) + 2


def parameter_count(curved: np.ndarray, free: bool) -> int:
    """Return the number of parameters of a chain: start, turns, joints, curvatures."""
    return first_joint_column(free) + len(curved) - 1 + 2 * int(curved.sum())


@njit(cache=True, nogil=True)
def curvature_columns(curved: np.ndarray, free: bool) -> np.ndarray:
    """First parameter of each piece's curvature [k], -1 for a straight piece."""
    column = np.full(len(curved), -1)
    following = first_joint_column(free) + len(curved) - 1
    for j in range(len(curved)):
        if curved[j]:
            column[j] = following
            following += 2
    return column


@njit(cache=True, nogil=True)
def criterion(data: Data, chain: Chain) -> float:
    """-2 ln of the greatest likelihood, plus the price of every parameter."""
    n = values(data)
    price = len(chain.matrix) * math.log(n)
    if data.variance > 0.0:
        return chain.cost / data.variance + n * math.log(data.variance) + price
    return n * math.log(chain.cost / n + 1e-300) + n + price


def goal(data: Data, parameters: int, least: float) -> float:
    """Cost [m²] at which a chain of so many parameters has the criterion `least`."""
    n = values(data)
    rest = least - parameters * math.log(n)
    if data.variance > 0.0:
        return (rest - n * math.log(data.variance)) * data.variance
    return n * math.exp(min(rest / n - 1.0, 700.0))


@njit(cache=True, nogil=True)
def noise_variance(data: Data, chain: Chain) -> float:
    """Noise variance of a coordinate, known or from the residuals [m²]."""
    if data.variance > 0.0:
        return data.variance
    return max(chain.cost / max(values(data) - len(chain.matrix), 1), _LEAST_VARIANCE)


@njit(cache=True, nogil=True)
def parameter_covariance(data: Data, chain: Chain) -> np.ndarray:
    """Covariance [m, m] of the parameters, in the order of `equations.normal_equations`."""
    lower, unit = factor(chain.matrix, LEAST_INFORMATION)
    return noise_variance(data, chain) * inverse(lower, unit)


def settle(data: Data, chain: Chain, least: float = math.inf, *, anew: bool = False) -> Chain:
    """Fit a chain of as many pieces by Levenberg and Marquardt; its matrix and cost are not used.

    The fit is given up, unfinished, where its cost is not going to come down to `least` [m²]. `anew` lets the
    chain begin at the foot of the first point, where stations are free: its start moves only across itself in
    a fit, so the ends of a route that moves would run away from it.
    """
    return _settled(data, chain, least, anew and data.free)  # a default would be compiled a second time


@njit(cache=True, nogil=True)
def _begun_anew(chain: Chain) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Start, axes, joints and stations of a chain that begins at the foot of the first point."""
    begin = chain.stations[0]
    if len(chain.bend) > 1 and not begin < chain.joints[1]:
        return chain.start, chain.axes, chain.joints, chain.stations
    there, bend = np.array([chain.joints[0], begin]), np.empty((2, 2))
    for i in range(2):
        bend[i, 0], bend[i, 1] = chain.bend[0, 0], chain.bend[0, 1]
    place, frame = joint_frames(chain.start, chain.axes, there, bend)
    joints = chain.joints - begin
    joints[0] = 0.0
    return place[1], frame[1], joints, chain.stations - begin


@njit(cache=True, nogil=True)
def _settled(data: Data, chain: Chain, goal: float, anew: bool) -> Chain:
    n = values(data)
    start, axes, joints, stations = chain.start, chain.axes, chain.joints, chain.stations
    if anew:
        start, axes, joints, stations = _begun_anew(chain)
    now, gradient = _evaluated(data, stations, start, axes, joints, chain.bend, chain.curved)
    damping = _FIRST_DAMPING
    for count in range(_MOST_STEPS):
        lower, unit = factor(now.matrix, damping)
        step = solve(lower, unit, gradient)
        enough = _SETTLED * (data.variance if data.variance > 0.0 else now.cost / n)
        promised = 0.0
        for a in range(len(step)):
            promised += step[a] * gradient[a]
        if not promised >= enough or damping > 1e6:
            break
        if count >= _STEPS_OF_GRACE and now.cost - _HOPE * promised > goal:
            break
        start, axes, joints, bend = _moved(step, now, data.free, data.shortest * data.gap)
        tried, ahead = _evaluated(data, now.stations, start, axes, joints, bend, chain.curved)
        if tried.cost < now.cost and tame(data, tried.stations, joints, bend):
            saved = now.cost - tried.cost
            now, gradient = tried, ahead
            if saved < enough and damping <= 1e-6:
                break
            damping = max(0.03 * damping, 1e-13)
        else:
            damping = max(30.0 * damping, 1e-6)
    return now


@njit(cache=True, nogil=True)
def equations_of(
    data: Data, chain: Chain, joints: np.ndarray, bend: np.ndarray, curved: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return matrix and gradient of the normal equations of other pieces on the curve of a chain."""
    matrix, gradient, _, _ = normal_equations(
        data.points,
        data.weight,
        chain.stations,
        chain.start,
        chain.axes,
        joints,
        bend,
        curved,
        data.free,
        data.told,
        0.0,
    )
    return matrix, gradient


@njit(cache=True, nogil=True)
def tame(data: Data, s: np.ndarray, joints: np.ndarray, bend: np.ndarray) -> bool:
    """Whether the chain turns no more from one point to the next than anyone could tell."""
    j, before, here = 0, -1, s[0]
    for i in range(len(s)):
        if data.weight[i] <= 0.0:
            continue
        turned, j = _turned_to(s[i], here, j, joints, bend)
        wide = before >= 0 and s[i] - s[before] > _WIDE * data.gap
        if before >= 0 and not turned < (_MOST_TURN_UNSEEN if wide else _MOST_TURN):
            return False
        before, here = i, s[i]
    turned, _ = _turned_to(max(s[-1], joints[-1]), here, j, joints, bend)  # the end, where no point counts
    return turned < _MOST_TURN_UNSEEN


@njit(cache=True, nogil=True)
def _turned_to(there: float, here: float, j: int, joints: np.ndarray, bend: np.ndarray) -> tuple[float, int]:
    """Return the angle by which a chain turns from `here`, on piece j, to `there` [rad], and that piece."""
    turned = 0.0
    while j + 1 < len(joints) and joints[j + 1] <= there:
        turned += max(joints[j + 1] - here, 0.0) * math.sqrt(bend[j, 0] ** 2 + bend[j, 1] ** 2)
        here, j = max(joints[j + 1], here), j + 1
    return turned + max(there - here, 0.0) * math.sqrt(bend[j, 0] ** 2 + bend[j, 1] ** 2), j


@njit(cache=True, nogil=True)
def _evaluated(
    data: Data,
    s: np.ndarray,
    start: np.ndarray,
    axes: np.ndarray,
    joints: np.ndarray,
    bend: np.ndarray,
    curved: np.ndarray,
) -> tuple[Chain, np.ndarray]:
    """Return the chain with its equations, free stations put at the feet of the points, and the gradient."""
    s, reach = s.copy(), 2 * data.gap
    matrix, gradient, cost, square = normal_equations(
        data.points, data.weight, s, start, axes, joints, bend, curved, data.free, data.told, reach
    )
    return Chain(start, axes, joints, bend, curved, s, matrix, cost, square), gradient


@njit(cache=True, nogil=True)
def _moved(
    step: np.ndarray, chain: Chain, free: bool, shortest: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Apply a parameter step, joints kept in order and at least `shortest` [m] apart.

    Where joints move, the turn of a piece follows its step, not the curvature: that of a short piece would
    need many steps along a bent valley.
    """
    start, axes = _turned(step, chain.start, chain.axes, free)
    joints, bend = chain.joints.copy(), chain.bend.copy()
    k, row = len(bend), first_joint_column(free)
    for j in range(1, k):
        joints[j] = max(joints[j] + step[row], joints[j - 1] + shortest)
        row += 1
    for j in range(k - 1, 0, -1):
        limit = joints[j + 1] if j + 1 < k else chain.stations[-1]
        joints[j] = min(joints[j], limit - shortest)
    for j in range(k):
        if chain.curved[j]:
            end = chain.stations[-1]
            before = (chain.joints[j + 1] if j + 1 < k else end) - chain.joints[j]
            after = (joints[j + 1] if j + 1 < k else end) - joints[j]
            scale = max(before, shortest) / max(after, shortest)
            bend[j, 0] += scale * step[row]
            bend[j, 1] += scale * step[row + 1]
            row += 2
    return start, axes, joints, bend


@njit(cache=True, nogil=True)
def _turned(
    step: np.ndarray, start: np.ndarray, axes: np.ndarray, free: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Shift and turn the start of a chain by the first parameters of a step."""
    shifts = 2 if free else 3
    new_start, new_axes = start.copy(), axes.copy()
    unit = np.empty(3)
    for i in range(3):
        unit[i] = step[shifts] * axes[1, i] + step[shifts + 1] * axes[2, i]
        for c in range(shifts):
            new_start[i] += step[c] * (axes[1 + c, i] if free else (1.0 if c == i else 0.0))
    size = math.sqrt(unit[0] ** 2 + unit[1] ** 2 + unit[2] ** 2)
    if size > 0.0:
        half = math.sin(0.5 * size)
        for i in range(3):
            unit[i] /= size
        for i in range(3):
            ahead = unit[0] * axes[i, 0] + unit[1] * axes[i, 1] + unit[2] * axes[i, 2]
            for c in range(3):
                d, e = (c + 1) % 3, (c + 2) % 3
                cross = unit[d] * axes[i, e] - unit[e] * axes[i, d]
                bow = unit[c] * ahead - axes[i, c]
                new_axes[i, c] += math.sin(size) * cross + 2 * half * half * bow
    return new_start, new_axes
