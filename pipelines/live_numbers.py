"""The numbers of a stream: rate, latency, what was dropped and rejected, and the last good answer."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from time import monotonic
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from tssgeom.stream import FrameResult

_MOST_LATENCIES = 100_000


@dataclass(slots=True)
class Numbers:
    """Counts since the start, and latencies since they were last told."""

    answered: int = 0
    rejected: int = 0
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
        if len(self.latencies) < _MOST_LATENCIES:
            self.latencies.append(latency_us)

    def told(self, counts: dict[str, int]) -> dict[str, Any]:
        """Return all numbers, with further counts, and begin the next interval."""
        now = monotonic()
        rate = len(self.latencies) / max(now - self._since, 1e-9)
        middle, high = np.percentile(self.latencies, (50, 99)) if self.latencies else (math.nan, math.nan)
        self.latencies.clear()
        self._since = now
        found: dict[str, Any] = {
            "rate_hz": round(rate, 1),
            "latency_p50_us": None if math.isnan(middle) else round(float(middle), 1),
            "latency_p99_us": None if math.isnan(high) else round(float(high), 1),
            "answered": self.answered,
            "rejected": self.rejected,
            **counts,
            "stale": self.stale,
        }
        return found if self.last is None else found | _last(self.last)


def _last(result: FrameResult) -> dict[str, Any]:
    seen = result.transmission
    return {
        "t": result.frame.time,
        "total_angle_rad": result.arcs.total_angle,
        "tension_out_N": seen.tension_out,
        "elongation_m": seen.elongation,
    }


class StatusLine:
    """One line on a terminal that is written over and over."""

    def __init__(self) -> None:
        self._console = Console(stderr=True, highlight=False)

    def show(self, numbers: dict[str, Any]) -> None:
        """Write the numbers over the line before."""
        self._console.print(status_text(numbers), end="\r", overflow="crop", no_wrap=True, crop=True)

    def close(self) -> None:
        """Leave the last line as it is."""
        self._console.print()


def status_text(numbers: dict[str, Any]) -> Text:
    """Return the status line of some numbers."""
    text = Text()
    if "t" in numbers:
        angle, tension = math.degrees(numbers["total_angle_rad"]), numbers["tension_out_N"]
        text.append(f"Φ {angle:.1f}° T_out {tension:.2f} N δ {1e3 * numbers['elongation_m']:.3f} mm", "cyan")
    if numbers["stale"]:
        text.append(" | stale", "bold red")
    else:
        text.append(f" | {numbers['rate_hz']:.0f} Hz", "bold")
    if numbers["latency_p50_us"] is not None:
        middle, high = 1e-3 * numbers["latency_p50_us"], 1e-3 * numbers["latency_p99_us"]
        text.append(f" {middle:.2f}/{high:.2f} ms")
    text.append(f" | dropped {numbers['dropped']} rejected {numbers['rejected']}")
    return text
