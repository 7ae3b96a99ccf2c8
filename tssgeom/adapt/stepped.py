"""What a step makes of the members of an ensemble, and what readings make of it."""

from __future__ import annotations

from typing import Any, NamedTuple

from tssgeom.adapt.members import Standing
from tssgeom.arrays import Matrix, Vector


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
