"""What the sensors of a rig read: gains, zeros, crosstalk, lags; docs/model.md (61), (62)."""

from collections.abc import Mapping
from typing import Literal, TypeAlias, get_args

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Vector
from tssgeom.effects import Channel, Setup
from tssgeom.errors import SettingsError

CHANNELS: tuple[Channel, ...] = get_args(Channel)
"""What sensors read of a run."""
Drive = Literal["tension_in_N", "displacement_in_m"]
Lags: TypeAlias = Mapping[Channel, tuple[float, float]]
"""Last true value and last reading of each lagging channel; empty before the first sample."""


def check_drive(setup: Setup, drive: Drive) -> None:
    """Refuse a drive whose own channel lags: what it reads is what drives.

    Raises
    ------
    SettingsError
        Where it does.
    """
    for channel, _ in setup.lags:
        if channel == drive:
            raise SettingsError(f"effects.channel_lag: {channel} is the drive; give a channel that responds")


def err(setup: Setup) -> bool:
    """Whether any sensor reads another value than the true one."""
    gains = (setup.tension_in_gain, setup.tension_out_gain)
    zeros = (setup.tension_in_offset_N, setup.tension_out_offset_N, setup.crosstalk)
    return gains != (1.0, 1.0) or any(zeros) or bool(setup.lags)


def true_drive(setup: Setup, drive: Drive, given: Vector) -> Vector:
    """Return what the drive did [n], from what its sensor read; docs/model.md (61)."""
    if drive != "tension_in_N":
        return given
    if setup.tension_in_gain != 1.0 or setup.tension_in_offset_N != 0.0:
        given = (given - setup.tension_in_offset_N) / setup.tension_in_gain
    return np.maximum(given, 0.0)


def sensed(setup: Setup, out: Matrix) -> dict[str, Vector]:
    """Return what sensors without lag read of T_in, T_out [N], x_in, x_out [m], the rows of `out`; (61)."""
    return {
        "tension_in_N": out[0] * setup.tension_in_gain + setup.tension_in_offset_N,
        "tension_out_N": (out[1] + setup.crosstalk * out[0]) * setup.tension_out_gain
        + setup.tension_out_offset_N,
        "elongation_m": out[2] - out[3],
        "displacement_in_m": out[2],
        "displacement_out_m": out[3],
    }


def with_lags(
    setup: Setup, channels: Mapping[str, Vector], spans: Vector, before: Lags
) -> tuple[dict[str, Vector], Lags]:
    """Let the lagging channels lag, and return with them their last values; docs/model.md (62)."""
    read, lags = dict(channels), dict[Channel, tuple[float, float]]()
    for channel, lag in setup.lags:
        value = channels[channel]
        first = float(value[0])
        if lag > 0.0:
            read[channel] = core.lagged(value, spans, lag, *before.get(channel, (first, first)))
        lags[channel] = (float(value[-1]), float(read[channel][-1]))
    return read, lags
