"""Hysteresis operators on a sampled drive: play, stop, dead zone, Bouc–Wen; rate has no part in any."""

from __future__ import annotations

import math

import numpy as np

from tssgeom.arrays import Vector

_STEP = 0.2  # of the yield displacement; a longer change of the drive is cut up


def play(drive: Vector, half_width: float) -> Vector:
    """Return what lags the drive by at most `half_width`; it starts at the drive's first value."""
    lagging = np.empty_like(drive)
    state = float(drive[0])
    for i, value in enumerate(drive.tolist()):
        state = min(max(state, value - half_width), value + half_width)
        lagging[i] = state
    return lagging


def stop(drive: Vector, half_width: float) -> Vector:
    """Return the drive less its play: an elastic body that slides at `half_width`."""
    return drive - play(drive, half_width)


def dead_zone(values: Vector, half_width: float) -> Vector:
    """Return what exceeds the clearance on either side."""
    return values - np.clip(values, -half_width, half_width)


def bouc_wen(drive: Vector, yield_at: float, share: float, power: float) -> Vector:
    """Return the hysteretic variable z, from -1 to 1, of a drive u.

    dz = (1 - |z|^n (share sgn(z du) + 1 - share)) du / yield_at, where `share` is β/(β + γ) of the usual
    notation and n is `power`.
    """
    states = np.empty_like(drive)
    state = 0.0
    changes = (np.diff(drive, prepend=drive[0]) / yield_at).tolist()
    for i, change in enumerate(changes):
        count = math.ceil(abs(change) / _STEP)
        part = change / max(count, 1)
        for _ in range(min(count, 100)):
            against = share if state * part > 0.0 else -share
            state += part * (1.0 - abs(state) ** power * (against + 1.0 - share))
            state = min(max(state, -1.0), 1.0)
        states[i] = state
    return states
