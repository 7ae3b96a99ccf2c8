"""Slow twins: corner lists, where bars lie on a route, and whether a route has moved."""

import math

import numpy as np

from tssgeom.core.constants import CHANCE, ROUNDING
from tssgeom.core.constants_tendon import PROFILE

_SHARES = 8


def exponential(exponents):
    """Return e to each power as C does: numpy's own loop differs in the last digit on some processors."""
    return np.array([math.exp(one) for one in exponents])


def _front(angle, log_tension, drive, friction, direction_index):
    """Return how many corners the front wipes out, and the angle φ* where it meets the old profile."""
    before = direction_index * (drive - log_tension[0])  # excess of the front over the old profile [1]
    for k in range(1, angle.size):
        here = direction_index * (drive - log_tension[k]) - friction * angle[k]
        if here <= -ROUNDING.exact:
            return k, angle[k - 1] + (angle[k] - angle[k - 1]) * before / (before - here)  # docs/model.md (4)
        before = max(here, 0.0)
    return angle.size, angle[-1] + before / friction  # docs/model.md (4)


def stepped(angle, log_tension, drive, friction):
    """Return the corners [2, c] of max(u, ln T − μφ) on a pull, min(u, ln T + μφ) on a release, and which.

    A drive that does not move gives the index 0, and corners that are none.
    """
    change = drive - log_tension[0]
    if abs(change) <= ROUNDING.exact:
        return np.empty((2, 0)), 0
    direction_index = 1 if change > 0.0 else -1
    wiped, meeting = _front(angle, log_tension, drive, friction, direction_index)
    corners = np.empty((2, 2 + angle.size - wiped))
    corners[0, 0], corners[1, 0] = 0.0, drive
    corners[0, 1], corners[1, 1] = meeting, drive - direction_index * friction * meeting  # docs/model.md (3)
    for k in range(wiped, angle.size):
        corners[0, 2 + k - wiped], corners[1, 2 + k - wiped] = angle[k], log_tension[k]
    if wiped == angle.size:
        corners[1, 1] = log_tension[-1]  # the constant rest keeps its tension to the last digit
    return corners, direction_index


def on_pieces(
    angle,
    log_tension,
    pieces,
    elastic,
    way,
):
    """Return what corners [c], [c] mean on a route.

    Parameters
    ----------
    angle, log_tension
        The corners of the profile [rad], [ln N].
    pieces
        Lengths [k] [m], angles [k] [rad] and the covariance of both [2k, 2k].
    elastic
        Compliance [1/N], pretension [N] and coefficient of friction [1].
    way
        Direction index ζ.

    Returns
    -------
    tuple
        Distal tension and its standard error [N], elongation and its standard error [m], width of the dead
        zone [N], curve angle of the slip front [rad].
    """
    compliance, pretension, friction = elastic
    means, log_tension_out, slope_out = means_on_pieces(pieces[1], angle, log_tension)
    tension_out = math.exp(log_tension_out)  # docs/model.md (5)
    elongation, variance, reach, angle_variance = _elongated(
        means, pieces[0], pieces[1], pieces[2], compliance, pretension
    )
    tension_out_se = tension_out * abs(slope_out) * math.sqrt(angle_variance)  # docs/model.md (14)
    width = _dead_zone_width(log_tension[0], log_tension_out, way, friction * reach)
    front = min(_slip_front(angle, log_tension, way * friction), reach)
    return tension_out, tension_out_se, elongation, math.sqrt(variance), width, front


def _gradient(means, length, compliance, pretension):
    """Differentiate the elongation with respect to each length, then each angle, [2k]."""
    k, later = len(length), 0.0  # what the later pieces gain for an angle added anywhere before them
    gradient = np.empty(2 * k)
    for i in range(k - 1, -1, -1):
        gradient[i] = compliance * (means[0, i] - pretension)  # docs/model.md (10)
        gradient[k + i] = compliance * (length[i] * means[2, i] + later)  # docs/model.md (11)
        later += length[i] * means[1, i]
    return gradient


def _elongated(means, length, angle, covariance, compliance, pretension):
    """Elongation and its variance, angle of the whole route and its variance; docs/model.md (9), (13)."""
    k = len(length)
    gradient = _gradient(means, length, compliance, pretension)
    elongation, variance, turned, angle_variance = 0.0, 0.0, 0.0, 0.0
    for i in range(k):
        elongation += compliance * length[i] * (means[0, i] - pretension)
        turned += angle[i]
        for j in range(k):
            angle_variance += covariance[k + i, k + j]
    for i in range(2 * k):
        for j in range(2 * k):
            variance += gradient[i] * covariance[i, j] * gradient[j]
    return elongation, max(variance, 0.0), turned, max(angle_variance, 0.0)


def _dead_zone_width(log_tension_in, log_tension_out, way, reach):
    """Return how far the proximal tension is from moving the distal end [N]; `reach` is μΦ."""
    needed = log_tension_out + way * reach  # docs/model.md (6)
    if way * (needed - log_tension_in) <= ROUNDING.exact:
        return 0.0
    return abs(_exp(needed) - _exp(log_tension_in))


def _slip_front(angle, log_tension, slope):
    """Return where the run that starts at the proximal end with the slope of sliding ends [rad]."""
    if len(angle) == 1:
        return math.inf
    slides = abs(log_tension[0] - log_tension[1] - slope * angle[1]) <= PROFILE.slides
    return angle[1] if slides else 0.0  # docs/model.md (4)


def _exp(exponent):
    return math.exp(min(exponent, PROFILE.most_log_tension))


def mean_decay(x):
    """Mean of exp(−xτ) over 0 ≤ τ ≤ 1 [1]."""
    return 1.0 if x == 0.0 else -math.expm1(-x) / x  # docs/model.md (8)


def mean_decay_moment(x):
    """Mean of τ·exp(−xτ) over 0 ≤ τ ≤ 1 [1]."""
    if abs(x) < 0.01:
        return 1 / 2 - x * (1 / 3 - x * (1 / 8 - x * (1 / 30 - x * (1 / 144 - x / 840))))
    return (mean_decay(x) - math.exp(-x)) / x  # docs/model.md (12)


def _slope(angle, log_tension, segment):
    """Slope of ln T over φ behind corner number `segment` [1/rad]."""
    if segment + 1 == angle.size:
        return 0.0
    return (log_tension[segment + 1] - log_tension[segment]) / (angle[segment + 1] - angle[segment])


def _run(log_tension_at_start, slope, span, before, share):
    """Return what one run adds to the means over its piece: of T, of dT/dφ, and of t·dT/dφ.

    `span` is the angle of the run [rad]; t goes from 0 to 1 along the piece, and the run lies between
    `before` and `before + share`.
    """
    x = abs(slope) * span  # from the end where the tension is greater: it may start from none
    greatest = share * math.exp(log_tension_at_start + max(slope * span, 0.0))
    level = greatest * mean_decay(x)  # docs/model.md (9)
    moment = greatest * mean_decay_moment(x)
    if slope > 0.0:
        moment = level - moment
    return level, slope * level, slope * (before * level + share * moment)  # docs/model.md (9), (12)


def means_on_pieces(piece_angle, angle, log_tension):
    """Return the tension on each piece and at the distal end.

    Parameters
    ----------
    piece_angle
        [k] Accumulated curve angle of each piece [rad].
    angle, log_tension
        [c] Corners of the tension profile [rad], [ln N].

    Returns
    -------
    means
        [3, k] Means over the arc length of each piece: of T [N]; of dT/dφ, which is the derivative of the
        first with respect to the angle of any earlier piece [N/rad]; of t·dT/dφ with t from 0 to 1 along the
        piece, which is its derivative with respect to the piece's own angle [N/rad].
    log_tension_out, slope_out
        ln T at the distal end [ln N], and its derivative with respect to the angle of any piece [1/rad].
    """
    means = np.zeros((3, piece_angle.size))
    segment, at = 0, 0.0
    log_tension_here, slope = log_tension[0], 0.0
    for piece in range(piece_angle.size):
        start, end = at, at + piece_angle[piece]
        while True:
            while segment + 1 < angle.size and angle[segment + 1] <= at:
                segment += 1
            stop = end if segment + 1 == angle.size else min(end, angle[segment + 1])
            before, share = 0.0, 1.0
            if end > start:
                before, share = (at - start) / (end - start), (stop - at) / (end - start)
            slope = _slope(angle, log_tension, segment)
            log_tension_here = log_tension[segment] + slope * (at - angle[segment])
            level, drop, turn = _run(log_tension_here, slope, stop - at, before, share)
            means[0, piece] += level
            means[1, piece] += drop
            means[2, piece] += turn
            log_tension_here += slope * (stop - at)
            at = stop
            if not at < end:
                break
    return means, log_tension_here, slope


def _corners(phi, log_tension):
    """Return which points are needed: of points at one angle the last, of points on one line its ends."""
    keep = np.zeros(phi.size, dtype=np.bool_)
    keep[0] = True
    last = 0
    for i in range(1, phi.size - 1):
        if phi[i + 1] - phi[i] <= ROUNDING.exact * phi[-1] or phi[i] <= phi[last]:
            continue
        here = (log_tension[i] - log_tension[last]) / (phi[i] - phi[last])
        bend = (log_tension[i + 1] - log_tension[i]) / (phi[i + 1] - phi[i]) - here
        if abs(bend) * (phi[i + 1] - phi[last]) > 1e3 * ROUNDING.exact:
            keep[i] = True
            last = i
    keep[-1] = phi[-1] > phi[last]
    return keep


def through_bars(edge, held, piece_length, piece_angle, turned):
    """Return φ and ln T of the corners through bars on a route that turns by `turned` [rad], [ln N]."""
    _, mean_angle, _, _ = discretised(edge, piece_length, piece_angle)
    end = turned * (
        1.0 + 0.1 * ROUNDING.exact
    )  # rounding shall not leave the distal end beyond the last corner
    return _profile(mean_angle, end, held)


def _profile(mean_angle, end, tension):
    """Return φ and ln T of the corners through the means of the bars and both ends, as few as are needed."""
    phi, log_tension = np.empty(tension.size), np.empty(tension.size)
    phi[0], phi[1:-1], phi[-1] = 0.0, mean_angle, end
    for i in range(tension.size):
        log_tension[i] = np.log(tension[i]) if tension[i] > 0.0 else PROFILE.slack
    keep = _corners(phi, log_tension)
    return phi[keep], log_tension[keep]


def bent(length, angle, bends):
    """Return lengths and angles of the pieces with hidden bends added; docs/model.md (60).

    `bends` [m, 3] holds the middle [m], the angle [rad] and the width [m] of each.
    """
    for i in range(bends.shape[0]):
        middle, extra, width = bends[i]
        end = np.concatenate((np.zeros(1), np.cumsum(length)))
        whole = end[-1]
        start = min(max(middle - 0.5 * width, 0.0), whole)
        stop = min(max(middle + 0.5 * width, 0.0), whole)
        if stop - start < 1e-9 * whole:
            start, stop = max(start - width, 0.0), min(stop + width, whole)
        knots = np.unique(np.concatenate((np.array([start, stop]), end)))
        phi = np.interp(knots, end, np.concatenate((np.zeros(1), np.cumsum(angle))))
        for k in range(knots.size):
            phi[k] += extra * min(max((knots[k] - start) / (stop - start), 0.0), 1.0)
        length, angle = np.diff(knots), np.diff(phi)
    return length, angle


def discretised(edge, piece_length, piece_angle):
    """Return length and mean φ of each bar, angle and span of each contact; docs/model.md (41)."""
    n = edge.size - 1
    length, mean_angle = np.empty(n), np.empty(n)
    angle, span = np.empty(n + 1), np.empty(n + 1)
    whole = np.sum(piece_length)
    piece, begin, phi = 0, 0.0, 0.0  # the piece, where it begins, and φ there
    s, phi_before, middle_before = 0.0, 0.0, 0.0
    phi_here = 0.0
    for k in range(n):
        start, end = s, edge[k + 1] * whole
        if k == n - 1:
            end = whole
        moment = 0.0
        while True:
            stop = begin + piece_length[piece]
            if piece == piece_length.size - 1 or stop > end:
                stop = end
            phi_stop = phi + piece_angle[piece] * (stop - begin) / piece_length[piece]
            moment += 0.5 * (phi_here + phi_stop) * (stop - s)
            s, phi_here = stop, phi_stop
            if s >= end:
                break
            begin += piece_length[piece]
            phi += piece_angle[piece]
            piece += 1
        length[k] = end - start
        mean_angle[k] = moment / length[k]
        angle[k] = max(mean_angle[k] - phi_before, 0.0)
        span[k] = 0.5 * (start + end) - middle_before
        phi_before, middle_before = mean_angle[k], 0.5 * (start + end)
    angle[n] = max(phi_here - phi_before, 0.0)
    span[n] = whole - middle_before
    return length, mean_angle, angle, span


def _angle_at(share, length, angle, covariance, gradient):
    """Return φ at a share of the length and its variance; `gradient` is room for 2k numbers."""
    k, whole = length.size, np.sum(length)
    piece, begin, phi = 0, 0.0, 0.0
    gradient[:] = 0.0
    while piece < k - 1 and begin + length[piece] < share * whole:
        gradient[k + piece] = 1.0
        begin, phi, piece = begin + length[piece], phi + angle[piece], piece + 1
    inside = min((share * whole - begin) / length[piece], 1.0)
    kappa = angle[piece] / length[piece]
    gradient[k + piece] = inside
    for i in range(k):
        gradient[i] = kappa * share
        if i < piece:
            gradient[i] -= kappa
    gradient[piece] -= kappa * inside
    variance = 0.0
    for i in range(2 * k):
        for j in range(2 * k):
            variance += gradient[i] * covariance[i, j] * gradient[j]
    return phi + inside * angle[piece], variance


def is_unmoved(length, angle, covariance, length_now, angle_now, covariance_now):
    k, m = length.size, length_now.size
    change = np.sum(length_now) - np.sum(length)
    variance = np.sum(covariance[:k, :k]) + np.sum(covariance_now[:m, :m])
    if abs(change) > CHANCE.clear * np.sqrt(max(variance, 0.0)) + ROUNDING.relative * np.sum(length):
        return False
    room, room_now = np.empty(2 * k), np.empty(2 * m)
    for step in range(_SHARES, 0, -1):
        share = step / _SHARES
        phi, spread = _angle_at(share, length, angle, covariance, room)
        phi_now, spread_now = _angle_at(share, length_now, angle_now, covariance_now, room_now)
        if abs(phi_now - phi) > CHANCE.clear * np.sqrt(max(spread + spread_now, 0.0)) + ROUNDING.relative:
            return False
    return True
