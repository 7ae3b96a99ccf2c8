"""Messages and files of a rig that is followed: alerts on stderr, the rig in a file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from time import monotonic

from pipelines.live.processes import SideProcess, send
from tssgeom.adapt.alert import Alert
from tssgeom.adapt.follower import Follower
from tssgeom.stream import FrameResult

_RIG_INTERVAL = 60.0  # s between two rigs to write; stated


@dataclass(slots=True)
class RigFeed:
    """Sends the rig that is followed to the process that writes it."""

    process: SideProcess
    follower: Follower
    _due: float = field(default_factory=lambda: monotonic() + _RIG_INTERVAL)
    _time: float | None = None
    """Of the last frame since the rig was sent [s]."""

    def take(self, result: FrameResult, now: float) -> None:
        """Take in a frame after its answer."""
        self._time = result.frame.time
        if now >= self._due:
            self._send()
            self._due = now + _RIG_INTERVAL

    def flush(self) -> None:
        """Do nothing: a rig is written each minute, and at the end."""

    def finish(self) -> None:
        """Send the last rig."""
        self._send()

    def _send(self) -> None:
        known = self.follower.known
        if known is None or self._time is None:
            return
        numbers = zip(known.keys, known.values.tolist(), known.se.tolist(), strict=True)
        lines = [
            f"followed by tssgeom live --adapt until {self._time:.3f} s; value ± standard error:",
            *(f"{key} = {value:.6g} ± {error:.2g}" for key, value, error in numbers),
        ]
        send([self.process], "rig", (self.follower.rig, lines))
        self._time = None


@dataclass(slots=True)
class AlertReport:
    """Says on stderr when an alert begins, when its mechanism is named or changes, and when it ends."""

    report: Callable[[str], object]
    _last: Alert | None = None

    def take(self, result: FrameResult, now: float) -> None:
        """Take in a frame after its answer."""
        before, alert = self._last, result.alert
        if alert is before:
            return
        self._last = alert
        if (sentence := alert_sentence(before, alert)) is not None:
            self.report(sentence)

    def flush(self) -> None:
        """Do nothing: alerts are reported at once."""

    def finish(self) -> None:
        """Do nothing."""


def alert_sentence(before: Alert | None, alert: Alert | None) -> str | None:
    """Return the message where an alert is another than before; else None."""
    if alert is None:
        return None if before is None else f"alert: {before.channel} agrees with the model again"
    if before is not None and (before.channel, before.mechanism) == (alert.channel, alert.mechanism):
        return None
    return f"alert: {alert.sentence}"
