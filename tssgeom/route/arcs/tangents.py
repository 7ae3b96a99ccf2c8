"""Sensed directions beside the points of a chain: how much they count, and which stand off it."""

from __future__ import annotations

import math

import numpy as np

from tssgeom.arrays import Points, Vector
from tssgeom.route.arcs.fit import Chain, Data, direction_count, noise_variance, settle, values
from tssgeom.route.arcs.moves import fit_chain
from tssgeom.route.arcs.positions import along, off_chain
from tssgeom.route.directions import variances

_STRAY = 16.0  # squared standard deviations, with 2 ln n added, beyond which a direction is an outlier
_SAME = 0.1  # relative change of the noise variance that asks for no new weights
_ROUNDS = 3
_SHORTEST = 1.5  # spacings: a shorter piece in the first guess may hold no point
_ROUNDING = 1e-9  # of the spacing


def faced(data: Data, aim: Points | None, known: float, kappa: Vector, variance: float) -> Data:
    """Add sensed directions, weighed against points of the given noise variance; docs/model.md (94).

    Parameters
    ----------
    data
        The points.
    aim, known
        Directions, rows of NaN where none is used [n, 3], and the variance of a component [rad²].
    kappa
        Curvature at the points, as far as it is known [n] [1/m].
    variance
        Noise variance of a coordinate, where `data` knows none [m²].
    """
    if aim is None:
        return data
    least = data.variance or max(variance, (_ROUNDING * data.gap) ** 2)
    blur = variances(aim, known, kappa**2 * least if data.free else np.zeros(len(aim)))
    return _weighed(data, np.nan_to_num(aim), blur, least)


def _weighed(data: Data, aim: Points, blur: Vector, variance: float) -> Data:
    used = blur > 0.0
    heft = np.where(used, variance / np.where(used, blur, 1.0), 0.0)
    return data._replace(told=(aim, heft, blur))


def curvature_at_points(chain: Chain) -> Vector:
    """Curvature of the chain at the stations of its points [n] [1/m]."""
    piece = np.searchsorted(chain.joints[1:], chain.stations, side="right")
    return np.linalg.norm(chain.bend, axis=1)[piece]


def off_directions(data: Data, chain: Chain) -> Vector:
    """Squared residuals of the directions across the chain, 0 where none is used [n] [rad²]."""
    if data.told is None:
        return np.zeros(0)
    aim, _, blur = data.told
    _, tangent, _ = along(chain.stations, *chain[:4])
    ahead = np.einsum("ij,ij->i", aim, tangent)
    square = np.where(ahead > 0.0, np.maximum(1.0 - ahead * ahead, 0.0), 4.0)
    return np.where(blur > 0.0, square, 0.0)


def reweighed(data: Data, chain: Chain) -> tuple[Data, Chain]:
    """Fit again without directions that stand off, and with weights that follow the noise of the points."""
    if data.told is None:
        return data, chain
    for _ in range(_ROUNDS):
        changed = _by_noise(without_stray_directions(data, chain), chain)
        if changed is data:
            break
        data = changed
        chain = fit_chain(data, settle(data, chain))
    return data, chain


def without_stray_directions(data: Data, chain: Chain) -> Data:
    """Leave out directions that the chain does not explain."""
    count = direction_count(data.told)
    if data.told is None or not count:
        return data
    aim, heft, blur = data.told
    limit = _STRAY + 2.0 * math.log(max(count, 2))
    if not data.variance:
        limit *= max(noise_variance(data, chain) / float(np.max(heft * blur)), 1.0)
    off = off_directions(data, chain) > limit * blur
    if not off.any() or np.count_nonzero(off) > max(0.1 * count, 1.0):
        return data
    return _weighed(data, aim, np.where(off, 0.0, blur), float(np.max(heft * blur)))


def _by_noise(data: Data, chain: Chain) -> Data:
    """Weigh directions by the noise that the points alone show, where it is not known."""
    count = direction_count(data.told)
    if data.told is None or data.variance or not count:
        return data
    aim, heft, blur = data.told
    square = off_chain(data.points, chain.stations, *chain[:4], data.free)
    points = values(data) - 2 * count
    freedom = max(points * (1.0 - len(chain.matrix) / values(data)), 1.0)
    variance = max(float(data.weight @ square) / freedom, (_ROUNDING * data.gap) ** 2)
    now = float(np.max(heft * blur))
    return data if abs(variance / now - 1.0) < _SAME else _weighed(data, aim, blur, variance)


def without_short(chain: Chain, data: Data) -> Chain:
    """Make pieces of less than one and a half spacings one with the neighbour that bends most alike."""
    joints, bend = np.append(chain.joints, chain.stations[-1]), chain.bend
    while len(bend) > 1:
        length = np.diff(joints)
        i = int(np.argmin(length))
        if length[i] >= _SHORTEST * data.gap:
            break
        unlike = np.linalg.norm(np.diff(bend, axis=0), axis=1)
        lower = min(range(max(i - 1, 0), min(i + 1, len(bend) - 1)), key=lambda j: unlike[j])
        pair = slice(lower, lower + 2)
        mean = length[pair] @ bend[pair] / length[pair].sum()
        bend = np.vstack((bend[:lower], mean, bend[lower + 2 :]))
        joints = np.delete(joints, lower + 1)
    return chain._replace(joints=joints[:-1], bend=bend, curved=np.ones(len(bend), np.bool_))
