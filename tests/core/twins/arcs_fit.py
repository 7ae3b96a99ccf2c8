"""Slow twins of arcs_dense.c and arcs_fit.c: a chain of so many arcs, fitted by Levenberg and Marquardt."""

import math
from collections import namedtuple

import numpy as np

from tests.core.twins.arcs_equations import normal_equations
from tests.core.twins.arcs_moments import joint_frames
from tssgeom.core.constants import CHANCE, MEDIANS, ROUNDING
from tssgeom.core.constants_arcs import CHAIN_FIT
from tssgeom.core.constants_route import OUTLIERS, PASSES, PRIOR
from tssgeom.route.arcs.chain import criterion, first_joint_column, parameter_count, piece_length, value_count

TwinChain = namedtuple("TwinChain", "start axes joints bend curved stations matrix cost square")


def factor(matrix, damping):
    """Cholesky factor [m, m] of the matrix scaled to unit diagonal plus `damping`, and the units [m]."""
    m = len(matrix)
    lower, unit = np.zeros((m, m)), np.empty(m)
    for a in range(m):
        unit[a] = 1.0 / math.sqrt(max(matrix[a, a], 1e-30))
    for a in range(m):
        for b in range(a + 1):
            rest = matrix[a, b] * unit[a] * unit[b]
            for c in range(b):
                rest -= lower[a, c] * lower[b, c]
            if a == b:
                lower[a, a] = math.sqrt(max(rest + damping, ROUNDING.exact))
            else:
                lower[a, b] = rest / lower[b, b]
    return lower, unit


def solve(lower, unit, right):
    """Solve the factored equations for one right-hand side [m]."""
    m = len(right)
    x = np.empty(m)
    for a in range(m):
        x[a] = right[a] * unit[a]
        for c in range(a):
            x[a] -= lower[a, c] * x[c]
        x[a] /= lower[a, a]
    for a in range(m - 1, -1, -1):
        for c in range(a + 1, m):
            x[a] -= lower[c, a] * x[c]
        x[a] /= lower[a, a]
    for a in range(m):
        x[a] *= unit[a]
    return x


def inverse(lower, unit):
    """Inverse of the factored matrix [m, m]."""
    m = len(lower)
    root = np.zeros((m, m))  # of the inverse: lower^-1
    for b in range(m):
        root[b, b] = 1.0 / lower[b, b]
        for a in range(b + 1, m):
            total = 0.0
            for c in range(b, a):
                total += lower[a, c] * root[c, b]
            root[a, b] = -total / lower[a, a]
    out = np.empty((m, m))
    for a in range(m):
        for b in range(a + 1):
            total = 0.0
            for c in range(a, m):
                total += root[c, a] * root[c, b]
            out[a, b] = total * unit[a] * unit[b]
            out[b, a] = out[a, b]
    return out


def propagated(lower, unit, gradient):
    """Covariance [r, r] of r values of gradient [r, m], by the inverse of the factored matrix [m, m]."""
    r, m = gradient.shape
    half, share = np.empty((r, m)), 1.0 / np.diag(lower)
    for i in range(r):
        for a in range(m):
            value = gradient[i, a] * unit[a]
            for c in range(a):
                value -= lower[a, c] * half[i, c]
            half[i, a] = value * share[a]
    out = np.empty((r, r))
    for i in range(r):
        for j in range(i + 1):
            total = 0.0
            for a in range(m):
                total += half[i, a] * half[j, a]
            out[i, j] = out[j, i] = total
    return out


def saved_by_more(
    lower,
    unit,
    gradient,
    cross,
    own,
    slope,
):
    """Return what d more parameters save of the cost, the m factored ones fitted with them."""
    left, rest = schur_complement(lower, unit, gradient, cross, own, slope)
    step = solve(*factor(left, 1e-12), rest)
    saved = 0.0
    for e in range(len(rest)):
        saved += step[e] * rest[e]
    return saved


def schur_complement(
    lower,
    unit,
    gradient,
    cross,
    own,
    slope,
):
    """Return information [d, d] and gradient [d] of d more parameters, the m factored ones fitted with them.

    Parameters as in `saved_by_more`."""
    m, d = cross.shape
    half, left, rest = np.empty((m, d + 1)), own.copy(), slope.copy()
    for e in range(d + 1):
        for a in range(m):
            value = (cross[a, e] if e < d else gradient[a]) * unit[a]
            for c in range(a):
                value -= lower[a, c] * half[c, e]
            half[a, e] = value / lower[a, a]
    for e in range(d):
        for a in range(m):
            rest[e] -= half[a, e] * half[a, d]
            for f in range(d):
                left[e, f] -= half[a, e] * half[a, f]
        left[e, e] = max(left[e, e], 1e-12 * own[e, e])
    return left, rest


def _from_first_foot(chain):
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


def fit_pieces(data, chain, goal, restart):
    n = value_count(data)
    start, axes, joints, stations = chain.start, chain.axes, chain.joints, chain.stations
    if restart:
        start, axes, joints, stations = _from_first_foot(chain)
    now, gradient = _evaluated_at(data, stations, start, axes, joints, chain.bend, chain)
    damping = CHAIN_FIT.first_damping
    for count in range(CHAIN_FIT.most_steps):
        lower, unit = factor(now.matrix, damping)
        step = solve(lower, unit, gradient)
        enough = CHAIN_FIT.converged * (data.variance if data.variance > 0.0 else now.cost / n)
        promised = 0.0
        for a in range(len(step)):
            promised += step[a] * gradient[a]
        if not promised >= enough or damping * CHAIN_FIT.damping_of_failure > 1.0:
            break
        if count and now.cost - CHAIN_FIT.still_expected * promised > goal:
            break
        start, axes, joints, bend = _stepped(step, now, data.free, data.shortest * data.spacing)
        tried, slope = _evaluated_at(data, now.stations, start, axes, joints, bend, chain)
        if tried.cost < now.cost and turn_is_identifiable(data, tried):
            saved = now.cost - tried.cost
            now, gradient = tried, slope
            if saved < enough and damping <= CHAIN_FIT.damping_of_failure:
                break
            damping = max(CHAIN_FIT.easier * damping, ROUNDING.exact)
        else:
            damping = max(CHAIN_FIT.harder * damping, CHAIN_FIT.damping_of_failure)
    return now


def evaluated(data, chain):
    """Return a chain with its equations, and the gradient."""
    return _evaluated_at(data, chain.stations, chain.start, chain.axes, chain.joints, chain.bend, chain)


def improved(data, candidate, least):
    """Return the candidate, fitted, if its criterion is below `least` and there is a point on every piece."""
    n, m = value_count(data), parameter_count(candidate.curved, data.free)
    rest = least - m * math.log(n)
    goal = n * math.exp(min(rest / n - 1.0, 700.0))
    if data.variance > 0.0:
        goal = (rest - n * math.log(data.variance)) * data.variance
    tried = fit_pieces(data, candidate, goal, False)
    piece = np.searchsorted(tried.joints[1:], tried.stations[data.weight > 0.0], side="right")
    without_point = set(range(len(tried.joints))) - set(piece.tolist())
    is_observed = all(piece_length(tried, j) < data.spacing for j in without_point)
    return (
        fit_pieces(data, tried, math.inf, False) if criterion(data, tried) < least and is_observed else None
    )


def equations_with_pieces(data, chain, joints, bend, curved):
    """Return matrix and gradient of the normal equations of other pieces on the curve of a chain."""
    other = TwinChain(
        chain.start, chain.axes, joints, bend, curved, chain.stations, chain.matrix, chain.cost, chain.square
    )
    matrix, gradient, _, _ = normal_equations(data, other, 0.0)
    return matrix, gradient


def turn_is_identifiable(data, chain):
    """Whether the chain turns so little from one point to the next that the points can determine it."""
    s, joints, bend = chain.stations, chain.joints, chain.bend
    j, before, here = 0, -1, s[0]
    for i in range(len(s)):
        if data.weight[i] <= 0.0:
            continue
        turned, j = _turned_to(s[i], here, j, joints, bend)
        wide = before >= 0 and s[i] - s[before] > CHAIN_FIT.wide * data.spacing
        if before >= 0 and not turned < (2.0 * CHAIN_FIT.most_turn if wide else CHAIN_FIT.most_turn):
            return False
        before, here = i, s[i]
    turned, _ = _turned_to(max(s[-1], joints[-1]), here, j, joints, bend)  # the end, where no point counts
    return turned < 2.0 * CHAIN_FIT.most_turn


def _turned_to(there, here, j, joints, bend):
    """Return the angle by which a chain turns from `here`, on piece j, to `there` [rad], and that piece."""
    turned = 0.0
    while j + 1 < len(joints) and joints[j + 1] <= there:
        turned += max(joints[j + 1] - here, 0.0) * math.sqrt(bend[j, 0] ** 2 + bend[j, 1] ** 2)
        here, j = max(joints[j + 1], here), j + 1
    return turned + max(there - here, 0.0) * math.sqrt(bend[j, 0] ** 2 + bend[j, 1] ** 2), j


def _evaluated_at(
    data,
    stations,
    start,
    axes,
    joints,
    bend,
    chain,
):
    """Return the chain with its equations, unknown stations put at the feet of the points, and the gradient.

    What is not given is that of `chain`."""
    s = stations.copy()
    at = TwinChain(start, axes, joints, bend, chain.curved, s, chain.matrix, chain.cost, chain.square)
    matrix, gradient, cost, square = normal_equations(data, at, CHAIN_FIT.reach * data.spacing)
    return TwinChain(start, axes, joints, bend, chain.curved, s, matrix, cost, square), gradient


def _stepped(step, chain, free, shortest):
    """Apply a parameter step, joints kept in order and at least `shortest` [m] apart.

    Where joints move, the turn of a piece follows its step, not the curvature: that of a short piece would
    need many steps along a bent valley."""
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


def _turned(step, start, axes, free):
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


def outlier_weights(data, square, last):
    """Return whether weights change, and weights by the distance across the chain."""
    known = data.variance or last
    limit = outlier_limit(len(square), residual_variance(known, 0.0, data.spacing))
    if np.all(square <= limit) and np.all(data.weight > 0.0):
        return False, data.weight
    if not data.variance:
        robust = float(np.median(square)) / (MEDIANS.square_2 if data.free else MEDIANS.square_3)
        limit = outlier_limit(len(square), residual_variance(known, robust, data.spacing))
    weight = np.where(square > limit, 0.0, 1.0)
    few = np.count_nonzero(weight == 0.0) <= OUTLIERS.share * len(weight)
    return (True, weight) if few and not np.array_equal(weight, data.weight) else (False, data.weight)


def outlier_limit(count, variance):
    """Return the square beyond which a residual of this variance, one of `count`, is an outlier."""
    return (CHANCE.rare**2 + 2.0 * math.log(count)) * variance


def residual_variance(known, robust, spacing):
    """Return the variance by which residuals are judged: the greatest of three."""
    return max(robust, known, (PRIOR.rounding * spacing) ** 2)


def unfit(data, chain, variance):
    """Whether the points are off the chain by more than noise, of a variance as in the last frame [m²]."""
    if not turn_is_identifiable(data, chain):
        return True
    freedom = max(value_count(data) - len(chain.matrix), 1)
    most = 1.0 + CHANCE.never * math.sqrt(2.0 / freedom)
    if data.variance > 0.0:
        return not chain.cost < most * data.variance * freedom
    usual = max(variance, (ROUNDING.relative * data.spacing) ** 2) * freedom
    least = (PRIOR.rounding * data.spacing) ** 2 * freedom
    quieter = CHANCE.never**2 * max(chain.cost, least) < usual  # the last frame is no measure
    return quieter or not chain.cost < max(PASSES.warm_noise, 1.5 * most) * usual
