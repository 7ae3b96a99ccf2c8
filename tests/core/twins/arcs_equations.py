"""Slow twins of arcs_equations.c: the normal equations of fitting a chain of arcs to points."""

import numpy as np

from tests.core.twins.arcs_moments import (
    along,
    arc_functions,
    fill_local,
    joint_frames,
    moments_across,
    moments_known,
    piece_of,
)


def position_by_curvature(k0, k1, h, out):
    """Differentiate the position at arc length h with respect to both curvature components, [2, 3]."""
    _, b, _, da, db = arc_functions((k0 * k0 + k1 * k1) * h * h)
    _fill_slope(b, da, db, k0, k1, h, out)


def _fill_slope(b, da, db, k0, k1, h, out):
    h2 = h * h
    for c in range(2):
        k = k0 if c == 0 else k1
        turned = 2 * h2 * h2 * db * k
        out[c, 0] = 2 * h2 * h * da * k
        out[c, 1] = turned * k0
        out[c, 2] = turned * k1
        out[c, 1 + c] += h2 * b


def _twist_of_turn(theta, centre, out):
    """Twist of a turn θ about a centre: a = -θ × centre."""
    out[0] = -(theta[1] * centre[2] - theta[2] * centre[1])
    out[1] = -(theta[2] * centre[0] - theta[0] * centre[2])
    out[2] = -(theta[0] * centre[1] - theta[1] * centre[0])
    out[3], out[4], out[5] = theta[0], theta[1], theta[2]


def _turn_by_curvature(k0, k1, h, out):
    """Turn of the axes at arc length h by both curvature components, in the axes at its start [2, 3]."""
    q = (k0 * k0 + k1 * k1) * h * h
    _, b, c3, _, _ = arc_functions(q)
    a = 1.0 - q * c3
    w1, w2 = -k1 * h, k0 * h  # rotation vector on (t, e1, e2): (0, w1, w2)
    for c in range(2):
        v1, v2 = (0.0, h) if c == 0 else (-h, 0.0)
        dot = w1 * v1 + w2 * v2
        out[c, 0] = b * (w1 * v2 - w2 * v1)
        out[c, 1], out[c, 2] = a * v1 + c3 * dot * w1, a * v2 + c3 * dot * w2


def twists(chain, position, frame, free):
    """Twist [m, 6] of every parameter, the first piece it moves [m], and the piece it bends [m] (or -1).

    Position [k, 3] and frame [k, 3, 3] are those where each piece begins; `free` where stations are unknown.
    The parameters and their order are those of `Chain`."""
    joints, bend, curved = chain.joints, chain.bend, chain.curved
    k = len(bend)
    shifts = 2 if free else 3
    m = shifts + 2 + (k - 1) + 2 * int(curved.sum())
    twist = np.zeros((m, 6))
    first, own = np.zeros(m, dtype=np.int64), np.full(m, -1)
    for c in range(shifts):
        if free:
            twist[c, 0], twist[c, 1], twist[c, 2] = frame[0, 1 + c, 0], frame[0, 1 + c, 1], frame[0, 1 + c, 2]
        else:
            twist[c, c] = 1.0
    for c in range(2):
        _twist_of_turn(frame[0, 1 + c].copy(), position[0], twist[shifts + c])
    row = shifts + 2
    theta = np.empty(3)
    for j in range(1, k):
        d0, d1 = bend[j - 1, 0] - bend[j, 0], bend[j - 1, 1] - bend[j, 1]
        for i in range(3):  # t × e1 = e2, t × e2 = -e1
            theta[i] = d0 * frame[j, 2, i] - d1 * frame[j, 1, i]
        _twist_of_turn(theta, position[j], twist[row])
        first[row] = j
        row += 1
    moved, turned = np.empty((2, 3)), np.empty((2, 3))
    for j in range(k):
        if not curved[j]:
            continue
        length = joints[j + 1] - joints[j] if j + 1 < k else 0.0
        _turn_by_curvature(bend[j, 0], bend[j, 1], length, turned)
        position_by_curvature(bend[j, 0], bend[j, 1], length, moved)
        for c in range(2):
            for i in range(3):
                theta[i] = 0.0
                for d in range(3):
                    theta[i] += turned[c, d] * frame[j, d, i]
            if j + 1 < k:
                _twist_of_turn(theta, position[j + 1], twist[row])
                for i in range(3):
                    for d in range(3):
                        twist[row, i] += moved[c, d] * frame[j, d, i]
            first[row], own[row] = j + 1, j
            row += 1
    return twist, first, own


def _add_tangents(
    moments,
    tangents,
    chain,
    position,
    frame,
):
    """Add the rows of the sensed directions to the moments of their pieces; returns their cost, (94)."""
    if tangents is None:
        return 0.0
    unit, weight, s, joints, bend = tangents.unit, tangents.weight, chain.stations, chain.joints, chain.bend
    added = np.zeros(moments.shape)
    row, local, by, off = np.zeros(9), np.empty((4, 3)), np.empty((2, 3)), np.empty(3)
    cost, j = 0.0, 0
    for i in range(len(s)):
        w = weight[i]
        if w <= 0.0:
            continue
        j = piece_of(joints, s[i], j)
        k0, k1, here = bend[j, 0], bend[j, 1], s[i] - joints[j]
        a_of, b_of, _, _, _ = arc_functions((k0 * k0 + k1 * k1) * here * here)
        fill_local(a_of, b_of, k0, k1, here, local)
        _turn_by_curvature(k0, k1, here, by)
        for c in range(3):
            off[c] = unit[i, 0] * frame[j, c, 0] + unit[i, 1] * frame[j, c, 1] + unit[i, 2] * frame[j, c, 2]
        own = added[j]
        for part in range(2, 4):  # t × e1 = e2, t × e2 = -e1
            sign = 1.0 if part == 2 else -1.0
            row[6], row[7], row[8] = 0.0, 0.0, 0.0
            for c in range(3):
                row[3 + c] = sign * local[5 - part, c]
                row[6] += by[0, c] * row[3 + c]
                row[7] += by[1, c] * row[3 + c]
                row[8] += off[c] * local[part, c]
            cost += w * row[8] * row[8]
            for a in range(3, 8):
                for b in range(a, 9):
                    own[a, b] += w * row[a] * row[b]
    _to_world(added, position, frame)
    moments += added
    return cost


def _to_world(moments, position, frame):
    """Carry moments [k, 9, 9] from each piece's axes to the world's, in place, and make them symmetric."""
    carry, half = np.empty((6, 6)), np.empty((6, 9))
    for j in range(len(position)):
        m = moments[j]
        for a in range(9):
            for b in range(a):
                m[a, b] = m[b, a]
        x, y, z = position[j, 0], position[j, 1], position[j, 2]
        for d in range(3):  # (n, x × n) goes to (Rn, position × Rn + R(x × n))
            r0, r1, r2 = frame[j, d, 0], frame[j, d, 1], frame[j, d, 2]
            carry[0, d], carry[1, d], carry[2, d] = r0, r1, r2
            carry[3, d], carry[4, d], carry[5, d] = y * r2 - z * r1, z * r0 - x * r2, x * r1 - y * r0
            carry[:3, 3 + d] = 0.0
            carry[3, 3 + d], carry[4, 3 + d], carry[5, 3 + d] = r0, r1, r2
        for a in range(6):
            for b in range(9):
                total = 0.0
                for c in range(6):
                    total += carry[a, c] * m[c, b]
                half[a, b] = total
        for a in range(6):
            for b in range(6):
                total = 0.0
                for c in range(6):
                    total += half[a, c] * carry[b, c]
                m[a, b] = total
            for b in range(6, 9):
                m[a, b], m[b, a] = half[a, b], half[a, b]


def normal_equations(data, chain, reach):
    """Return the equations of the fit; docs/model.md (31), (32)."""
    position, frame = joint_frames(chain.start, chain.axes, chain.joints, chain.bend)
    twist, first, own = twists(chain, position, frame, data.free)
    if data.free:
        moments, square, cost = moments_across(data, chain, position, frame, reach)
    else:
        moments, square, cost = moments_known(data, chain, position, frame)
    cost += _add_tangents(moments, data.tangents, chain, position, frame)
    m, k = len(twist), len(chain.bend)
    beyond = np.zeros((k + 1, 6, 7))  # moments, and those with the residual, of a piece and all that follow
    for j in range(k - 1, -1, -1):
        for a in range(6):
            for b in range(6):
                beyond[j, a, b] = beyond[j + 1, a, b] + moments[j, a, b]
            beyond[j, a, 6] = beyond[j + 1, a, 6] + moments[j, a, 8]
    matrix, gradient = np.zeros((m, m)), np.zeros(m)
    response = np.empty(6)
    side = 7  # of the own components 6 and 7 in turn
    for b in range(m):
        here, of = first[b], own[b]
        side = 13 - side if of >= 0 else side
        for i in range(6):
            total = 0.0
            for c in range(6):
                total += beyond[here, i, c] * twist[b, c]
            response[i] = total
            gradient[b] += beyond[here, i, 6] * twist[b, i]
        if of >= 0:
            gradient[b] += moments[of, side, 8]
        for a in range(m):
            if first[a] > here or (first[a] == here and a > b):
                continue
            value = 0.0
            for i in range(6):
                value += twist[a, i] * response[i]
            if of >= 0:
                if first[a] <= of:
                    for i in range(6):
                        value += twist[a, i] * moments[of, i, side]
                elif own[a] == of:
                    value += moments[of, side if a == b else 6, side]
            matrix[a, b] = value
            matrix[b, a] = value
    return matrix, gradient, cost, square


def slide_of_end(chain):
    """How the foot of the last point moves along the chain with each parameter [m]; docs/model.md (31).

    A parameter that carries the end forwards leaves the point behind it."""
    k = len(chain.bend)
    start, frame = joint_frames(chain.start, chain.axes, chain.joints, chain.bend)
    positions, tangents, _ = along(chain.stations[-1:], chain.start, chain.axes, chain.joints, chain.bend)
    position, tangent = positions[0], tangents[0]
    twist, first, own = twists(chain, start, frame, True)
    by = np.empty((2, 3))
    length = chain.stations[-1] - chain.joints[k - 1]
    position_by_curvature(chain.bend[k - 1, 0], chain.bend[k - 1, 1], length, by)
    slide, side = np.zeros(len(own)), 1
    for a in range(len(own)):
        side = 1 - side if own[a] >= 0 else side
        for c in range(3):
            d, e = (c + 1) % 3, (c + 2) % 3
            if own[a] == k - 1:
                moved = by[side, 0] * frame[k - 1, 0, c]
                moved += by[side, 1] * frame[k - 1, 1, c] + by[side, 2] * frame[k - 1, 2, c]
            elif first[a] < k:
                moved = twist[a, c] + twist[a, 3 + d] * position[e] - twist[a, 3 + e] * position[d]
            else:
                moved = 0.0
            slide[a] -= tangent[c] * moved
    return slide
