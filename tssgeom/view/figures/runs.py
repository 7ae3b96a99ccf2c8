"""Figures of a run: tensions, elongation and curve angle over time, and what answers over what drives."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tssgeom.arrays import Vector
from tssgeom.view.figures.plots import BLUE, ORANGE, PAGE, figure, legend_below, measured, panels, titles
from tssgeom.view.quantities import ANGLE, ELONGATION, TENSION_IN, TENSION_OUT, TIME, Quantity, quantity
from tssgeom.view.report.entry import Series, moments, strokes
from tssgeom.view.samples import at_edge

_HEIGHT, _ROW = 2.4, 1.35  # inch; chosen: three rows and a legend fill half a page
_PALE = 0.25  # opacity of a standard error
_STROKES = {1.0: ("pulling", BLUE), -1.0: ("releasing", ORANGE)}


def transmission_figure(run: Series) -> Figure:
    """Draw output tension and elongation over input tension, with their standard errors."""
    with panels(_HEIGHT, 2) as (drawing, axes):
        for one, quantity in zip(axes, (TENSION_OUT, ELONGATION), strict=True):
            draw_over_drive(one, run, quantity)
        measured_too = [one for one in axes if "measured" in one.get_legend_handles_labels()[1]]
        legend_below(drawing, (measured_too or axes)[0])
    return drawing


def time_figure(run: Series) -> Figure:
    """Draw tensions, elongation and, of a route that moves, Φ over time, with standard errors."""
    quantities = (TENSION_OUT, ELONGATION) + (() if run.angle is None else (ANGLE,))
    with figure((PAGE, _ROW * len(quantities) + 0.5)) as drawing:
        rows = drawing.subplots(len(quantities), 1, sharex=True)
        for axes, quantity in zip(rows, quantities, strict=True):
            draw_over_time(axes, run, quantity)
            axes.set_xlabel(TIME.title if axes is rows[-1] else "")
        named = dict[str, Artist]()
        for axes in rows:
            named |= dict(zip(*axes.get_legend_handles_labels()[::-1], strict=True))
        drawing.legend(list(named.values()), list(named), loc="outside lower center", ncols=5)
        drawing.align_ylabels(rows.tolist())
    return drawing


def draw_over_drive(axes: Axes, run: Series, quantity: Quantity) -> Axes:
    """Draw T_out or δ over T_in, pulls and releases in their colours, measured values as circles."""
    chosen = moments(run)
    across = run.tension_in[chosen]
    value, error, observed = _of(run, quantity, chosen)
    _draw_strokes(axes, across, value, error)
    if observed is not None:
        measured(axes, across, observed)
    titles(axes, f"{quantity.words.capitalize()} ± s.e.", TENSION_IN.title, quantity.title)
    axes.set_xlim(0.0, None)
    axes.set_ylim(min(0.0, axes.get_ylim()[0]), None)
    return axes


def draw_over_time(axes: Axes, run: Series, quantity: Quantity) -> Axes:
    """Draw T_out (with T_in), δ or Φ over time, with its standard error, measured values as circles."""
    chosen = moments(run)
    time = run.time[chosen]
    value, error, observed = _of(run, quantity, chosen)
    if quantity is TENSION_OUT:
        axes.plot(time, run.tension_in[chosen], color=TENSION_IN.ink, linewidth=1.1, label="T_in")
    axes.fill_between(time, value - error, value + error, color=quantity.ink, alpha=_PALE, linewidth=0)
    axes.plot(time, value, color=quantity.ink, linewidth=1.2, label=quantity.symbol)
    if observed is not None:
        measured(axes, time, observed)
    title = "Tensions" if quantity is TENSION_OUT else quantity.words.capitalize()
    titles(
        axes,
        f"{title} ± s.e. over time",
        TIME.title,
        f"{'T' if quantity is TENSION_OUT else quantity.symbol} [{quantity.unit}]",
    )
    axes.set_xlim(time[0], time[-1])
    return axes


def draw_channels(
    axes: Axes, time: Vector, channels: Mapping[str, Vector], readings: Mapping[str, Vector]
) -> Axes:
    """Draw channels of one unit over time [s] as lines, and what was measured of them as circles."""
    names = list({**channels, **readings})
    for name in names:
        of = quantity(name)
        if name in channels:
            axes.plot(time, of.factor * channels[name], color=of.ink, linewidth=1.2, label=of.symbol)
        if name in readings:
            value, style = of.factor * readings[name], {"markeredgecolor": of.ink}
            measured(axes, time, value, label=f"{of.symbol} measured", **style)
    of = quantity(names[0])
    kind = of.title if len(names) == 1 else f"{of.words.rpartition(' ')[2]} [{of.unit}]"
    axes.legend()
    titles(axes, "", TIME.title, kind)
    return axes


def _of(run: Series, quantity: Quantity, chosen: Vector) -> tuple[Vector, Vector, Vector | None]:
    """Return value, standard error and, where there is one, measured value, in the unit of the picture."""
    columns = {
        "T_out": (run.tension_out, run.tension_out_se, run.tension_out_measured),
        "δ": (run.elongation, run.elongation_se, run.elongation_measured),
        "Φ": (run.angle, run.angle_se, None),
    }
    value, error, observed = (
        None if one is None else quantity.factor * one[chosen] for one in columns[quantity.symbol]
    )
    assert value is not None
    assert error is not None
    return value, error, None if observed is None else at_edge(observed, value)


def _draw_strokes(axes: Axes, across: Vector, value: Vector, error: Vector) -> None:
    """Draw pulls and releases in their colours; the legend names each kind once."""
    named = set[float]()
    for begin, end in strokes(across):
        part = slice(begin, end + 1)
        direction = 1.0 if across[end] >= across[begin] else -1.0
        name, colour = _STROKES[direction]
        low, high = (value - error)[part], (value + error)[part]
        axes.fill_between(across[part], low, high, color=colour, alpha=_PALE, linewidth=0)
        label = "_" if direction in named else name
        axes.plot(across[part], value[part], color=colour, linewidth=1.2, label=label, zorder=3)
        named.add(direction)
