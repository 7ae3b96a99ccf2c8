"""Channels over the samples of all runs: measured, before, after ± 2σ, and what is left."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr

from tssgeom.arrays import Vector
from tssgeom.identify.finding import Finding, Trace
from tssgeom.identify.misfit import measured_channels
from tssgeom.view import colours
from tssgeom.view import finding_wording as words
from tssgeom.view.figures.finding import models
from tssgeom.view.quantities import TENSION_IN
from tssgeom.view.scene.columns import Sender

MOST_CHANNELS = 3
_SIGMAS = 2.0
_COLOURS = {"measured": colours.MEASURED, "before": colours.BEFORE, "after": colours.AFTER}


def plotted_channels(finding: Finding) -> list[str]:
    """Return the channels that are plotted, the one with the largest misfit before first."""
    misfit = finding.misfit
    reported = misfit.before[words.judged_runs(misfit)]
    known = [name for name in measured_channels(finding.traces) if name in reported]
    return sorted(known, key=lambda name: -reported[name] / misfit.noise[name])[:MOST_CHANNELS]


def send_lines(samples: Sender, finding: Finding) -> None:
    """Send the channel with the largest misfit, what is left of each, and the proximal tension."""
    traces = finding.traces
    pull = np.concatenate([trace.tension_in for trace in traces])
    _line(samples, "series/tension_in", "T_in of the model [N]", TENSION_IN.rgb, pull)
    channels = plotted_channels(finding)
    for order, when in enumerate(("measured", *models(finding))):
        values = words.channel(channels[0]).factor * column(traces, when, channels[0])
        _line(samples, f"channel/line_{order}", when, _COLOURS[when], values, 3.0 if order == 0 else 1.5)
    for name in channels:
        _send_left(samples, finding, name)


def _send_left(samples: Sender, finding: Finding, name: str) -> None:
    """Send measured less simulated, in the order in which the lines are drawn."""
    traces, factor = finding.traces, words.channel(name).factor
    spread = _SIGMAS * factor * column(traces, "sigma", name)
    _line(samples, f"left/{name}/line_0", "− 2σ of the sensors", colours.AXIS, -spread, 1.0)
    _line(samples, f"left/{name}/line_1", "+ 2σ of the sensors", colours.AXIS, spread, 1.0)
    for order, when in enumerate(models(finding), start=2):
        left = factor * (column(traces, "measured", name) - column(traces, when, name))
        _line(samples, f"left/{name}/line_{order}", when, _COLOURS[when], left, 1.5)


def column(traces: Sequence[Trace], when: str, name: str) -> Vector:
    """Return a channel over the samples of all runs [SI], NaN where a run lacks it."""
    parts = [getattr(trace, when).get(name, np.full(len(trace.time), np.nan)) for trace in traces]
    return np.concatenate(parts)


def _line(
    samples: Sender,
    entity: str,
    name: str,
    colour: tuple[int, int, int],
    values: Vector,
    width: float = 2.0,
) -> None:
    samples.constant(entity, rr.SeriesLines(names=name, colors=[colour], widths=[width]))
    samples.send(entity, rr.Scalars.columns(scalars=np.asarray(values, dtype=np.float64)))
