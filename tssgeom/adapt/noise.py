"""Noise that is assumed of sensors whose rig states none."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import msgspec

from tssgeom.plausibility.limits import LIMITS
from tssgeom.rig import Rig, Sensor


class AssumedNoise(NamedTuple):
    """Noise of a channel by its unit. Chosen: as of coarse load cells and encoders of a laboratory."""

    m: float = 2e-5
    """Of a position or an elongation [m]."""
    rad: float = 1e-3
    """Of an angle [rad]."""
    Nm: float = 1e-3
    """Of a torque [N·m]."""
    A: float = 0.01
    """Of a current [A]."""

    @property
    def N(self) -> float:  # noqa: N802 - the unit
        """Of a tension [N]."""
        return LIMITS.weakest_N


_ASSUMED = AssumedNoise()


def assumed_noise(channel: str) -> float:
    """Return the noise that is assumed of a channel, in its unit."""
    return getattr(_ASSUMED, channel.rpartition("_")[2])


def with_noise(rig: Rig, channels: Iterable[str]) -> tuple[Rig, frozenset[str]]:
    """Return a rig with a noise for each channel, and the channels for which it is assumed."""
    stated = rig.sensors
    lacking = {
        name for name in channels if name not in stated or not (stated[name].noise or stated[name].resolution)
    }
    assumed = {
        name: msgspec.structs.replace(stated.get(name, Sensor()), noise=assumed_noise(name))
        for name in lacking
    }
    return msgspec.structs.replace(rig, sensors={**stated, **assumed}), frozenset(lacking)
