"""Slow twin of fibre.c: the average over all partitions of the gratings of a fibre."""

import math

import numpy as np


def average_partitions(s, bend, precision, cell, rate, size2):
    """Sum over all partitions, and the likeliest; returns the fields of `Partition`."""
    n = len(s)
    mass, first, square = np.zeros(n + 1), np.zeros((n + 1, 2)), np.zeros(n + 1)
    for i in range(n):
        p = precision[i]
        mass[i + 1] = mass[i] + p
        first[i + 1] = first[i] + p * bend[i]
        square[i + 1] = square[i] + 0.5 * p * np.sum(bend[i] ** 2) - math.log(p / (2 * math.pi))
    # of all partitions of the gratings before j: ln evidence, mean and mean square of φ, and of |κ| last
    total, best = np.zeros(n + 1), np.zeros(n + 1)
    phi, phi2 = np.zeros(n + 1), np.zeros(n + 1)
    kappa, kappa2 = np.zeros(n + 1), np.zeros(n + 1)
    joint, interval2 = np.zeros(n), np.zeros(n)
    for i in range(1, n):
        joint[i] = math.log(-math.expm1(-rate * (s[i] - s[i - 1])) + 1e-300)
        interval2[i] = (s[i] - s[i - 1]) ** 2 / 12.0
    origin, kind = np.zeros(n + 1, dtype=np.int64), np.zeros(n + 1, dtype=np.bool_)
    log = np.empty((n, 2))
    for j in range(1, n + 1):
        best[j] = -np.inf
        for i in range(j):
            prior = -rate * (s[j - 1] - s[i]) - math.log(2.0)
            if i > 0:
                prior += joint[i]
            m = mass[j] - mass[i]
            a, b = first[j, 0] - first[i, 0], first[j, 1] - first[i, 1]
            straight = prior - (square[j] - square[i])
            curved = straight + 0.5 * (a * a + b * b) / (m + 1.0 / size2) - math.log1p(m * size2)
            log[i, 0], log[i, 1] = total[i] + straight, total[i] + curved
            if best[i] + max(straight, curved) > best[j]:
                best[j], origin[j], kind[j] = best[i] + max(straight, curved), i, curved > straight
        top = np.max(log[:j])
        weight = 0.0
        for i in range(j):
            span = cell[j] - cell[i]
            m = mass[j] - mass[i]
            for curved in range(2):
                if log[i, curved] < top - 28.0:
                    continue
                w = math.exp(log[i, curved] - top)
                k, v = 0.0, 0.0
                if curved == 1:
                    a, b = first[j, 0] - first[i, 0], first[j, 1] - first[i, 1]
                    v = 1.0 / m
                    k = math.sqrt(max((a * a + b * b) / (m * m) - v, 0.0))
                    v = 1.0 / (m + 1.0 / size2)
                square_k = k * k + v
                own = span * span * v + interval2[i] * (kappa2[i] - 2 * kappa[i] * k + square_k)
                weight += w
                phi[j] += w * (phi[i] + span * k)
                phi2[j] += w * (phi2[i] + 2 * phi[i] * span * k + (span * k) ** 2 + own)
                kappa[j] += w * k
                kappa2[j] += w * square_k
        total[j] = top + math.log(weight)
        phi[j] /= weight
        phi2[j] /= weight
        kappa[j] /= weight
        kappa2[j] /= weight
    joints = [n]
    while joints[-1] > 0:
        joints.append(origin[joints[-1]])
    joints_up = np.array(joints[::-1])
    return total[n], phi[n], max(phi2[n] - phi[n] ** 2, 0.0), joints_up, kind[joints_up[1:]]
