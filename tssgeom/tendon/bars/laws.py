"""The laws of a bar and a contact in a measured run, compiled, and what one sample leaves to the next."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

LEAST_LOAD = 1e-3
"""Below this tension load-dependent friction depends on the load no more [N]."""


class Memory(NamedTuple):
    """What one sample leaves to the next, b bars and k contacts; the march writes into these arrays."""

    tension: np.ndarray  # [b] N
    place: np.ndarray  # [k] displacement of each contact since the pretensioned state [m]
    speed: np.ndarray  # [k] of the last step [m/s]
    travel: np.ndarray  # [k] path slid so far, either way [m]
    creep: np.ndarray  # [b] m
    slip: np.ndarray  # [k] int8: +1 slid on a pull, 0 stuck, −1 slid on a release
    drive: np.ndarray
    """[6] last drive [N or m], warmth [K], position past the backlash [m], lag [m], lead [m], rate [m/s]"""


@njit(cache=True, nogil=True, error_model="numpy")
def stretched(tension, soft, toe, toe_scale, gap, gap_scale):
    """Return stretch [m] of a taut bar and its slope [m/N]; docs/model.md (50)."""
    stretch, slope = soft * tension, soft
    if toe != 0.0:
        rest = math.exp(-tension / toe_scale)
        stretch += toe * (1.0 - rest)
        slope += toe * rest / toe_scale
    if gap != 0.0:
        rest = math.exp(-tension / gap_scale)
        stretch += gap * (1.0 - rest)
        slope += gap * rest / gap_scale
    return stretch, slope


@njit(cache=True, nogil=True, error_model="numpy")
def stretch_of(plant, j, tension):
    """Return the stretch of bar j [m]; docs/model.md (50)."""
    return stretched(tension, plant.soft[j], plant.toe[j], plant.toe_scale[j], plant.gap[j], plant.gap_scale)[
        0
    ]


@njit(cache=True, nogil=True, error_model="numpy")
def load_factor(load, exponent, reference):
    """Return what the tension at a contact makes of the friction there [1]; docs/model.md (52)."""
    if exponent == 0.0:
        return 1.0
    return math.exp(exponent * math.log(max(load, LEAST_LOAD) / reference))


@njit(cache=True, nogil=True, error_model="numpy")
def worn(plant, travel, pulling, releasing):
    """Set the exponents of the cone after wear by the travel so far; docs/model.md (52)."""
    for i in range(travel.size):
        factor = 1.0 - plant.wear_gain * math.expm1(-travel[i] / plant.wear_travel)
        pulling[i], releasing[i] = plant.pulling[i] * factor, plant.releasing[i] * factor


@njit(cache=True, nogil=True, error_model="numpy")
def creep_weights(x):
    """Return weights of old creep, old and new tension after x time constants; docs/model.md (57)."""
    kept = math.exp(-x)
    mean = -math.expm1(-x) / x
    return kept, mean - kept, 1.0 - mean


@njit(cache=True, nogil=True, error_model="numpy")
def lagged(values, spans, lag, before):
    """Pass samples, straight between, through a lag that stands at `before`: in, out; docs/model.md (62)."""
    out = np.empty_like(values)
    last, seen = before
    for i in range(values.size):
        if spans[i] > 0.0:
            behind = (values[i] - last) / spans[i] * lag
            seen = values[i] - behind + (seen - last + behind) * math.exp(-spans[i] / lag)
        last = values[i]
        out[i] = seen
    return out
