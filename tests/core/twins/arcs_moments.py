"""Slow twins of arcs_moments.c: positions along a chain of arcs, and moments of the points on it."""

import math

import numpy as np

from tssgeom.core.constants_arcs import FOOT


def arc_functions(q):
    """Functions of q = θ²: sin θ/θ, (1 - cos θ)/θ², (θ - sin θ)/θ³, and derivatives of the first two."""
    if q < 1e-2:
        a = 1 - q / 6 * (1 - q / 20 * (1 - q / 42 * (1 - q / 72)))
        b = 0.5 * (1 - q / 12 * (1 - q / 30 * (1 - q / 56 * (1 - q / 90))))
        c = (1 - q / 20 * (1 - q / 42 * (1 - q / 72 * (1 - q / 110)))) / 6
        da = -(1 - q / 10 * (1 - q / 28 * (1 - q / 54 * (1 - q / 88)))) / 6
        db = -(1 - q / 15 * (1 - q / 37.333333333333336 * (1 - q / 67.5 * (1 - q / 105.6)))) / 24
        return a, b, c, da, db
    t = math.sqrt(q)
    a, cos = math.sin(t) / t, math.cos(t)
    b = (1 - cos) / q
    return a, b, (1 - a) / q, 0.5 * (cos - a) / q, (0.5 * a - b) / q


def _local(k0, k1, h, out):
    """Position and axes (rows: position, tangent, normals) at arc length h, in the axes at its start."""
    a, b, _, _, _ = arc_functions((k0 * k0 + k1 * k1) * h * h)
    fill_local(a, b, k0, k1, h, out)


def fill_local(a, b, k0, k1, h, out):
    """Write position and axes from the arc functions a and b of the turn; see `_local`."""
    w0, w1 = k0 * h, k1 * h
    out[0, 0], out[0, 1], out[0, 2] = h * a, h * b * w0, h * b * w1
    out[1, 0], out[1, 1], out[1, 2] = 1 - b * (w0 * w0 + w1 * w1), a * w0, a * w1
    out[2, 0], out[2, 1], out[2, 2] = -a * w0, 1 - b * w0 * w0, -b * w0 * w1
    out[3, 0], out[3, 1], out[3, 2] = -a * w1, -b * w0 * w1, 1 - b * w1 * w1


def joint_frames(start, axes, joints, bend):
    """Position [k, 3] and axes [k, 3, 3] at the start of every piece."""
    k = len(bend)
    position, frame = np.empty((k, 3)), np.empty((k, 3, 3))
    for i in range(3):
        position[0, i] = start[i]
        for c in range(3):
            frame[0, c, i] = axes[c, i]
    local = np.empty((4, 3))
    for j in range(1, k):
        _local(bend[j - 1, 0], bend[j - 1, 1], joints[j] - joints[j - 1], local)
        for i in range(3):
            t, e0, e1 = frame[j - 1, 0, i], frame[j - 1, 1, i], frame[j - 1, 2, i]
            position[j, i] = position[j - 1, i] + local[0, 0] * t + local[0, 1] * e0 + local[0, 2] * e1
            for c in range(3):
                frame[j, c, i] = local[1 + c, 0] * t + local[1 + c, 1] * e0 + local[1 + c, 2] * e1
    return position, frame


def piece_of(joints, s, guess):
    """Piece that holds arc length s; whatever lies beyond the ends belongs to the first or last piece."""
    k = len(joints)
    while guess + 1 < k and s >= joints[guess + 1]:
        guess += 1
    while guess > 0 and s < joints[guess]:
        guess -= 1
    return guess


def along(s, start, axes, joints, bend):
    """Position [n, 3], unit tangent [n, 3] and curvature vector [n, 3] at arc lengths `s` [n]."""
    position, frame = joint_frames(start, axes, joints, bend)
    x, t, curvature = np.empty((len(s), 3)), np.empty((len(s), 3)), np.empty((len(s), 3))
    local = np.empty((4, 3))
    j = 0
    for i in range(len(s)):
        j = piece_of(joints, s[i], j)
        _local(bend[j, 0], bend[j, 1], s[i] - joints[j], local)
        for c in range(3):
            f0, f1, f2 = frame[j, 0, c], frame[j, 1, c], frame[j, 2, c]
            x[i, c] = position[j, c] + local[0, 0] * f0 + local[0, 1] * f1 + local[0, 2] * f2
            t[i, c] = local[1, 0] * f0 + local[1, 1] * f1 + local[1, 2] * f2
            first = local[2, 0] * f0 + local[2, 1] * f1 + local[2, 2] * f2
            second = local[3, 0] * f0 + local[3, 1] * f1 + local[3, 2] * f2
            curvature[i, c] = bend[j, 0] * first + bend[j, 1] * second
    return x, t, curvature


def _bending_planes(frame, bend):
    """Curvature [k] of each piece, its direction [k, 2] on both normals, and axes [k, 3, 3] along it.

    The axes are the tangent where the piece begins, the normal that it bends to, and the one across."""
    k = len(bend)
    kappa, towards, flat = np.empty(k), np.empty((k, 2)), np.empty((k, 3, 3))
    for j in range(k):
        kappa[j] = math.sqrt(bend[j, 0] ** 2 + bend[j, 1] ** 2)
        towards[j, 0], towards[j, 1] = 1.0, 0.0
        if kappa[j] > 0.0:
            towards[j, 0], towards[j, 1] = bend[j, 0] / kappa[j], bend[j, 1] / kappa[j]
        for c in range(3):
            e0, e1 = frame[j, 1, c], frame[j, 2, c]
            flat[j, 0, c] = frame[j, 0, c]
            flat[j, 1, c] = towards[j, 0] * e0 + towards[j, 1] * e1
            flat[j, 2, c] = towards[j, 0] * e1 - towards[j, 1] * e0
    return kappa, towards, flat


def _advanced(square, x, g, move):
    """x₀ and g farther on by `move` along an arc of squared curvature `square`."""
    q = square * move * move
    if q < 1e-2:
        a = 1.0 + q * (-1 / 6 + q * (1 / 120 + q * (-1 / 5040 + q * (1 / 362880))))
        b = 0.5 + q * (-1 / 24 + q * (1 / 720 + q * (-1 / 40320 + q * (1 / 3628800))))
    else:
        a, b, _, _, _ = arc_functions(q)
    forward, aside = a * move, b * move * move
    tangent = 1.0 - square * g
    return x + tangent * forward - square * x * aside, g + x * forward + tangent * aside


def moments_across(data, chain, position, frame, reach):
    """Moments where stations are unknown: only distances across the chain count."""
    p, weight, s, joints, bend = data.points, data.weight, chain.stations, chain.joints, chain.bend
    kappa, towards, flat = _bending_planes(frame, bend)
    sums, square = np.zeros((len(bend), 12)), np.empty(len(s))  # of products with 1, x₀ and g
    cost, near = 0.0, FOOT.near * reach
    # each point goes on from where the last one was before it moved, so that both may be worked on at once
    base, base_at, base_x, base_g = 0, joints[0], 0.0, 0.0
    for i in range(len(s)):
        steps = FOOT.steps if reach > 0.0 else 0
        j = piece_of(joints, s[i], base)
        if j != base:
            base, base_at, base_x, base_g = j, joints[j], 0.0, 0.0
        base_x, base_g = _advanced(kappa[j] * kappa[j], base_x, base_g, s[i] - base_at)
        base_at = s[i]
        x, g = base_x, base_g
        while True:
            k = kappa[j]
            o0, o1, r2 = -x, -k * g, 0.0
            for c in range(3):
                d = p[i, c] - position[j, c]
                o0 += d * flat[j, 0, c]
                o1 += d * flat[j, 1, c]
                r2 += d * flat[j, 2, c]
            t0, t1 = 1.0 - k * k * g, k * x
            r1 = t0 * o1 - t1 * o0
            if steps == 0:
                break
            move = min(max((t0 * o0 + t1 * o1) / max(1.0 - k * r1, FOOT.least_slope), -reach), reach)
            steps = steps - 1 if abs(move) >= near else 0
            s[i] += move
            before, j = j, piece_of(joints, s[i], j)
            if j == before:
                x, g = _advanced(k * k, x, g, move)
            else:
                x, g = _advanced(kappa[j] * kappa[j], 0.0, 0.0, s[i] - joints[j])
        square[i] = r1 * r1 + r2 * r2
        w = weight[i]
        if w > 0.0:
            cost += w * square[i]
            wx, wg, of = w * x, w * g, sums[j]
            of[0] += w
            of[1] += wx
            of[2] += wg
            of[3] += wx * x
            of[4] += wx * g
            of[5] += wg * g
            of[6] += w * r1
            of[7] += wx * r1
            of[8] += wg * r1
            of[9] += w * r2
            of[10] += wx * r2
            of[11] += wg * r2
    return _of_sums_across(sums, position, kappa, towards, flat), square, cost


def moments_known(data, chain, position, frame):
    """Moments where stations are known: every coordinate counts; otherwise as `moments_across`."""
    p, weight, s, joints, bend = data.points, data.weight, chain.stations, chain.joints, chain.bend
    kappa, towards, flat = _bending_planes(frame, bend)
    products, off = np.zeros((len(bend), 6, 6)), np.zeros((len(bend), 3, 6))
    square, value, o = np.empty(len(s)), np.empty(6), np.empty(3)
    cost, j = 0.0, 0
    for i in range(len(s)):
        j = piece_of(joints, s[i], j)
        k, h = kappa[j], s[i] - joints[j]
        a, b, _, da, db = arc_functions(k * k * h * h)
        x, g = h * a, h * h * b
        value[0], value[1], value[2], value[3] = 1.0, x, k * g, g
        value[4], value[5] = 2 * h * h * h * da * k, g + 2 * (h * h * k) ** 2 * db  # of dx/dκ
        o[0], o[1], o[2] = -x, -k * g, 0.0
        for c in range(3):
            d = p[i, c] - position[j, c]
            for e in range(3):
                o[e] += d * flat[j, e, c]
        square[i] = o[0] ** 2 + o[1] ** 2 + o[2] ** 2
        w = weight[i]
        if w > 0.0:
            cost += w * square[i]
            for a_of in range(6):
                wa = w * value[a_of]
                for b_of in range(a_of, 6):
                    products[j, a_of, b_of] += wa * value[b_of]
                for e in range(3):
                    off[j, e, a_of] += wa * o[e]
    return _of_sums_known(products, off, position, towards, flat), square, cost


def _of_sums_known(products, off, position, towards, flat):
    """Moments [k, 9, 9] from the sums of products of 1, x₀, κg, g and both parts of dx/dκ, and residuals."""
    k = len(towards)
    moments = np.zeros((k, 9, 9))
    row = np.zeros((3, 8, 6))  # of the three axes of the plane of bending
    for j in range(k):
        for c in range(3):
            d, e = (c + 1) % 3, (c + 2) % 3
            for a in range(3):
                row[a, c, 0] = flat[j, a, c]
                row[a, 3 + c, 0] = position[j, d] * flat[j, a, e] - position[j, e] * flat[j, a, d]
            t, u, v = flat[j, 0, c], flat[j, 1, c], flat[j, 2, c]
            row[0, 3 + c, 2] = -v
            row[1, 3 + c, 1] = v
            row[2, 3 + c, 1], row[2, 3 + c, 2] = -u, t
        for c in range(2):
            row[0, 6 + c, 4] = row[1, 6 + c, 5] = towards[j, c]
        row[2, 6, 3], row[2, 7, 3] = -towards[j, 1], towards[j, 0]
        for a in range(6):
            for b in range(a):
                products[j, a, b] = products[j, b, a]
        for a in range(3):
            _add(moments[j], row[a], products[j], off[j, a])
    return moments


def _of_sums_across(sums, position, kappa, towards, flat):
    """Moments [k, 9, 9] from the sums of products of 1, x₀, g and the residuals on both normals."""
    k = len(kappa)
    moments, products = np.zeros((k, 9, 9)), np.empty((3, 3))
    first, second = np.zeros((8, 3)), np.zeros((8, 3))  # rows of both normals, by 1, x₀ and g
    for j in range(k):
        of, curvature = sums[j], kappa[j]
        for c in range(3):
            d, e = (c + 1) % 3, (c + 2) % 3
            t, u, v = flat[j, 0, c], flat[j, 1, c], flat[j, 2, c]
            turn_t = position[j, d] * flat[j, 0, e] - position[j, e] * flat[j, 0, d]
            turn_u = position[j, d] * flat[j, 1, e] - position[j, e] * flat[j, 1, d]
            turn_v = position[j, d] * flat[j, 2, e] - position[j, e] * flat[j, 2, d]
            first[c, 0], first[c, 1], first[c, 2] = u, -curvature * t, -curvature * curvature * u
            second[c, 0] = v
            first[3 + c, 0] = turn_u
            first[3 + c, 1] = v - curvature * turn_t
            first[3 + c, 2] = -curvature * curvature * turn_u
            second[3 + c, 0], second[3 + c, 1], second[3 + c, 2] = turn_v, -u, curvature * t
        first[6, 2], first[7, 2] = towards[j, 0], towards[j, 1]
        second[6, 2], second[7, 2] = -towards[j, 1], towards[j, 0]
        products[0, 0], products[0, 1], products[0, 2] = of[0], of[1], of[2]
        products[1, 0], products[1, 1], products[1, 2] = of[1], of[3], of[4]
        products[2, 0], products[2, 1], products[2, 2] = of[2], of[4], of[5]
        _add(moments[j], first, products, of[6:9])
        _add(moments[j], second, products, of[9:12])
    return moments


def _add(own, row, products, off):
    """Add rows [8, f] of f functions, with the sums of their products and of those with the residual."""
    f = row.shape[1]
    half = np.empty(f)
    for a in range(8):
        for q in range(f):
            half[q] = 0.0
            for p in range(f):
                half[q] += row[a, p] * products[p, q]
        for b in range(a, 8):
            total = 0.0
            for q in range(f):
                total += half[q] * row[b, q]
            own[a, b] += total
            own[b, a] = own[a, b]
        total = 0.0
        for q in range(f):
            total += row[a, q] * off[q]
        own[a, 8] += total
        own[8, a] = own[a, 8]
