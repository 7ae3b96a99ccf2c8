"""The filter in time in plain numpy: one matrix for all motions, a cosine transform for the smooth part."""

import sys

import numpy as np
from scipy.fft import dct

from tssgeom.core.constants_route import TIME_FILTER

RESTLESSNESS = np.array([0.0, 1e-5, 1e-3, 1e-1, 1e1, 1e3, 1e9])
MOTIONS, SMOOTH = len(RESTLESSNESS), 8


def transitions():
    """Probability of going from a motion (row) to another (column)."""
    way = np.zeros((MOTIONS, MOTIONS))
    for i in range(MOTIONS):
        for j in range(MOTIONS):
            if abs(i - j) == 1:
                way[i, j] = TIME_FILTER.neighbour
            elif j > i:
                way[i, j] = TIME_FILTER.start
    return way + np.diag(1.0 - way.sum(axis=1))


def filter_in_time(memory, probability, covariance, noise, points, step, most_variance, direction=None):
    """Do as `core.filter_in_time`, without what only judges single points; all coordinates are sensed."""

    def smooth_part(field):
        """Components of fields [..., n, coordinates]: the first eight along the points, or one direction."""
        if direction is None:
            return dct(field, axis=-2, norm="ortho")[..., :SMOOTH, :]
        return np.sum(field * direction, axis=(-2, -1), keepdims=True)

    observed = np.isfinite(points.sum(axis=1))
    positions, velocities = memory[:MOTIONS], memory[MOTIONS : 2 * MOTIONS]
    last, before = memory[-2:]
    coordinates, count = points.shape[1], min(len(points), SMOOTH)
    values = coordinates * count
    if direction is not None:
        count = values = 1
    low, high = np.array(noise[:2]), np.array(noise[2:4])
    if noise[4] > 0.0:
        ratio = step / noise[4]
        second = points - last - ratio * (last - before)
        all_three = np.isfinite(second.sum(axis=1))
        second[~all_three] = 0.0
        rest = (second**2).sum() - (smooth_part(second) ** 2).sum()
        if all_three.sum() > count:
            more = 0.5 * coordinates * (all_three.sum() - count)
            square = 0.5 * max(rest, 0.0) / (1 + (1 + ratio) ** 2 + ratio**2)
            high += more, min(square, more * most_variance)
        high *= min(1.0, TIME_FILTER.most_values / max(high[0], 1.0))
    prior = TIME_FILTER.prior_values * np.array([1.0, high[1] / high[0]])
    joint = low + prior
    r = joint[1] / joint[0]

    share = probability[:, None] * transitions()
    predicted = share.sum(axis=0)
    share = share / predicted
    x, v = (np.einsum("jk,jnc->knc", share, of) for of in (positions, velocities))
    dx, dv = (
        smooth_part(of)[:, None] - smooth_part(mean)[None] for of, mean in ((positions, x), (velocities, v))
    )
    apart = [(a * b).mean(axis=(2, 3)) / r for a, b in ((dx, dx), (dx, dv), (dv, dv))]
    xx, xv, vv = ((share * (covariance[:, i, None] + apart[i])).sum(axis=0) for i in range(3))
    v[0], xv[0], vv[0] = 0.0, 0.0, 0.0
    xx = xx + 2 * step * xv + step**2 * vv + RESTLESSNESS * step**3 / 3
    xv = xv + step * vv + RESTLESSNESS * step**2 / 2
    vv = vv + RESTLESSNESS * step
    x = x + step * v
    innovation = np.where(observed[:, None], points - x, 0.0)
    expected = xx + 1.0
    squares = (smooth_part(innovation) ** 2).sum(axis=(1, 2))
    evidence = np.log(predicted) - 0.5 * values * np.log(expected)
    evidence -= 0.5 * (joint[0] + values) * np.log(joint[1] + squares / expected)
    after = np.maximum(np.exp(evidence - evidence.max()), sys.float_info.min)
    after /= after.sum()
    x = x + (xx / expected)[:, None, None] * innovation
    v = v + (xv / expected)[:, None, None] * innovation
    spread = np.column_stack((xx / expected, xv / expected, vv - xv**2 / expected))
    informed = after / expected**4
    low += informed.sum() * values, (informed * squares / expected).sum()
    low *= min(1.0, TIME_FILTER.most_values / max(low[0], 1.0))
    r = (low[1] + prior[1]) / (low[0] + prior[0])
    estimate = np.einsum("k,knc->nc", after, x)
    off = smooth_part(x) - smooth_part(estimate)
    variance = r * (after * (spread[:, 0] + (off**2).sum(axis=(1, 2)) / (values * r))).sum()
    estimate[~observed] = np.nan
    remembered = np.concatenate((x, v, points[None], last[None]))
    counts = np.array([*low, *high, step])
    return remembered, after, spread, counts, estimate, variance, r, after[0]
