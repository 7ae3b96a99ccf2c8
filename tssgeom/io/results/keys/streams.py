"""Objects of a stream that are no answers: statistics, and why a client is cut off."""

from __future__ import annotations

from typing import NotRequired, TypedDict


class StatisticsOf(TypedDict):
    """Statistics of the last second, on stderr with `--stats`."""

    rate_hz: float
    """Answers a second [1/s]."""
    latency_p50_us: float | None
    """Median latency until the answer is sent; null without an answer [µs]."""
    latency_p99_us: float | None
    """99th percentile of it [µs]."""
    answered: int
    """Good frames since the start [1]."""
    rejected: int
    """Bad frames since the start [1]."""
    dropped: int
    """Frames that were dropped for newer ones, since the start [1]."""
    unsent: int
    """Lines that a reader could not take, since the start [1]."""
    view_lost: NotRequired[int]
    """Messages that the view could not take, with `--view` [1]."""
    record_lost: NotRequired[int]
    """Messages that the recording could not take, with `--record` [1]."""
    save_lost: NotRequired[int]
    """States that the disk could not take, with `--state` [1]."""
    rig_lost: NotRequired[int]
    """Rigs that the disk could not take, with `--write-rig` [1]."""
    stale: bool
    """True where no good frame has come for a while."""
    t: NotRequired[float]
    """Time of the last good frame, and so for the keys below [s]."""
    total_angle_rad: NotRequired[float]
    """Accumulated curve angle Φ [rad]."""
    tension_out_N: NotRequired[float]
    """Tension at the distal end [N]."""
    elongation_m: NotRequired[float]
    """Elongation [m]."""


class Closed(TypedDict):
    """The last line to a client that is cut off."""

    closed: str
    """Why it is cut off."""
