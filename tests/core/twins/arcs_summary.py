"""Slow twins of arcs_summary.c: pieces of a fitted chain with their errors, and what other pieces promise."""

import math

import numpy as np

from tests.core.twins.arcs_equations import slide_of_end
from tests.core.twins.arcs_fit import (
    equations_with_pieces,
    factor,
    inverse,
    propagated,
    saved_by_more,
    schur_complement,
)
from tssgeom.core.constants import CHANCE, ROUNDING
from tssgeom.core.constants_arcs import CHAIN_MOVES, CHAIN_PARAMETERS, IDENTIFIABLE
from tssgeom.route.arcs.chain import first_joint_column, noise_variance, piece_length, value_count
from tssgeom.statistics import information_price

_STRAIGHTENED, _MERGED, _DROPPED = 0, 1, 2


def residual_mean_square(data, chain):
    """Noise variance of a coordinate, or the mean square of the residuals where beyond chance [m²]."""
    variance, freedom = noise_variance(data, chain), max(value_count(data) - len(chain.matrix), 1)
    left = chain.cost / freedom
    return left if left / variance - 1.0 > CHANCE.never * math.sqrt(2.0 / freedom) else variance


def pieces(data, chain):
    """Lengths and angles [2k] of the pieces, their covariance [2k, 2k], noise [m], and hidden bends [k]."""
    k, m = len(chain.bend), len(chain.matrix)
    variance = residual_mean_square(data, chain)
    column, joint = curvature_columns(chain.curved, data.free), first_joint_column(data.free) - 1
    sizes, gradient = np.empty(2 * k), np.zeros((2 * k, m))
    for j in range(k):
        k0, k1 = chain.bend[j, 0], chain.bend[j, 1]
        kappa = math.sqrt(k0 * k0 + k1 * k1)
        begin = chain.joints[j] if j > 0 else chain.stations[0]
        length = (chain.joints[j + 1] if j + 1 < k else chain.stations[-1]) - begin
        sizes[j], sizes[k + j] = length, kappa * length
        if column[j] >= 0 and kappa > 0.0:
            gradient[k + j, column[j]] = length * k0 / kappa
            gradient[k + j, column[j] + 1] = length * k1 / kappa
        if j > 0:
            gradient[j, joint + j], gradient[k + j, joint + j] = -1.0, -kappa
        if j + 1 < k:
            gradient[j, joint + j + 1], gradient[k + j, joint + j + 1] = 1.0, kappa
        if j == k - 1 and data.free:
            slide = slide_of_end(chain)
            for a in range(m):
                gradient[j, a] += slide[a]
                gradient[k + j, a] += kappa * slide[a]
    lower, unit = factor(chain.matrix, ROUNDING.exact)
    covariance = propagated(lower, unit, gradient)
    for a in range(2 * k):
        for b in range(2 * k):
            covariance[a, b] *= variance
    hidden = hidden_bends(data, chain)
    for j in range(k):
        covariance[k + j, k + j] += hidden[j] * sizes[j] ** 2
    if data.free:  # an unknown station of an end takes its angle along
        for j in (0, k - 1):
            kappa = math.sqrt(chain.bend[j, 0] ** 2 + chain.bend[j, 1] ** 2)
            covariance[j, j] += variance
            covariance[j, k + j] += variance * kappa
            covariance[k + j, j] += variance * kappa
            covariance[k + j, k + j] += variance * kappa * kappa
    return sizes, covariance, math.sqrt(variance), hidden


def hidden_bends(data, chain):
    """Mean square of the curvature that each straight piece may have [k] [1/m²], 0 for a curved one; (124).

    A piece is straight where the criterion prefers it without curvature. It may be curved all the same, with
    the odds that the criterion gives, and then as in the best fit."""
    k, hidden = len(chain.bend), np.zeros(len(chain.bend))
    if np.all(chain.curved):
        return hidden
    matrix, gradient = equations_with_pieces(data, chain, chain.joints, chain.bend, np.ones(k, np.bool_))
    first = first_joint_column(data.free) + k - 1
    fitted = np.ones(len(matrix), np.bool_)
    for j in range(k):
        fitted[first + 2 * j] = fitted[first + 2 * j + 1] = chain.curved[j]
    lower, unit = factor(chain.matrix, ROUNDING.exact)
    variance, price = noise_variance(data, chain), information_price(2.0, value_count(data))
    for j in range(k):
        if chain.curved[j]:
            continue
        own = slice(first + 2 * j, first + 2 * j + 2)
        cross = matrix[fitted][:, own]
        left, rest = schur_complement(lower, unit, gradient[fitted], cross, matrix[own, own], gradient[own])
        spread = inverse(*factor(left, ROUNDING.exact))
        bend = spread @ rest
        odds = math.exp(min(0.5 * (bend @ rest / variance - price), 700.0))
        share = odds / (1.0 + odds) if k > 1 else 1.0
        hidden[j] = share * (bend @ bend + variance * np.trace(spread))
    return hidden


def profile(data, chain, at):
    """Curvature, its standard error, angle and its standard error at arc lengths `at` [4, n]; (33)."""
    k, m = len(chain.bend), len(chain.matrix)
    ends = np.concatenate((chain.stations[:1], chain.joints[1:], chain.stations[-1:]))
    covariance = residual_mean_square(data, chain) * inverse(*factor(chain.matrix, ROUNDING.exact))
    at_ends = residual_mean_square(data, chain) if data.free else 0.0
    kappa = np.sqrt(np.sum(chain.bend**2, axis=1))
    column, joint = curvature_columns(chain.curved, data.free), first_joint_column(data.free) - 1
    gradient, out = np.zeros(m), np.empty((4, len(at)))  # of φ where a piece begins
    _, of_pieces, _, hidden = pieces(data, chain)
    turned, before, i = 0.0, 0.0, 0
    for j in range(k):
        own = np.zeros(m)  # of φ along the piece
        if column[j] >= 0 and kappa[j] > 0.0:
            own[column[j] : column[j] + 2] = chain.bend[j] / kappa[j]
        if j > 0:
            gradient[joint + j] = kappa[j - 1] - kappa[j]
        length = ends[j + 1] - ends[j]
        level, tilt, square = (
            gradient @ covariance @ gradient,
            gradient @ covariance @ own,
            own @ covariance @ own,
        )
        while i < len(at) and (j == k - 1 or at[i] < ends[j + 1]):
            t = at[i] - ends[j]
            spread = level + 2 * t * tilt + t * t * (square + hidden[j]) + before
            spread += at_ends * (kappa[0] ** 2 + kappa[j] ** 2)
            out[0, i], out[1, i] = kappa[j], math.sqrt(max(square + hidden[j], 0.0))
            out[2, i], out[3, i] = turned + kappa[j] * t, math.sqrt(max(spread, 0.0)) if i > 0 else 0.0
            i += 1
        gradient += length * own
        turned += kappa[j] * length
        before += hidden[j] * length * length
    out[3, -1] = math.sqrt(max(np.sum(of_pieces[k:, k:]), 0.0))
    return out


def parameter_covariance(data, chain):
    """Covariance [m, m] of the parameters, in the order of `Chain`."""
    return noise_variance(data, chain) * inverse(*factor(chain.matrix, ROUNDING.exact))


def curvature_columns(curved, free):
    """First parameter of each piece's curvature [k], -1 for a straight piece."""
    column, following = np.full(len(curved), -1), first_joint_column(free) + len(curved) - 1
    for j in range(len(curved)):
        if curved[j]:
            column[j] = following
            following += 2
    return column


def unidentifiable(length, covariance, spacing):
    """Return the piece whose bend is known least, if its points do not determine it, or -1.

    Such a piece may lie beyond the last joint that points surround."""
    k, worst, error = len(length), -1, IDENTIFIABLE.largest_se_short
    for j in range(k):
        variance = covariance[k + j, k + j]
        short = length[j] < IDENTIFIABLE.few_points * spacing
        least = error if short else max(error, CHAIN_PARAMETERS.half_turn)
        if not math.sqrt(max(variance, 0.0)) < least:
            worst, error = j, math.sqrt(max(variance, 0.0))
    return worst if k > 1 else -1


def saved_by_slopes(data, chain):
    """Return what sloping curvature in every piece would save beyond chance, in noise variances.

    The steps of a staircase that stands for a smooth route fit better with a slope; those of true pieces do
    not."""
    lower, unit = factor(chain.matrix, ROUNDING.exact)
    gradient, cross, own, slope = _parts(data, chain)
    m, n = len(gradient), 2 * len(chain.bend)
    ramp_cross, ramp_own, ramp_slope = np.zeros((m, n)), np.zeros((n, n)), np.zeros(n)
    for e in range(n):
        j, c = e // 2, e % 2
        for i in range(CHAIN_MOVES.parts):
            way = i - 0.5 * (CHAIN_MOVES.parts - 1)
            ramp_slope[e] += way * slope[j, i, c]
            for a in range(m):
                ramp_cross[a, e] += way * cross[a, j, i, c]
            for f in range(n):
                for h in range(CHAIN_MOVES.parts):
                    ramp_own[e, f] += (
                        way * (h - 0.5 * (CHAIN_MOVES.parts - 1)) * own[j, i, c, f // 2, h, f % 2]
                    )
    saved = saved_by_more(lower, unit, gradient, ramp_cross, ramp_own, ramp_slope)
    return saved / noise_variance(data, chain) - n


def simplifications(data, chain):
    """List what could be left out: expected change of the criterion, kind and piece."""
    covariance = parameter_covariance(data, chain)
    column, price = curvature_columns(chain.curved, data.free), information_price(1.0, value_count(data))
    k = len(column)
    promise, kind, piece = np.empty(3 * k), np.empty(3 * k, np.int64), np.empty(3 * k, np.int64)
    count = 0
    for j in range(k):
        if column[j] >= 0:
            promise[count] = _wald_statistic(chain.bend[j], covariance, column[j], -1) - 2 * price
            kind[count], piece[count] = _STRAIGHTENED, j
            count += 1
        if j > 0:
            step = chain.bend[j] - chain.bend[j - 1]
            promise[count] = _wald_statistic(step, covariance, column[j], column[j - 1]) - 3 * price
            kind[count], piece[count] = _MERGED, j
            count += 1
        if k > 1 and piece_length(chain, j) < CHAIN_MOVES.dropped_below * data.spacing:
            promise[count], kind[count], piece[count] = -price, _DROPPED, j
            count += 1
    return promise[:count], kind[:count], piece[:count]


def _wald_statistic(step, covariance, plus, minus):
    """Squared size of a step [2] in its standard errors: the parameters at `plus` less those at `minus`."""
    own = np.zeros((2, 2))
    for a in range(2):
        for b in range(2):
            if plus >= 0:
                own[a, b] += covariance[plus + a, plus + b]
            if minus >= 0:
                own[a, b] += covariance[minus + a, minus + b]
            if plus >= 0 and minus >= 0:
                own[a, b] -= covariance[plus + a, minus + b] + covariance[minus + a, plus + b]
    determinant = own[0, 0] * own[1, 1] - own[0, 1] * own[1, 0]
    if determinant <= 1e-12 * own[0, 0] * own[1, 1]:
        return np.sum(step * step) / max(own[0, 0], own[1, 1]) if own[0, 0] + own[1, 1] > 0.0 else 0.0
    squares = own[1, 1] * step[0] ** 2 - 2 * own[0, 1] * step[0] * step[1] + own[0, 0] * step[1] ** 2
    return squares / determinant


def _parts(data, chain):
    """Cut every piece into equal parts with curvatures of their own: the normal equations of these."""
    k, n = len(chain.bend), CHAIN_MOVES.parts * len(chain.bend)
    at, bend, curved = np.empty(n), np.empty((n, 2)), np.ones(n, np.bool_)
    for j in range(k):
        length = piece_length(chain, j)
        for i in range(CHAIN_MOVES.parts):
            at[CHAIN_MOVES.parts * j + i] = chain.joints[j] + length * i / CHAIN_MOVES.parts
            bend[CHAIN_MOVES.parts * j + i, 0], bend[CHAIN_MOVES.parts * j + i, 1] = (
                chain.bend[j, 0],
                chain.bend[j, 1],
            )
    matrix, gradient = equations_with_pieces(data, chain, at, bend, curved)
    base = first_joint_column(data.free)
    first = base + n - 1
    m = base + k - 1
    cross, mine = np.zeros((m + 2 * chain.curved.sum(), 2 * n)), np.zeros(m + 2 * chain.curved.sum())
    # the joints inside a piece have no effect, the curvature being the same; a piece's is that of its parts
    for row in range(m):
        source = row if row < base else base + CHAIN_MOVES.parts * (row - base + 1) - 1
        mine[row] = gradient[source]
        cross[row] = matrix[source, first:]
    for j in range(k):
        if chain.curved[j]:
            for i in range(CHAIN_MOVES.parts):
                for c in range(2):
                    part = first + 2 * (CHAIN_MOVES.parts * j + i) + c
                    mine[m + c] += gradient[part]
                    cross[m + c] += matrix[part, first:]
            m += 2
    own = matrix[first:, first:].reshape((k, CHAIN_MOVES.parts, 2, k, CHAIN_MOVES.parts, 2))
    slope = gradient[first:].reshape((k, CHAIN_MOVES.parts, 2))
    return mine, cross.reshape((len(mine), k, CHAIN_MOVES.parts, 2)), own, slope


def saved_by_joints(data, chain):
    """Return what a joint at each quarter of each piece [k, parts] would save, in noise variances."""
    long = np.empty(len(chain.joints), np.bool_)
    for j in range(len(long)):
        long[j] = piece_length(chain, j) >= CHAIN_MOVES.parts * data.spacing
    lower, unit = factor(chain.matrix, ROUNDING.exact)
    gradient, cross, own, slope = _parts(data, chain)
    saved = _saved(lower, unit, gradient, cross, own, slope, chain.curved, long)
    return saved / noise_variance(data, chain)


def _saved(
    lower,
    unit,
    gradient,
    cross,
    own,
    slope,
    curved,
    long,
):
    """Return what a joint at each quarter of the long pieces [k, parts] would save of the cost [m²]."""
    m, k = cross.shape[:2]
    saved = np.zeros((k, CHAIN_MOVES.parts))
    for j in range(k):
        # the level of a curved piece is a parameter already: one side of the joint is enough
        d = 2 if curved[j] else 4
        for cut in range(1, CHAIN_MOVES.parts if long[j] else 1):
            side_cross, side_own, side_slope = np.zeros((m, d)), np.zeros((d, d)), np.zeros(d)
            parts = cut if curved[j] else CHAIN_MOVES.parts
            for i in range(parts):
                here = 2 if i >= cut else 0
                for c in range(2):
                    side_slope[here + c] += slope[j, i, c]
                    for a in range(m):
                        side_cross[a, here + c] += cross[a, j, i, c]
                    for other in range(parts):
                        there = 2 if other >= cut else 0
                        for e in range(2):
                            side_own[here + c, there + e] += own[j, i, c, j, other, e]
            saved[j, cut] = saved_by_more(lower, unit, gradient, side_cross, side_own, side_slope)
    return saved
