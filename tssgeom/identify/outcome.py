"""Before and after: the runs as measured and as two models see them, and the gap that each leaves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.identify.base_fit import posed
from tssgeom.identify.finding import PHASES, Gap, Trace
from tssgeom.identify.noise_model import telling, total_sigma
from tssgeom.identify.phases import phases
from tssgeom.identify.problem import Point
from tssgeom.identify.readings import Reading
from tssgeom.identify.stack import FINE, stacked
from tssgeom.rig import Rig
from tssgeom.tendon.bars.model import Model, RunTrace, begin, carry_on, prepare


@dataclass(frozen=True, slots=True)
class Seen:
    """A run as one model sees it."""

    channels: Mapping[str, Vector]
    slip_out: Vector
    tension: Matrix
    """[n, nodes of the route] [N]; no rows where it was not asked for."""


def seen(reading: Reading, rig: Rig, at: Point, *, profile: bool = False) -> Seen:
    """Return what a model makes of a run, with bars fine enough to be taken as exact."""
    model = prepare(
        reading.given, reading.route.arcs, at.rig(rig), at.effects, drive=reading.drive, bars=FINE
    )
    trace, _ = carry_on(model, begin(model), reading.given, profile=profile)
    tension = _on_nodes(model, trace, reading.route.s) if profile else np.zeros((0, len(reading.route.s)))
    return Seen({name: trace.channels[name] for name in reading.measured}, trace.slip_out, tension)


def _on_nodes(model: Model, trace: RunTrace, s: Vector) -> Matrix:
    """Return tension at the nodes of a route [n, nodes], between the middles of the bars."""
    middle = np.concatenate(([0.0], 0.5 * (model.edge[1:] + model.edge[:-1]), [1.0]))
    share = s / s[-1]
    right = np.clip(np.searchsorted(middle, share), 1, len(middle) - 1)
    weight = (share - middle[right - 1]) / (middle[right] - middle[right - 1])
    return trace.tension[:, right - 1] * (1.0 - weight) + trace.tension[:, right] * weight


def traces(readings: Sequence[Reading], rig: Rig, before: Point, after: Point) -> tuple[Trace, ...]:
    """Return every run with what the base model and the better one make of it."""
    _, errors = posed(stacked(readings), rig, after)
    sigma = stacked(readings).split(total_sigma(errors))
    return tuple(_trace(reading, rig, (before, after), sigma[k]) for k, reading in enumerate(readings))


def _trace(reading: Reading, rig: Rig, models: tuple[Point, Point], sigma: Mapping[str, Vector]) -> Trace:
    old, new = (seen(reading, rig, at, profile=at is models[1]) for at in models)
    tension_in = new.channels.get("tension_in_N", reading.given.get("tension_in_N", new.tension[:, 0]))
    return Trace(
        run=reading.name,
        route=reading.route.name,
        held_out=reading.held_out,
        time=reading.time,
        phase=phases(reading, new.slip_out),
        tension_in=read_only(tension_in),
        measured=dict(reading.measured),
        before=dict(old.channels),
        after=dict(new.channels),
        sigma=dict(sigma),
        tension=read_only(new.tension),
    )


def gap_of(told: Sequence[Trace]) -> Gap:
    """Return root mean squares of measured less simulated, by channel and phase."""
    fitted = [trace for trace in told if not trace.held_out]
    held = [trace for trace in told if trace.held_out]
    shown = held or fitted
    return Gap(
        noise={name: _rms(told, name, "sigma") for name in _channels(told)},
        before={"fitted": _left(fitted, "before"), "held_out": _left(held, "before")},
        after={"fitted": _left(fitted, "after"), "held_out": _left(held, "after")},
        by_phase={name: _by_phase(shown, name) for name in _channels(shown)},
    )


def _channels(told: Sequence[Trace]) -> list[str]:
    return list(dict.fromkeys(name for trace in told for name in trace.measured))


def _left(told: Sequence[Trace], which: str) -> dict[str, float]:
    return {name: _rms(told, name, which) for name in _channels(told)}


def _parts(told: Sequence[Trace], name: str, which: str) -> list[Vector]:
    parts = []
    for trace in told:
        if name in trace.measured:
            value = getattr(trace, which)[name]
            left = value if which == "sigma" else trace.measured[name] - value
            parts.append(np.where(telling(trace.sigma[name]), left, np.nan))
    return parts


def _rms(told: Sequence[Trace], name: str, which: str) -> float:
    return float(np.sqrt(np.nanmean(np.square(np.concatenate(_parts(told, name, which))))))


def _by_phase(told: Sequence[Trace], name: str) -> dict[str, tuple[float, float]]:
    phase = np.concatenate([trace.phase for trace in told if name in trace.measured])
    both = [np.square(np.concatenate(_parts(told, name, which))) for which in ("before", "after")]
    out = {}
    for k, title in enumerate(PHASES):
        inside = (phase == k) & np.isfinite(both[0])
        if inside.any():
            out[title] = tuple(float(np.sqrt(np.mean(part[inside]))) for part in both)
    return out
