"""Fitting a chain of so many arcs to points by Levenberg and Marquardt."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from tssgeom.route.arcs.chain import Chain, Data, first_joint_column, noise_variance, value_count
from tssgeom.route.arcs.dense import LEAST_INFORMATION, factor, inverse, solve
from tssgeom.route.arcs.equations import normal_equations
from tssgeom.route.arcs.positions import joint_frames


class ChainFit(NamedTuple):
    """How a chain with a given number of pieces is fitted, and when that ends."""

    converged: float = 1e-3
    """Promised or actual decrease of the cost at which the fit has converged [noise variances]; chosen: far
    below what any decision between chains needs."""
    most_steps: int = 40
    """Most steps [1]; chosen."""
    reach: float = 2.0
    """Longest move of a foot at a time [mean spacings]; chosen."""

    first_damping: float = 1e-9
    """Damping of the first step, of the diagonal [1]; chosen: nearly that of Gauss and Newton."""
    least_damping: float = 1e-13
    """Least damping [1]; rounding."""
    damping_of_failure: float = 1e-6
    """Least damping after a step that does not decrease the cost [1]; chosen."""
    most_damping: float = 1e6
    """Damping above which there is no way down [1]; chosen."""
    easier: float = 0.03
    """Factor on the damping after a step that decreases the cost [1]; chosen."""
    harder: float = 30.0
    """Factor on it after one that does not [1]; chosen."""

    trial_steps: int = 2
    """Steps before a fit may be given up as too far from its goal [1]; chosen."""
    still_expected: float = 4.0
    """Decrease that may still come [promised decrease of the next step]; chosen."""

    most_turn: float = 2.0
    """Greatest turn from point to point that is identifiable [rad]; chosen, below π."""
    most_turn_unobserved: float = 4.0
    """The same between points that have unobserved ones between them [rad]; chosen."""
    wide: float = 3.0
    """Distance of points that have unobserved ones between them [mean spacings]; chosen."""


FIT = ChainFit()


@njit(cache=True, nogil=True)
def parameter_covariance(data: Data, chain: Chain) -> np.ndarray:
    """Covariance [m, m] of the parameters, in the order of `Chain`."""
    lower, unit = factor(chain.matrix, LEAST_INFORMATION)
    return noise_variance(data, chain) * inverse(lower, unit)


def fit_fixed_pieces(data: Data, chain: Chain, goal: float = math.inf, *, restart: bool = False) -> Chain:
    """Fit a chain of as many pieces by Levenberg and Marquardt; its matrix and cost are not used.

    Parameters
    ----------
    data, chain
        The points, and where the fit starts.
    goal
        The fit is given up, unfinished, where its cost is not going to come down to this [m²].
    restart
        Let the chain begin at the foot of the first point, where stations are unknown: in a fit its start
        moves only across itself, so the ends of a route that moves would run away from it.
    """
    return _levenberg_marquardt(data, chain, goal, restart and data.free)


@njit(cache=True, nogil=True)
def _from_first_foot(chain: Chain) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Start, axes, joints and stations of a chain that begins at the foot of the first point."""
    begin = chain.stations[0]
    if len(chain.bend) > 1 and not begin < chain.joints[1]:
        return chain.start, chain.axes, chain.joints, chain.stations
    there, bend = np.array([chain.joints[0], begin]), np.empty((2, 2))
    for i in range(2):
        bend[i, 0], bend[i, 1] = chain.bend[0, 0], chain.bend[0, 1]
    position, frame = joint_frames(chain.start, chain.axes, there, bend)
    joints = chain.joints - begin
    joints[0] = 0.0
    return position[1], frame[1], joints, chain.stations - begin


@njit(cache=True, nogil=True)
def _levenberg_marquardt(data: Data, chain: Chain, goal: float, restart: bool) -> Chain:
    n = value_count(data)
    start, axes, joints, stations = chain.start, chain.axes, chain.joints, chain.stations
    if restart:
        start, axes, joints, stations = _from_first_foot(chain)
    now, gradient = _evaluated(data, stations, start, axes, joints, chain.bend, chain)
    damping = FIT.first_damping
    for count in range(FIT.most_steps):
        lower, unit = factor(now.matrix, damping)
        step = solve(lower, unit, gradient)
        enough = FIT.converged * (data.variance if data.variance > 0.0 else now.cost / n)
        promised = 0.0
        for a in range(len(step)):
            promised += step[a] * gradient[a]
        if not promised >= enough or damping > FIT.most_damping:
            break
        if count >= FIT.trial_steps and now.cost - FIT.still_expected * promised > goal:
            break
        start, axes, joints, bend = _stepped(step, now, data.free, data.shortest * data.spacing)
        tried, slope = _evaluated(data, now.stations, start, axes, joints, bend, chain)
        if tried.cost < now.cost and turn_is_identifiable(data, tried):
            saved = now.cost - tried.cost
            now, gradient = tried, slope
            if saved < enough and damping <= FIT.damping_of_failure:
                break
            damping = max(FIT.easier * damping, FIT.least_damping)
        else:
            damping = max(FIT.harder * damping, FIT.damping_of_failure)
    return now


@njit(cache=True, nogil=True)
def equations_with_pieces(
    data: Data, chain: Chain, joints: np.ndarray, bend: np.ndarray, curved: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return matrix and gradient of the normal equations of other pieces on the curve of a chain."""
    other = Chain(
        chain.start, chain.axes, joints, bend, curved, chain.stations, chain.matrix, chain.cost, chain.square
    )
    matrix, gradient, _, _ = normal_equations(data, other, 0.0)
    return matrix, gradient


@njit(cache=True, nogil=True)
def turn_is_identifiable(data: Data, chain: Chain) -> bool:
    """Whether the chain turns so little from one point to the next that the points can determine it."""
    s, joints, bend = chain.stations, chain.joints, chain.bend
    j, before, here = 0, -1, s[0]
    for i in range(len(s)):
        if data.weight[i] <= 0.0:
            continue
        turned, j = _turned_to(s[i], here, j, joints, bend)
        wide = before >= 0 and s[i] - s[before] > FIT.wide * data.spacing
        if before >= 0 and not turned < (FIT.most_turn_unobserved if wide else FIT.most_turn):
            return False
        before, here = i, s[i]
    turned, _ = _turned_to(max(s[-1], joints[-1]), here, j, joints, bend)  # the end, where no point counts
    return turned < FIT.most_turn_unobserved


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
    stations: np.ndarray,
    start: np.ndarray,
    axes: np.ndarray,
    joints: np.ndarray,
    bend: np.ndarray,
    chain: Chain,
) -> tuple[Chain, np.ndarray]:
    """Return the chain with its equations, unknown stations put at the feet of the points, and the gradient.

    What is not given is that of `chain`.
    """
    s = stations.copy()
    at = Chain(start, axes, joints, bend, chain.curved, s, chain.matrix, chain.cost, chain.square)
    matrix, gradient, cost, square = normal_equations(data, at, FIT.reach * data.spacing)
    return Chain(start, axes, joints, bend, chain.curved, s, matrix, cost, square), gradient


@njit(cache=True, nogil=True)
def _stepped(
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
            along = unit[0] * axes[i, 0] + unit[1] * axes[i, 1] + unit[2] * axes[i, 2]
            for c in range(3):
                d, e = (c + 1) % 3, (c + 2) % 3
                cross = unit[d] * axes[i, e] - unit[e] * axes[i, d]
                bow = unit[c] * along - axes[i, c]
                new_axes[i, c] += math.sin(size) * cross + 2 * half * half * bow
    return new_start, new_axes
