"""Routes on which the next run may be made, and how far the drive may go on each.

Source: docs/discovery.md, "Designed experiments".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tssgeom.errors import TssgeomError
from tssgeom.identify.campaign import Route
from tssgeom.identify.prediction import run_channels
from tssgeom.identify.readings import Reading
from tssgeom.identify.ties import OTHER_ROUTES
from tssgeom.identify.waveform import Range

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tssgeom.identify.experiment_search import Search

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


def ranges_of(search: Search, choice: RouteChoice) -> Iterator[Range]:
    """Yield how far the drive may go on a route; nothing where a limit leaves it no room."""
    limits, drive = search.limits, search.template.drive
    common = (limits.duration_s, limits.interval_s, limits.samples)
    rest = search.rig.tendon.pretension_N
    high = _highest(search, choice)
    span = _SPAN * search.template.noise[drive]
    if drive == "tension_in_N":
        if high > rest + span:
            give = _travel(search, choice, high) / (high - rest)
            speed = 1e-3 * limits.speed_mm_per_s / give
            yield Range(rest, min(limits.least_tension_N, rest), high, speed, *common)
    elif high > span:
        low = _lowest(search, choice, high)
        yield Range(0.0, low, high, 1e-3 * limits.speed_mm_per_s, *common)


def _highest(search: Search, choice: RouteChoice) -> float:
    """Return the drive at which a slow pull meets the limit of tension or of travel [m or N]."""
    limits, rest = search.limits, search.rig.tendon.pretension_N
    if search.template.drive == "tension_in_N":
        high = limits.tension_N
        for _ in range(_TRIALS):
            if _travel(search, choice, high) <= 1e-3 * limits.travel_mm:
                break
            high = rest + 0.8 * (high - rest)
        return high
    position = np.linspace(0.0, 1e-3 * limits.travel_mm, _RAMP)
    tension = _pulled(search, choice, position, "tension_in_N")
    within = np.flatnonzero(tension <= limits.tension_N)
    return float(position[within[-1]]) if len(within) else 0.0


def _lowest(search: Search, choice: RouteChoice, high: float) -> float:
    """Return the position at which a slow release from the highest meets the least tension [m]."""
    back = np.linspace(high, -high, _RAMP)
    position = np.concatenate([np.linspace(0.0, high, _RAMP)[:-1], back])
    tension = _pulled(search, choice, position, "tension_in_N")[_RAMP - 1 :]
    within = np.flatnonzero(tension >= search.limits.least_tension_N)
    return max(float(back[within[-1]]) if len(within) else 0.0, -1e-3 * search.limits.travel_mm)


def _travel(search: Search, choice: RouteChoice, tension: float) -> float:
    """Return how far the drive goes in a slow pull to some tension [m]."""
    ramp = np.linspace(search.rig.tendon.pretension_N, tension, _RAMP)
    return float(np.abs(_pulled(search, choice, ramp, "displacement_in_m")).max())


def _pulled(search: Search, choice: RouteChoice, drive: np.ndarray, channel: str) -> np.ndarray:
    """Return a channel of a slow stroke by the first model; infinite from where it has no equilibrium."""
    model = search.goal.models[0]
    time = np.linspace(0.0, search.limits.duration_s, len(drive))
    given = {"time_s": time, search.template.drive: drive}
    if "temperature_C" in search.template.given:
        given["temperature_C"] = np.zeros(len(drive))
    reading = replace(search.template, route=choice.route, given=given)
    try:
        return run_channels(reading, model.at.rig(search.rig), model.at.effects)[channel]
    except TssgeomError:
        return np.full(len(drive), np.inf)
