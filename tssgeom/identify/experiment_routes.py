"""Routes on which the next run may be made, and how far the drive may go on each.

Source: docs/discovery.md, "Designed experiments".
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.errors import TssgeomError
from tssgeom.identify.campaign import Route
from tssgeom.identify.candidate_models import CandidateModel
from tssgeom.identify.prediction import run_channels
from tssgeom.identify.readings import Reading
from tssgeom.identify.run_limits import RunLimits
from tssgeom.identify.ties import OTHER_ROUTES
from tssgeom.identify.waveform import Range
from tssgeom.rig import Rig

_RAMP = 120  # samples of the slow stroke by which a range is computed; chosen
_SPAN = 100.0  # standard deviations of the drive that a range exceeds; chosen: turns and legs need some
_TRIALS = 40  # strokes until the limit of tension is met; chosen


@dataclass(frozen=True, slots=True, eq=False)
class RouteChoice:
    """One route of an experiment."""

    route: Route
    words: str
    """How to bend the sheath; empty for a route of the campaign."""
    run: str
    """A run of the campaign on that route; of a new route, on the one that it is made from."""


def own_routes(runs: Sequence[Reading]) -> list[RouteChoice]:
    """Return the routes of the runs, each once."""
    out: dict[str, RouteChoice] = {}
    for run in runs:
        out.setdefault(run.route.name, RouteChoice(run.route, "", run.name))
    return list(out.values())


def other_routes(runs: Sequence[Reading]) -> list[RouteChoice]:
    """Return what the sheath of the first run could be bent to."""
    first = runs[0]
    return [
        RouteChoice(replace(first.route, name=words, arcs=bent(first.route.arcs)), words, first.name)
        for words, bent in OTHER_ROUTES
    ]


@dataclass(frozen=True, slots=True)
class SlowStroke:
    """A slow pull and release on a route by one model, by which a range is computed."""

    route: Route
    template: Reading
    """A run with the drive, the channels and the temperature of the next."""
    rig: Rig
    model: CandidateModel
    limits: RunLimits

    def ranges(self) -> Iterator[Range]:
        """Yield how far the drive may go; nothing where a limit leaves it no room."""
        limits, drive = self.limits, self.template.drive
        long = {"duration": limits.duration_s, "interval": limits.interval_s, "samples": limits.samples}
        rest = self.rig.tendon.pretension_N
        high = self._highest()
        span = _SPAN * self.template.noise[drive]
        if drive == "tension_in_N":
            if high > rest + span:
                give = self._travel(high) / (high - rest)
                speed = 1e-3 * limits.speed_mm_per_s / give
                yield Range(rest, min(limits.least_tension_N, rest), high, speed=speed, **long)
        elif high > span:
            yield Range(0.0, self._lowest(high), high, speed=1e-3 * limits.speed_mm_per_s, **long)

    def _highest(self) -> float:
        """Return the drive at which a slow pull meets the limit of tension or of travel [m or N]."""
        limits, rest = self.limits, self.rig.tendon.pretension_N
        if self.template.drive == "tension_in_N":
            high = limits.tension_N
            for _ in range(_TRIALS):
                if self._travel(high) <= 1e-3 * limits.travel_mm:
                    break
                high = rest + 0.8 * (high - rest)
            return high
        position = np.linspace(0.0, 1e-3 * limits.travel_mm, _RAMP)
        within = np.flatnonzero(self._pulled(position, "tension_in_N") <= limits.tension_N)
        return float(position[within[-1]]) if len(within) else 0.0

    def _lowest(self, high: float) -> float:
        """Return the position at which a slow release from the highest meets the least tension [m]."""
        back = np.linspace(high, -high, _RAMP)
        position = np.concatenate([np.linspace(0.0, high, _RAMP)[:-1], back])
        tension = self._pulled(position, "tension_in_N")[_RAMP - 1 :]
        within = np.flatnonzero(tension >= self.limits.least_tension_N)
        return max(float(back[within[-1]]) if len(within) else 0.0, -1e-3 * self.limits.travel_mm)

    def _travel(self, tension: float) -> float:
        """Return how far the drive goes in a slow pull to some tension [m]."""
        ramp = np.linspace(self.rig.tendon.pretension_N, tension, _RAMP)
        return float(np.abs(self._pulled(ramp, "displacement_in_m")).max())

    def _pulled(self, drive: Vector, channel: str) -> Vector:
        """Return a channel of a slow stroke; infinite from where the model has no equilibrium."""
        time = np.linspace(0.0, self.limits.duration_s, len(drive))
        given = {"time_s": time, self.template.drive: drive}
        if "temperature_C" in self.template.given:
            given["temperature_C"] = np.zeros(len(drive))
        reading = replace(self.template, route=self.route, given=given)
        try:
            return run_channels(reading, self.model.at.rig(self.rig), self.model.at.effects)[channel]
        except TssgeomError:
            return np.full(len(drive), np.inf)
