"""Figures of a run: what the distal end makes of the drive, and both against time."""

from __future__ import annotations

import itertools

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tssgeom.arrays import Vector
from tssgeom.view.figures.plots import BLUE, MEASURED, ORANGE, PAGE, panels, titles
from tssgeom.view.quantities import ELONGATION, TENSION_IN, TENSION_OUT, TIME, Quantity
from tssgeom.view.report.entry import Series
from tssgeom.view.samples import evenly

_HEIGHT = 2.4  # inch
_MOMENTS = 500
_STROKES = {1.0: ("pulling", BLUE), -1.0: ("releasing", ORANGE)}
_PALE = 0.25


def transmission_figure(run: Series) -> Figure:
    """Draw output tension and elongation over input tension, with their standard errors."""
    chosen = moments(run)
    across = run.tension_in[chosen]
    with panels((PAGE, _HEIGHT), 2) as (drawing, row):
        for axes, (told, value, error, measured) in zip(row, _answers(run), strict=True):
            _draw_strokes(axes, across, told.factor * value[chosen], told.factor * error[chosen])
            if measured is not None:
                _draw_measured(axes, across, told.factor * measured[chosen])
            titles(axes, f"{told.words.capitalize()} ± s.e.", TENSION_IN.title, told.title)
            axes.set_xlim(0.0, None)
            axes.set_ylim(min(0.0, axes.get_ylim()[0]), None)
        row[1].legend(loc="lower right")
    return drawing


def time_figure(run: Series) -> Figure:
    """Draw tensions and elongation against time, with their standard errors."""
    chosen = moments(run)
    time = run.time[chosen]
    with panels((PAGE, _HEIGHT), 2) as (drawing, (tension, stretch)):
        tension.plot(time, run.tension_in[chosen], color=TENSION_IN.ink, linewidth=1.1, label="T_in")
        for axes, (told, value, error, measured) in zip((tension, stretch), _answers(run), strict=True):
            middle, spread = told.factor * value[chosen], told.factor * error[chosen]
            axes.fill_between(
                time, middle - spread, middle + spread, color=told.ink, alpha=_PALE, linewidth=0
            )
            axes.plot(time, middle, color=told.ink, linewidth=1.1, label=told.symbol)
            if measured is not None:
                _draw_measured(axes, time, told.factor * measured[chosen])
        titles(tension, "Tension ± s.e. over time", TIME.title, "tension T [N]")
        titles(stretch, "Elongation ± s.e. over time", TIME.title, ELONGATION.title)
        tension.margins(y=0.2)
        tension.legend(loc="upper right", ncols=3, borderaxespad=0.0)
    return drawing


def moments(run: Series) -> np.ndarray:
    """Return the samples that are drawn: evenly chosen, and every turn of the drive."""
    turns = [edge for edge, _ in strokes(run.tension_in)]
    return np.union1d(evenly(len(run.time), _MOMENTS), np.array(turns[:_MOMENTS], dtype=np.intp))


def strokes(drive: Vector) -> list[tuple[int, int]]:
    """Cut a run where its drive turns: first and last sample of each pull and release."""
    way = np.sign(np.diff(drive))
    moving = np.flatnonzero(way)
    turns = moving[1:][way[moving][1:] != way[moving][:-1]]
    return list(itertools.pairwise([0, *turns.tolist(), len(drive) - 1])) if len(drive) > 1 else []


def _answers(run: Series) -> list[tuple[Quantity, Vector, Vector, Vector | None]]:
    return [
        (TENSION_OUT, run.tension_out, run.tension_out_se, run.tension_out_measured),
        (ELONGATION, run.elongation, run.elongation_se, run.elongation_measured),
    ]


def _draw_strokes(axes: Axes, across: Vector, value: Vector, error: Vector) -> None:
    """Draw pulls and releases in their colours; each has its name once."""
    named = set[float]()
    for begin, end in strokes(across):
        part = slice(begin, end + 1)
        way = 1.0 if across[end] >= across[begin] else -1.0
        name, colour = _STROKES[way]
        axes.fill_between(
            across[part],
            (value - error)[part],
            (value + error)[part],
            color=colour,
            alpha=_PALE,
            linewidth=0,
        )
        label = "_" if way in named else name
        axes.plot(across[part], value[part], color=colour, linewidth=1.2, label=label, zorder=3)
        named.add(way)


def _draw_measured(axes: Axes, across: Vector, value: Vector) -> None:
    axes.plot(
        across,
        value,
        zorder=2,
        **MEASURED,
    )
