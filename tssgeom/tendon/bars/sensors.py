"""What the sensors of a rig read: gains, zeros, crosstalk, play, lags, a late recorder.

Source: docs/model.md (61), (62), (319), (353).
"""

from collections.abc import Mapping
from typing import Literal, TypeAlias, get_args

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Vector
from tssgeom.effects import Channel, Setup
from tssgeom.effects.kinds import DISTAL
from tssgeom.effects.laws import SensorOver, curve_at
from tssgeom.errors import SettingsError

CHANNELS: tuple[Channel, ...] = get_args(Channel)
"""What sensors read of a run."""
Drive = Literal["tension_in_N", "displacement_in_m"]
Lags: TypeAlias = Mapping[Channel, tuple[float, ...]]
"""Last value and last reading of each channel that lags, has play or is recorded late, of the last
also age [s] and value of what is still to be read, the oldest first; empty before the first sample."""
_BEHIND_PLAY: tuple[Channel, ...] = ("displacement_out_m", "elongation_m")


def check_drive(setup: Setup, drive: Drive) -> None:
    """Refuse a drive whose own channel lags or drifts: of a stream, only recorded runs can be mended.

    Raises
    ------
    SettingsError
        Where it does.
    """
    for channel, _ in setup.lags:
        if channel == drive:
            raise SettingsError(f"effects.channel_lag: {channel} is the drive; give a channel that responds")
    if any(curve.table in (f"{drive} over time", f"{drive} over time_gain") for curve in setup.curves):
        raise SettingsError(f"effects.sensor_law: {drive} is the drive; over time it is for measured runs")


def err(setup: Setup) -> bool:
    """Whether any sensor reads another value than the true one."""
    gains = (setup.tension_in_gain, setup.tension_out_gain)
    zeros = (setup.tension_in_offset_N, setup.tension_out_offset_N, setup.crosstalk)
    laws = any(" over " in curve.table for curve in setup.curves)
    return gains != (1.0, 1.0) or any(zeros) or has_history(setup) or laws


def has_history(setup: Setup) -> bool:
    """Whether any sensor reads what depends on what it read before."""
    return bool(setup.lags) or setup.load_play_m > 0.0 or setup.distal_delay_s > 0.0


def true_drive(
    setup: Setup, drive: Drive, given: Vector, elapsed: Vector, spans: Vector, before: Lags
) -> tuple[Vector, Lags]:
    """Return what the drive did [n], from what its sensor read, and its last reading.

    Source: docs/model.md (61), (188).

    Parameters
    ----------
    setup
        The rig.
    drive, given
        The channel and its readings [n] [N] or [m].
    elapsed, spans
        Time since the run began, and since the sample before [n] [s].
    before
        Last true value and reading of lagging channels.
    """
    true, lags = given, dict[Channel, tuple[float, ...]]()
    for channel, lag in setup.lags:
        if channel == drive:
            last = np.concatenate(([before.get(channel, (given[0], given[0]))[1]], given[:-1]))
            true = given + lag * (given - last) / spans
            lags[channel] = (float(true[-1]), float(given[-1]))
    true = (true - _drift(setup, drive, elapsed)) / (1.0 + _drift(setup, drive, elapsed, "time_gain"))
    if drive == "tension_in_N" and (setup.tension_in_gain != 1.0 or setup.tension_in_offset_N != 0.0):
        true = (true - setup.tension_in_offset_N) / setup.tension_in_gain
    true = unbent(setup, drive, true)
    return (np.maximum(true, 0.0) if drive == "tension_in_N" else true), lags


def unbent(setup: Setup, drive: Channel, reading: Vector) -> Vector:
    """Return the true values [n] of readings by a law of a sensor over its true value; (188)."""
    true = reading
    if any(curve.table == f"{drive} over reading" for curve in setup.curves):
        for _ in range(_INVERSIONS):
            true = reading - bend(setup, drive, true)
    return true


_INVERSIONS = 6  # derived: an error that changes by a tenth of the reading is inverted to one in 1e6


def bend(setup: Setup, channel: str, true: Vector) -> Vector:
    """Return what a channel reads beside the truth by its true value [n]; docs/model.md (188)."""
    curves = [curve for curve in setup.curves if curve.table == f"{channel} over reading"]
    return sum((curve_at(curve, true) for curve in curves), np.zeros_like(true))


def _drift(setup: Setup, channel: str, elapsed: Vector, over: SensorOver = "time") -> Vector:
    """Return by how much zero [N, m] or gain [1] of a channel is off [n]; docs/model.md (188), (344)."""
    curves = [curve for curve in setup.curves if curve.table == f"{channel} over {over}"]
    return sum((curve_at(curve, elapsed) for curve in curves), np.zeros_like(elapsed))


def sensed(setup: Setup, out: Matrix, elapsed: Vector) -> dict[str, Vector]:
    """Return what sensors without lag read of T_in, T_out [N], x_in, x_out [m], the rows of `out` [4, n].

    `elapsed` [n] is the time since the run began [s]. Source: docs/model.md (61), (188).
    """
    read: dict[str, Vector] = {
        "tension_in_N": out[0] * setup.tension_in_gain + setup.tension_in_offset_N,
        "tension_out_N": (out[1] + setup.crosstalk * out[0]) * setup.tension_out_gain
        + setup.tension_out_offset_N,
        "elongation_m": out[2] - out[3],
        "displacement_in_m": out[2],
        "displacement_out_m": out[3],
    }
    if not setup.curves:
        return read
    ends: tuple[Channel, ...] = ("tension_in_N", "tension_out_N", "displacement_in_m", "displacement_out_m")
    true: dict[str, Vector] = dict(zip(ends, out[:4], strict=True))
    true["elongation_m"] = out[2] - out[3]
    for channel in {curve.table.partition(" over ")[0] for curve in setup.curves} & true.keys():
        read[channel] = read[channel] + bend(setup, channel, true[channel]) + _drift(setup, channel, elapsed)
        read[channel] = read[channel] + _drift(setup, channel, elapsed, "time_gain") * true[channel]
    return read


def with_histories(
    setup: Setup, channels: Mapping[str, Vector], spans: Vector, before: Lags, drive: Drive | None = None
) -> tuple[dict[str, Vector], Lags]:
    """Let channels that have play or lag do so, but not the drive; return their last values too.

    Source: docs/model.md (62), (319), (353).
    """
    read, lags, lag_of = dict(channels), dict[Channel, tuple[float, ...]](), dict(setup.lags)
    late = DISTAL if setup.distal_delay_s > 0.0 else ()
    if setup.load_play_m > 0.0:
        way = channels["displacement_out_m"]
        open_, (kept, *_) = setup.load_play_open_m, before.get("displacement_out_m", (float(way[0]),))
        lost = way - (play(way, setup.load_play_m, kept + open_) - open_)  # docs/model.md (334)
        read |= {"displacement_out_m": way - lost, "elongation_m": channels["elongation_m"] + lost}
        lag_of = dict.fromkeys(_BEHIND_PLAY, 0.0) | lag_of
    for channel, lag in (dict.fromkeys(late, 0.0) | lag_of).items():
        if channel == drive:
            continue
        value, last, past = read[channel], before.get(channel, ()), ()
        if lag > 0.0:
            ends = (last[0], last[-1]) if last else (float(value[0]),) * 2
            read[channel] = core.lagged(value, spans, lag, *ends)
        if channel in late:
            read[channel], past = _delayed(read[channel], spans, setup.distal_delay_s, last)
        lags[channel] = (float(value[-1]), float(read[channel][-1]), *past)
    return read, lags


def _delayed(
    values: Vector, spans: Vector, delay: float, before: tuple[float, ...]
) -> tuple[Vector, tuple[float, ...]]:
    """Return what a late recorder reads [n], and ages and values that it has still to read; (353)."""
    past = np.array(before[2:] or (0.0, *before[1:]) if before else ()).reshape(-1, 2)
    elapsed = np.cumsum(spans)
    time, known = np.concatenate((-past[:, 0], elapsed)), np.concatenate((past[:, 1], values))
    first = max(int(np.searchsorted(time, elapsed[-1] - delay, "right")) - 1, 0)
    left = np.column_stack((elapsed[-1] - time[first:], known[first:]))
    return np.interp(elapsed - delay, time, known), tuple(left.ravel().tolist())


def recorded_late(time: Vector, values: Vector, delay: float) -> Vector:
    """Return what a recorder that is late [s] reads at these times [n], NaN where there is none; (353)."""
    if delay == 0.0:
        return values
    there = np.isfinite(time) & np.isfinite(values)
    read, elapsed = np.full(len(values), np.nan), time[there]
    read[there] = np.interp(elapsed - delay, np.maximum.accumulate(elapsed), values[there])
    return read


def play(values: Vector, width: float, engaged: float | None = None) -> Vector:
    """Return what a play leaves of a motion [n]; docs/model.md (59).

    It was `engaged` before, or is so for positive motion at the start.
    """
    if width <= 0.0:
        return values
    passed, at = list[float](), float(values[0]) if engaged is None else engaged
    for value in values.tolist():  # as `behind_play`, without a call for each sample
        at = value if at < value else at if at < value + width else value + width
        passed.append(at)
    return np.array(passed)


def behind_play(position: Vector | float, width: Vector | float, before: Vector | float) -> Vector:
    """Return positions [n] behind a play that stood `before` [n], NaN at the begin; docs/model.md (59)."""
    before = np.where(np.isnan(before), position, before)
    return np.minimum(np.maximum(before, position), position + width)
