"""The local laws of the chain, compiled: how a bar stretches and what a contact can hold."""

import math

from numba import njit

LEAST_LOAD_N = 1e-3  # below it a friction coefficient that depends on the load does so no more


@njit(cache=True, nogil=True, error_model="numpy")
def stretched(tension, compliance, toe, toe_scale, gap, clearance_scale):
    """Return extension [m] of a taut bar beyond its loose length, and its compliance there [m/N].

    extension = compliance T + toe (1 − e^(−T/toe_scale)) + gap (1 − e^(−T/gap_scale))
    """
    a, b = toe * math.exp(-tension / toe_scale), gap * math.exp(-tension / clearance_scale)
    return compliance * tension + (toe - a) + (gap - b), compliance + a / toe_scale + b / clearance_scale


@njit(cache=True, nogil=True, error_model="numpy")
def speed_factor(speed, law):
    """Return what a sliding speed [m/s] makes of the friction, and its slope [s/m] where that is above zero.

    law = (gain, reference speed, Stribeck gain, Stribeck speed)
    """
    gain, reference, stribeck, fall = law
    factor = 1.0 + gain * math.log1p(speed / reference) + stribeck * math.exp(-speed / fall)
    return factor, max(gain, 0.0) / (reference + speed)


@njit(cache=True, nogil=True, error_model="numpy")
def grip(chain, turn, travel, total, i):
    """Return Coulomb force per sum of the two tensions at node i, for pulling and releasing [1].

    Two bars that pull with a and b press (a + b) sin(turn/2) into a vertex; `total` is a + b [N].
    """
    if i == 0 or i == len(chain.friction) - 1:
        return 0.5 * chain.friction[i], 0.5 * chain.friction[i]
    press = math.sin(0.5 * turn)
    if press == 0.0:
        return 0.0, 0.0
    both = chain.friction[i] * press * (1.0 + chain.curvature_gain * turn / chain.share[i])
    if chain.wear_gain != 0.0:
        both *= 1.0 - chain.wear_gain * math.expm1(-travel / chain.wear_travel)
    if chain.load_exponent != 0.0:
        load = max(0.5 * total, LEAST_LOAD_N) / chain.load_reference
        if chain.load_is_normal:
            load *= 2.0 * press / chain.share[i]
        both *= load**chain.load_exponent
    return both * (1.0 + chain.asymmetry), both * (1.0 - chain.asymmetry)
