"""What a step makes of the members of an ensemble, and what readings make of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tssgeom import core
from tssgeom.adapt.members import SETTINGS, Standing
from tssgeom.adapt.trailed_drive import TrailedDrive
from tssgeom.arrays import Matrix, Vector
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE

PROBES = 2
"""Members for each drive that show what an error of it does [1]; derived: one either way."""


class Stepped(NamedTuple):
    """What a step makes of members."""

    standing: Standing
    read: Matrix
    """[members, c] What each channel should read."""
    ends: Matrix
    """[members, 4 n] T_in, T_out [N], x_in, x_out [m] of each tendon."""
    joint: Any = None
    """Of a machine whose joint is given: where it is."""


class Compared(NamedTuple):
    """Readings beside what members expect."""

    reading: Vector
    """[c] With the drives where the members have them; NaN where it is not used."""
    variance: Vector
    """[c] Of its error."""
    beyond: Vector
    """[c] As in `FollowedRig`."""
    by_drive: Vector
    """[c] What errors of the drives do to the channels."""
    ends_by_drive: Vector
    """[4 n] The same of the ends."""


class Taken(NamedTuple):
    """What readings have made of the members."""

    values: Vector
    """[d] The numbers."""
    covariance: Matrix
    """[d, d] Of the members."""
    channels: Matrix
    """[c, 2] Mean and variance of what each channel should read."""
    ends: Matrix
    """[e, 2] The same of the ends, and of all else that is shifted."""
    compared: Compared
    innovation: Matrix
    """[c, 2] Readings less what was expected, and the variance of that."""


def with_probes(count: int, read: Sequence[float], errors: Sequence[float]) -> Matrix:
    """Return what drives read for so many members, and for those that show what errors of each do."""
    rows = np.full((count + PROBES * len(read), len(read)), read)
    for i, error in enumerate(errors):
        rows[count + PROBES * i : count + PROBES * (i + 1), i] += error, -error
    return rows


def compare(
    after: Stepped,
    given: Vector,
    drives: Sequence[TrailedDrive],
    noise_variance: Vector,
    read_behind: Callable[[int], Vector],
) -> Compared:
    """Compare what was read with what is expected; docs/model.md (251), (252).

    Parameters
    ----------
    after
        What a step made of the members, and then of those with errors of the drives.
    given, noise_variance
        [c] What was read, and the variance of its noise; NaN is nothing.
    drives
        They; it is taken in whether each has turned.
    read_behind
        What each channel should read of a member whose drive of this number has turned [c].
    """
    reading, variance, off, greatest, farthest, lowest, *by_drive = _compared(
        after, given, drives, noise_variance
    )
    for i, (one, as_if) in enumerate(zip(drives, lowest.tolist(), strict=True)):
        one.weigh(as_if)
        if one.turn_probability > 0.5:
            behind = np.maximum(farthest[i], np.abs(read_behind(i) - after.read[0]))
            greatest += behind**2 - farthest[i] ** 2
    if any(one.may_have_turned for one in drives):
        reading[:] = math.nan
    return Compared(reading, variance, np.abs(off) / np.sqrt(greatest), *by_drive)


def compare_turned(
    before: Compared,
    held: Stepped,
    after: Stepped,
    drives: Sequence[tuple[TrailedDrive, float]],
    noise_variance: Vector,
) -> Compared:
    """Return what errors of drives do that have turned as far as is given with each; docs/model.md (306)."""
    none = np.full(len(before.reading), math.nan)
    *_, by_drive, ends_by_drive = _compared(after, none, [one for one, _ in drives], noise_variance)
    share = min(math.hypot(*(one.error / max(back, one.error) for one, back in drives if back)), 1.0)
    by_drive = np.maximum(by_drive, share * np.abs(after.read[0] - held.read[0]))
    ends_by_drive = np.maximum(ends_by_drive, share * np.abs(after.ends[0] - held.ends[0]))
    return before._replace(
        by_drive=np.hypot(before.by_drive, by_drive),
        ends_by_drive=np.hypot(before.ends_by_drive, ends_by_drive),
    )


def _compared(
    after: Stepped, given: Vector, drives: Sequence[TrailedDrive], noise_variance: Vector
) -> tuple[NDArray[np.float64], ...]:
    return core.compare_readings(
        len(after.read) - PROBES * len(drives),
        after.read,
        after.ends,
        given,
        noise_variance,
        np.array([(one.off, one.share, one.way) for one in drives], dtype=np.float64),
        PLAUSIBLE.negligible,
        SETTINGS.bent,
    )
