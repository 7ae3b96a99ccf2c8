"""The statistics of a stream: rate, latency, counts of dropped and rejected frames, the last good answer."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from time import monotonic
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from tssgeom.stream import FrameResult

_MOST_LATENCIES = 100_000  # kept in one interval; chosen: a hundred times what a stream can answer


@dataclass(slots=True)
class Statistics:
    """Counts since the start, and latencies since the last report."""

    answered: int = 0
    rejected: int = 0
    last_reason: str = ""
    """Of the last frame that was rejected."""
    undriven: bool = False
    """Whether any frame brought neither a drive nor a target."""
    stale: bool = False
    last: FrameResult | None = None
    latencies: list[float] = field(default_factory=list)
    """From the last byte of a frame until its answer was sent [µs]."""
    _since: float = field(default_factory=monotonic)

    def begin(self) -> None:
        """Begin the first interval."""
        self._since = monotonic()

    def add(self, result: FrameResult, latency_us: float) -> None:
        """Count an answered frame."""
        self.answered += 1
        self.last, self.stale = result, False
        self.undriven = self.undriven or not result.frame.drives_tendon
        if len(self.latencies) < _MOST_LATENCIES:
            self.latencies.append(latency_us)

    def reject(self, reason: str) -> None:
        """Count a rejected frame."""
        self.rejected += 1
        self.last_reason = reason

    def over_interval(self, counts: dict[str, int]) -> dict[str, Any]:
        """Return all statistics, with further counts, and begin the next interval."""
        now = monotonic()
        rate = len(self.latencies) / max(now - self._since, 1e-9)
        median, high = np.percentile(self.latencies, (50, 99)) if self.latencies else (math.nan, math.nan)
        self.latencies.clear()
        self._since = now
        report: dict[str, Any] = {
            "rate_hz": round(rate, 1),
            "latency_p50_us": None if math.isnan(median) else round(float(median), 1),
            "latency_p99_us": None if math.isnan(high) else round(float(high), 1),
            "answered": self.answered,
            "rejected": self.rejected,
            **counts,
            "stale": self.stale,
        }
        return report if self.last is None else report | _last(self.last)


def _last(result: FrameResult) -> dict[str, Any]:
    transmission = result.transmission
    return {
        "t": result.frame.time,
        "total_angle_rad": result.arcs.total_angle,
        "tension_out_N": transmission.tension_out,
        "elongation_m": transmission.elongation,
    }


class StatusLine:
    """One line on a terminal that is written over and over."""

    def __init__(self) -> None:
        self._console = Console(stderr=True, highlight=False)

    def show(self, statistics: dict[str, Any]) -> None:
        """Write the statistics over the line before."""
        self._console.print(status_text(statistics), end="\r", overflow="crop", no_wrap=True, crop=True)

    def close(self) -> None:
        """Leave the last line as it is."""
        self._console.print()


def status_text(statistics: dict[str, Any]) -> Text:
    """Return the status line for statistics."""
    text = Text()
    if "t" in statistics:
        angle, tension = math.degrees(statistics["total_angle_rad"]), statistics["tension_out_N"]
        text.append(
            f"Φ {angle:.1f}° T_out {tension:.2f} N δ {1e3 * statistics['elongation_m']:.3f} mm", "cyan"
        )
    if statistics["stale"]:
        text.append(" | stale", "bold red")
    else:
        text.append(f" | {statistics['rate_hz']:.0f} Hz", "bold")
    if statistics["latency_p50_us"] is not None:
        median, high = 1e-3 * statistics["latency_p50_us"], 1e-3 * statistics["latency_p99_us"]
        text.append(f" {median:.2f}/{high:.2f} ms")
    text.append(f" | dropped {statistics['dropped']} rejected {statistics['rejected']}")
    return text
