"""The two local laws of the chain, compiled: a bar that cannot push, a bristle that holds until it slips."""

import math

from numba import njit

SLACK_N = 1e-4  # below it a bar goes slack smoothly, so that its tension never is zero or less; no drive pulls with less


@njit(cache=True, nogil=True)
def pull(extension, compliance, toe, toe_scale, gap, gap_scale):
    """Return tension [N] and stiffness [N/m] of a bar at an extension [m] beyond its loose length.

    extension = compliance T + toe (1 − e^(−T/toe_scale)) + gap (1 − e^(−T/gap_scale)); Newton from the left climbs
    monotonically since the right side is concave.
    """
    tension = extension / compliance
    slope = compliance
    if toe > 0.0 or gap > 0.0:
        tension = extension / (compliance + toe / toe_scale + gap / gap_scale)
        for _ in range(60):
            a = toe * math.exp(-max(tension, 0.0) / toe_scale)
            b = gap * math.exp(-max(tension, 0.0) / gap_scale)
            slope = compliance + a / toe_scale + b / gap_scale
            step = (extension - compliance * tension - (toe - a) - (gap - b)) / slope
            tension += step
            if tension < SLACK_N or abs(step) < 1e-13 * (1.0 + tension):
                break
    if tension >= SLACK_N:
        return tension, 1.0 / slope
    slope = compliance + toe * math.exp(-SLACK_N / toe_scale) / toe_scale
    slope += gap * math.exp(-SLACK_N / gap_scale) / gap_scale
    taut = (
        compliance * SLACK_N - toe * math.expm1(-SLACK_N / toe_scale) - gap * math.expm1(-SLACK_N / gap_scale)
    )
    tension = SLACK_N * math.exp(max((extension - taut) / (slope * SLACK_N), -600.0))
    return tension, tension / (slope * SLACK_N)


@njit(cache=True, nogil=True)
def bristle(trial, stiffness, coulomb, floor, drag, lagged, fresh, law):
    """Return (force [N], ∂force/∂displacement [N/m], ∂force/∂coulomb [1], slip [m]) of one bristle after a step.

    The bristle holds elastically up to coulomb · h(v) + floor, then slips by as much as brings it back to that
    plus drag · slip. The speed is v = lagged + fresh · slip [m/s]; h is the law of speed in `law`. Nothing moves while
    the trial force is below the limit, however long that is.
    """
    sign = 1.0 if trial >= 0.0 else -1.0
    size = abs(trial)
    factor, rise = _by_speed(lagged, law)
    hold = coulomb * factor + floor
    if size <= hold:
        return trial, stiffness, 0.0, 0.0
    slip = (size - hold) / (stiffness + drag)
    for _ in range(40):
        factor, rise = _by_speed(lagged + fresh * slip, law)
        total = stiffness + drag + coulomb * rise * fresh
        step = (size - (stiffness + drag) * slip - floor - coulomb * factor) / total
        slip = max(slip + step, 0.0)
        if abs(step) <= 1e-15 * slip:
            break
    soft = drag + coulomb * rise * fresh
    total = stiffness + soft
    force = size - stiffness * slip
    return sign * force, stiffness * soft / total, sign * stiffness * factor / total, sign * slip


@njit(cache=True, nogil=True)
def _by_speed(speed, law):
    """Return h and dh/dv; law = (gain, reference speed, Stribeck gain, Stribeck speed)."""
    gain, reference, stribeck, fall = law
    if gain == 0.0 and stribeck == 0.0:
        return 1.0, 0.0
    extra = stribeck * math.exp(-speed / fall)
    return 1.0 + gain * math.log1p(speed / reference) + extra, gain / (reference + speed) - extra / fall
