"""Slow twins of the ends of a tendon with effects, and of its contacts on a route; docs/model.md."""

import math

import numpy as np

from tests.core.twins.tendon_laws import load_factor, stretched
from tests.core.twins.tendon_profile import bent, discretised, exponential
from tssgeom.core.constants import ROUNDING
from tssgeom.core.constants_tendon import SOLVER


def _worn(plant, travel):
    """Return what the travel of a contact makes of its friction [1]; docs/model.md (52)."""
    return 1.0 - plant.wear_gain * math.expm1(-travel / plant.wear_travel)


def answering(plant, travel, tension_out, pull):
    """Go from the load to the drive along the side of the cone on which all slides slowly."""
    here, sign = tension_out, 1.0 if pull else -1.0
    for i in range(travel.size - 1, -1, -1):
        exponent = (plant.pulling[i] if pull else plant.releasing[i]) * _worn(plant, travel[i])
        far = max(here + sign * plant.force[i], 0.0)
        near = far * math.exp(sign * (exponent + plant.fitting[i]))
        for _ in range(SOLVER.trials if plant.load_exponent != 0.0 and far > 0.0 else 0):
            factor = load_factor(0.5 * (near + here), plant.load_exponent, plant.load_reference)
            new = far * math.exp(sign * (exponent * factor + plant.fitting[i]))
            near, change = new, abs(new - near)
            if change <= ROUNDING.single * near:
                break
        here = near
    return here


def _used(plant, memory, i):
    """Return how much of its cone a contact uses, −1 pulled to +1 released, and its exponent then [1]."""
    near, far = memory.tension[i], memory.tension[i + 1]
    if max(near, far) < SOLVER.accepted:
        return 0.0, 0.0  # a loose tendon uses nothing of it
    factor = load_factor(0.5 * (near + far), plant.load_exponent, plant.load_reference)
    factor *= _worn(plant, memory.travel[i])
    exponent = (plant.pulling[i] if far < near else plant.releasing[i]) * factor
    whole = math.expm1(exponent + plant.fitting[i])
    if far < near:
        whole = -math.expm1(-exponent - plant.fitting[i])
    share = (far - near) / max(whole * near + plant.force[i], 1e-300)
    return share if plant.speed_gain != 0.0 else min(max(share, -1.0), 1.0), exponent


def spread(plant, memory, frictions, edge, pieces):
    """Return the variances of δ and of what presses, and d ln T_out over the latter; docs/model.md (123)."""
    length, pressed, covariance = pieces  # what an angle adds to ψ of (53), for each piece [1]
    n, k = edge.size - 1, length.size
    whole = np.sum(length)
    gradient, used = np.zeros(2 * k), 0.0
    slope = 0.0
    for j in range(1, n + 2):  # bars in the sheath, then what lies between sheath and load
        pull = memory.tension[j]
        share, exponent = _used(plant, memory, j - 1)
        used = share if exponent > ROUNDING.relative else used  # on a straight stretch as before it
        factor = load_factor(pull, plant.load_exponent, plant.load_reference)
        friction = frictions[0] if used < 0.0 else frictions[1]
        slope = used * friction * factor * _worn(plant, memory.travel[j - 1])
        soft, toe, toe_scale, saved = plant.soft[j], plant.toe[j], plant.toe_scale[j], plant.saved[j]
        _, rise = stretched(pull, soft, toe, toe_scale, saved, plant.saved_scale)
        if j == n + 1 and plant.load > 0.0:
            rise -= 1.0 / plant.load
        begin, end = (edge[j - 1] * whole, edge[j] * whole) if j <= n else (whole, whole)
        strain = (memory.displacement[j - 1] - memory.displacement[j]) / (end - begin) if j <= n else 0.0
        taut = math.exp(-plant.pretension / plant.saved_scale) - math.exp(-pull / plant.saved_scale)
        start = 0.0
        for i in range(k):
            stop = start + length[i]
            overlap = max(min(end, stop) - max(begin, start), 0.0) / length[i]
            passed = min(max((0.5 * (begin + end) - start) / length[i], 0.0), 1.0)
            gradient[i] += strain * overlap
            gradient[k + i] += rise * pull * slope * passed * pressed[i] + plant.clearance * taut * overlap
            start = stop
    variance, angle_variance = 0.0, 0.0
    for i in range(2 * k):
        for j in range(2 * k):
            variance += gradient[i] * covariance[i, j] * gradient[j]
            if i >= k and j >= k:
                angle_variance += pressed[i - k] * covariance[i, j] * pressed[j - k]
    return max(variance, 0.0), max(angle_variance, 0.0), slope


def put_on_route(plant, numbers, edge, length, angle, bends):
    """Return the plant with contacts and saved paths as a route makes them; docs/model.md (52)-(60).

    `numbers` are friction, asymmetry [1] and gain of curvature [m].
    """
    friction, asymmetry, gain = numbers
    length, angle = bent(length, angle, bends)
    pressing = angle * np.maximum(1.0 + gain * angle / length, 0.0)
    base = friction * discretised(edge, length, pressing)[2]
    pulling, releasing = base * (1.0 + asymmetry), base * (1.0 - asymmetry)
    ends = np.concatenate(([0.0], np.cumsum(length)))
    turns = np.diff(np.interp(edge * ends[-1], ends, np.concatenate(([0.0], np.cumsum(angle)))))
    return plant._replace(
        pulling=pulling,
        releasing=releasing,
        low=exponential(-pulling - plant.fitting),
        high=exponential(releasing + plant.fitting),
        saved=np.concatenate(([0.0], plant.clearance * turns, [0.0])),
    )
