"""A measured drive without its noise: friction keeps the highest reading of a hold and would keep its noise.

Source: docs/model.md (66).
"""

from itertools import pairwise

import numpy as np
from numba import njit
from scipy.optimize import isotonic_regression
from scipy.special import ndtri

from tssgeom.arrays import Vector

_TURN = 7.0  # standard deviations that a reading has to go back before the drive has turned
_PLATEAU = 6.0  # standard deviations below a peak in which its hold lies; the upper half counts
_HOLD = 4.5  # standard deviations about the level of a hold in which its readings lie
_FLAT = 3.5  # standard errors of slope and bend below which a plateau is a hold
_FEWEST = 4  # readings of a hold


def calmed(drive: Vector, noise: float) -> Vector:
    """Return the drive monotone from turn to turn and level in holds at a turn or an end.

    Parameters
    ----------
    drive
        [m] Readings of the drive, N or m.
    noise
        Standard deviation of their white noise, in the same unit; 0 returns the readings.
    """
    if noise <= 0.0 or len(drive) < 3:
        return drive
    drive = np.asarray(drive, dtype=float)
    turns = _turns(drive, _TURN * noise)
    ends = [_extreme(drive, turns, k, noise) for k in range(len(turns))]
    out = np.empty(len(drive))
    for (first, last), (here, there) in zip(pairwise(turns), pairwise(ends), strict=True):
        smooth = isotonic_regression(drive[first : last + 1], increasing=bool(there >= here)).x
        out[first : last + 1] = np.clip(smooth, min(here, there), max(here, there))
    for turn in turns:
        start, stop = hold(drive, int(turn), noise)
        if stop - start >= _FEWEST:
            out[start:stop] = np.mean(drive[start:stop])
    return out


def turning_points(drive: Vector, noise: float) -> list[int]:
    """Return the samples at which the drive turns, one for each, the ends not among them."""
    found, behind = list[int](), hold(drive, 0, noise)[1]
    for turn in _turns(np.asarray(drive, dtype=float), _TURN * noise)[1:-1]:
        start, stop = hold(drive, int(turn), noise)
        if start >= behind and stop < len(drive):
            found.append(int(turn))
            behind = stop
    return found


def hold(drive: Vector, turn: int, noise: float) -> tuple[int, int]:
    """Return first sample of the hold at a turn and the one behind its last; a sharp turn holds itself."""
    sign = 1.0 if np.mean(drive[max(turn - 5, 0) : turn + 6]) <= drive[turn] else -1.0
    near = np.abs(drive[turn] - sign * 0.5 * _PLATEAU * noise - drive) < 0.5 * _PLATEAU * noise
    start, stop = _around(near | (np.arange(len(drive)) == turn), turn)
    start, stop = _around(np.abs(drive - np.median(drive[start:stop])) < _HOLD * noise, turn)
    return (start, stop) if _flat(drive[start:stop], noise) else (turn, turn + 1)


def _around(inside: np.ndarray, at: int) -> tuple[int, int]:
    """Return the stretch of samples about `at` that are inside."""
    before, behind = np.flatnonzero(~inside[:at]), np.flatnonzero(~inside[at + 1 :])
    start = int(before[-1]) + 1 if len(before) else 0
    return start, at + 1 + (int(behind[0]) if len(behind) else len(inside) - at - 1)


def _flat(readings: Vector, noise: float) -> bool:
    """Whether neither a slope nor a bend shows in a plateau."""
    if len(readings) < _FEWEST:
        return False
    place = np.linspace(-1.0, 1.0, len(readings))
    shapes = np.linalg.qr(np.column_stack([np.ones_like(place), place, place**2]))[0]
    return bool(np.abs(shapes[:, 1:].T @ readings).max() < _FLAT * noise)


def _extreme(drive: Vector, turns: np.ndarray, k: int, noise: float) -> float:
    """Return the turn's reading less what the largest of its plateau's noise adds."""
    here = turns[k]
    neighbour = drive[turns[k - 1] if k > 0 else turns[1]]
    sign = 1.0 if drive[here] >= neighbour else -1.0
    below = sign * (drive[here] - drive)
    if k in (0, len(turns) - 1):  # no turn, only an end: nothing was chosen for being extreme
        return float(drive[here])
    start, stop = _around(below < _PLATEAU * noise, int(here))
    count = np.count_nonzero(below[start:stop] < 0.5 * _PLATEAU * noise)
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
