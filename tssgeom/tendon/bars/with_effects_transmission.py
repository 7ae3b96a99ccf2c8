"""Both ends of a tendon with effects: dead zone, front, and standard errors.

Source: docs/model.md (121)-(123).
"""

import math

import numpy as np
from numba import njit

from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.bar_state import BarState
from tssgeom.tendon.bars.contact_grid import discretise
from tssgeom.tendon.bars.model import Model
from tssgeom.tendon.bars.plant import load_factor, stretched
from tssgeom.tendon.transmission import Transmission

_ANSWERS = 1e-7  # of the greater end's tension, or N: bars are balanced to so much
_CLOSE = 1e-15  # of ln T in the search for the tension before a contact
_PASSES = 60
_STRAIGHT = 1e-9  # exponent below which a contact tells nothing of what friction does


def of_effects(state: BarState, model: Model, route: Arcs) -> Transmission:
    """Return tension, elongation and dead zone of a tendon on the route on which it lies."""
    tension_in, tension_out, way = state.tension_in, state.tension_out, state.direction_index
    variance, angle_variance, slope_out = _spread(
        model.plant,
        state.memory,
        _frictions(model),
        model.edge,
        (route.length, 1.0 + 2.0 * model.setup.curvature_gain_m * route.kappa, route.covariance),
    )
    width = way * (answering(state, model, tension_out, way) - tension_in)
    replied = int(state.memory.slip[-1]) == way or width <= _ANSWERS * max(tension_in, tension_out, 1.0)
    return Transmission(
        tension_in=tension_in,
        tension_out=tension_out,
        elongation=state.elongation,
        elongation_se=math.sqrt(variance),
        tension_out_se=tension_out * abs(slope_out) * math.sqrt(angle_variance),
        direction_index=way,
        dead_zone=not replied,
        dead_zone_width=0.0 if replied else width,
        slip_front=_front(state, route),
        displacement_in=state.displacement_in,
        displacement_out=state.displacement_out,
    )


def answering(state: BarState, model: Model, tension_out: float, way: int) -> float:
    """Return the proximal tension from which on a slow pull (+1) or release (−1) moves the load [N].

    `tension_out` is the distal tension then [N]; docs/model.md (122).
    """
    return _answering(model.plant, state.memory.travel, tension_out, way > 0)


def _frictions(model: Model) -> tuple[float, float]:
    """Friction coefficients on a pull and on a release, before load and wear [1]; docs/model.md (52)."""
    friction, asymmetry = model.setup.friction, model.setup.asymmetry
    return friction * (1.0 + asymmetry), friction * (1.0 - asymmetry)


def _front(state: BarState, route: Arcs) -> float:
    """Return the curve angle up to which the tendon slid when the drive last moved [rad]."""
    if state.front == len(state.memory.slip):
        return route.total_angle
    return float(discretise(state.edge, route).mean_angle[state.front - 1]) if state.front > 0 else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _worn(plant, travel):
    """Return what the travel of a contact makes of its friction [1]; docs/model.md (52)."""
    return 1.0 - plant.wear_gain * math.expm1(-travel / plant.wear_travel)


@njit(cache=True, nogil=True, error_model="numpy")
def _answering(plant, travel, tension_out, pull):
    """Go from the load to the drive along the side of the cone on which all slides slowly."""
    here, sign = tension_out, 1.0 if pull else -1.0
    for i in range(travel.size - 1, -1, -1):
        exponent = (plant.pulling[i] if pull else plant.releasing[i]) * _worn(plant, travel[i])
        far = max(here + sign * plant.force[i], 0.0)
        near = far * math.exp(sign * (exponent + plant.fitting[i]))
        for _ in range(_PASSES if plant.load_exponent != 0.0 and far > 0.0 else 0):
            factor = load_factor(0.5 * (near + here), plant.load_exponent, plant.load_reference)
            new = far * math.exp(sign * (exponent * factor + plant.fitting[i]))
            near, change = new, abs(new - near)
            if change <= _CLOSE * near:
                break
        here = near
    return here


@njit(cache=True, nogil=True, error_model="numpy")
def _used(plant, memory, i):
    """Return how much of its cone a contact uses, −1 pulled to +1 released, and its exponent then [1]."""
    near, far = memory.tension[i], memory.tension[i + 1]
    if max(near, far) < _ANSWERS:
        return 0.0, 0.0  # a loose tendon uses nothing of it
    factor = load_factor(0.5 * (near + far), plant.load_exponent, plant.load_reference)
    factor *= _worn(plant, memory.travel[i])
    exponent = (plant.pulling[i] if far < near else plant.releasing[i]) * factor
    whole = math.expm1(exponent + plant.fitting[i])
    if far < near:
        whole = -math.expm1(-exponent - plant.fitting[i])
    share = (far - near) / max(whole * near + plant.force[i], 1e-300)
    return share if plant.speed_gain != 0.0 else min(max(share, -1.0), 1.0), exponent


@njit(cache=True, nogil=True, error_model="numpy")
def _spread(plant, memory, frictions, edge, pieces):
    """Return the variances of δ and of what presses, and d ln T_out over the latter; docs/model.md (123)."""
    length, pressed, covariance = pieces  # what an angle adds to ψ of (53), for each piece [1]
    n, k = edge.size - 1, length.size
    whole = np.sum(length)
    gradient, used = np.zeros(2 * k), 0.0
    slope = 0.0
    for j in range(1, n + 2):  # bars in the sheath, then what lies between sheath and load
        pull = memory.tension[j]
        share, exponent = _used(plant, memory, j - 1)
        used = share if exponent > _STRAIGHT else used  # on a straight stretch as before it
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
