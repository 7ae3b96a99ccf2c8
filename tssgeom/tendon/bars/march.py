"""The march through a measured run: one compiled loop over the samples with every effect in it.

Each sample goes the short way (`sweep.py`) where nothing but the drive moves the tendon, else the long one
(`balance.py`); both give the same. Source: docs/model.md (50)-(64).
"""

import numpy as np
from numba import njit

from tssgeom.tendon.bars.balance import balanced, workspace
from tssgeom.tendon.bars.equilibrium import TOLERANCES
from tssgeom.tendon.bars.plant import stretch_of
from tssgeom.tendon.bars.sweep import SWEEP, swept

_TURN = 2e-7  # [m] path over which backlash opens when only the tension is known; chosen: noise is less
_TINY_TIME = 1e-9  # s
_AFTER_A_TURN = np.array([0.02, 0.06, 0.15, 0.35, 0.65, 1.0])  # shares of a step in which drag lets go


@njit(cache=True, nogil=True, error_model="numpy")
def _cuts(before, now, parts, by_rate):
    """Return where to cut a step, as shares of it; docs/model.md (65)."""
    if by_rate and (abs(now) < 0.5 * abs(before) or now * before < 0.0):
        first = _AFTER_A_TURN / parts
        return np.concatenate((first, np.arange(2, parts + 1) / parts))
    return np.arange(1, parts + 1) / parts


@njit(cache=True, nogil=True, error_model="numpy")
def march(plant, memory, by_force, spans, drive, warmth, parts, out, profile):
    """Go through the samples; fill `out` [6, m] and, where it has rows, `profile` [m, b].

    `spans` [m] is the time since the sample before [s], `drive` [m] N or m, `warmth` [m] K since the run
    began, `parts` [m] the steps of each sample. Rows of `out`: T_in, T_out [N], x_in, x_out [m], what the
    first and the last contact did (+1 pulled, 0 stuck, −1 released). Return the number of samples done, fewer
    where one failed.
    """
    kept = memory.drive
    cone, room = workspace(plant)
    rest, whole = plant.rest, np.ones(1)
    for g in range(drive.size):
        first, cold, done = kept[0], kept[1], 0.0
        rate = (drive[g] - first) / max(spans[g], _TINY_TIME)
        cuts = _cuts(kept[5], rate, parts[g], plant.by_rate) if plant.by_rate or parts[g] > 1 else whole
        for share in cuts:
            goal = drive[g] if share == 1.0 else first + share * (drive[g] - first)
            warm = warmth[g] if share == 1.0 else cold + share * (warmth[g] - cold)
            span, done = max((share - done) * spans[g], _TINY_TIME), share
            if not by_force:
                kept[2] = min(max(kept[2], goal), goal + plant.backlash)  # docs/model.md (59)
            target = goal if by_force else kept[2]
            if plant.swift:
                if not swept(plant, memory, by_force, target, span, rest, cone, room[5]) <= SWEEP.accepted:
                    return g
                continue
            weight = plant.pretension
            change, _ = balanced(plant, memory, by_force, target, weight, warm, span, rest, cone, room)
            if not change <= 1e3 * TOLERANCES.converged:
                return g
        kept[0], kept[1], kept[5] = drive[g], warmth[g], rate
        _record(plant, memory, by_force, rest[0], g, out)
        if profile.shape[0] > 0:
            profile[g] = memory.tension
    return drive.size


@njit(cache=True, nogil=True, error_model="numpy")
def _record(plant, memory, by_force, rest, g, out):
    """Write one sample into `out`."""
    tension, kept, last = memory.tension, memory.drive, memory.tension.size - 1
    out[0, g], out[1, g], out[2, g] = tension[0], tension[last], kept[0]
    if by_force:  # docs/model.md (59)
        shift = memory.displacement[0] + stretch_of(plant, 0, tension[0]) - rest
        lag = kept[3] + (kept[4] - shift) * plant.backlash / _TURN
        kept[3], kept[4] = min(max(lag, 0.0), plant.backlash), shift
        out[2, g] = shift - kept[3]
    if plant.load == 0.0:
        out[3, g] = memory.displacement[last - 1]
    else:
        out[3, g] = (tension[last] - plant.pretension) / plant.load
    out[4, g], out[5, g] = memory.slip[0], memory.slip[last - 1]
