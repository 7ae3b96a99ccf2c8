"""A measured drive without its noise: friction keeps the highest reading of a hold and would keep its noise.

Source: docs/model.md (66).
"""

import numpy as np
from numba import njit
from scipy.optimize import isotonic_regression
from scipy.special import ndtri

from tssgeom.arrays import Vector

_TURN = 7.0  # standard deviations that a reading has to go back before the drive has turned
_PLATEAU = 6.0  # standard deviations below a peak in which its hold lies; the upper half counts


def calmed(drive: Vector, noise: float) -> Vector:
    """Return the drive monotone from turn to turn, with the extremes that the noise made taken back.

    Parameters
    ----------
    drive
        [m] Readings of the drive, N or m.
    noise
        Standard deviation of their white noise, in the same unit; 0 returns the readings.
    """
    if noise <= 0.0 or len(drive) < 3:
        return drive
    turns = _turns(np.asarray(drive, dtype=float), _TURN * noise)
    ends = [_extreme(drive, turns, k, noise) for k in range(len(turns))]
    out = np.empty(len(drive))
    for k in range(len(turns) - 1):
        first, last = turns[k], turns[k + 1] + 1
        rising = ends[k + 1] >= ends[k]
        smooth = isotonic_regression(drive[first:last], increasing=rising).x
        out[first:last] = np.clip(smooth, min(ends[k : k + 2]), max(ends[k : k + 2]))
    return out


def _extreme(drive: Vector, turns: np.ndarray, k: int, noise: float) -> float:
    """Return the turn's reading less what the largest of its plateau's noise adds."""
    here = turns[k]
    neighbour = drive[turns[k - 1] if k > 0 else turns[1]]
    sign = 1.0 if drive[here] >= neighbour else -1.0
    below = sign * (drive[here] - drive)
    near = below < _PLATEAU * noise
    start, stop = here, here
    while start > 0 and near[start - 1]:
        start -= 1
    while stop < len(drive) - 1 and near[stop + 1]:
        stop += 1
    if k in (0, len(turns) - 1):  # no turn, only an end: nothing was chosen for being extreme
        return float(drive[here])
    count = np.count_nonzero(below[start : stop + 1] < 0.5 * _PLATEAU * noise)
    return float(drive[here] - sign * noise * max(ndtri((count - 0.375) / (count + 0.25)), 0.0))


@njit(cache=True, nogil=True)
def _turns(drive, back):
    """Return the samples at which the drive turns by more than `back`, with both ends."""
    found = [0]
    low, high, sense = 0, 0, 0
    for i in range(1, drive.size):
        if drive[i] >= drive[high]:
            high = i
        if drive[i] <= drive[low]:
            low = i
        if sense >= 0 and drive[high] - drive[i] > back:
            if high > found[-1]:
                found.append(high)
            sense, low, high = -1, i, i
        elif sense <= 0 and drive[i] - drive[low] > back:
            if low > found[-1]:
                found.append(low)
            sense, low, high = 1, i, i
    if drive.size - 1 > found[-1]:
        found.append(drive.size - 1)
    return np.array(found)
