"""How a notebook shows each class of result: its numbers in a line and a table, its columns, and its plots.

A class has one `Presentation`. Its module is imported when such a result is displayed, and what draws or
makes tables when that is asked for, so that a line of text needs no library for pictures.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from html import escape
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from tssgeom.errors import SettingsError

if TYPE_CHECKING:
    import pyarrow as pa
    from matplotlib.axes import Axes

Numbers: TypeAlias = list[tuple[str, str]]
"""Symbols, and values with their units as text."""
Drawings: TypeAlias = "Mapping[str, Callable[[Axes], object]]"
"""What draws each plot on axes, by its name; the default first."""

_MOST_LETTERS = 160
"""Of a line. Chosen: it fits a wide terminal."""
_LEFT = 'style="text-align:left"'
_MOST_REMARKS = 5
"""Warnings in a table. Chosen: the numbers stay in sight."""


class Presentation(NamedTuple):
    """What is known of one class of result."""

    numbers: Callable[[Any], Numbers]
    """The main numbers, those of the line first."""
    table: Callable[[Any], pa.Table]
    drawings: Callable[[Any], Drawings]
    json: Callable[[Any], Any] | None = None
    """Object for a JSON file; left out, the rows of the table."""
    heading: Callable[[Any], str] = lambda result: ""
    """Name or verdict, which a file or a user may have chosen."""
    remarks: Callable[[Any], tuple[str, ...]] = lambda result: getattr(result, "warnings", ())
    """Sentences below the table."""


_MODULES = {
    "of_frames": "Arcs CurvatureProfile Frame FrameResult Recording Route RouteFit",
    "of_runs": "Command Compensation FollowedRun MeasuredRun RecordingResult Simulation",
    "of_findings": "Calibration Finding MachineCalibration MachineChannels",
}
_MODULE_OF = {name: f"tssgeom.api.{module}" for module, names in _MODULES.items() for name in names.split()}


def presentation(result: object) -> Presentation:
    """Return the presentation of the class of a result."""
    name = type(result).__name__
    return import_module(_MODULE_OF[name]).PRESENTATIONS[name]


def line(result: object) -> str:
    """Return the class, the name and the main numbers of a result in one line."""
    of = presentation(result)
    heading = " ".join(of.heading(result).split())
    parts = [heading[: _MOST_LETTERS // 2]] if heading else []
    for name, value in of.numbers(result):
        part = f"{name} = {value}" if name else value
        if sum(map(len, (*parts, part))) + 2 * len(parts) > _MOST_LETTERS:
            parts.append("…")
            break
        parts.append(part)
    if count := len(of.remarks(result)):
        parts.append(f"{count} warning{'s' if count > 1 else ''}")
    return f"<{type(result).__name__}: {', '.join(parts)}>"


def html_table(result: object) -> str:
    """Return the main numbers and the warnings of a result as HTML, in the colours of the page around it."""
    of = presentation(result)
    heading = of.heading(result)
    title = f"{type(result).__name__}: {heading}" if heading else type(result).__name__
    rows = "".join(
        f"<tr><th {_LEFT}>{escape(name)}</th><td {_LEFT}>{escape(value)}</td></tr>"
        for name, value in of.numbers(result)
    )
    remarks = of.remarks(result)
    listed = "".join(f"<div>⚠ {escape(text)}</div>" for text in remarks[:_MOST_REMARKS])
    more = len(remarks) - _MOST_REMARKS
    listed += f"<div>⚠ {more} more in <code>.warnings</code></div>" if more > 0 else ""
    return f"<div><strong>{escape(title)}</strong><table>{rows}</table>{listed}</div>"


def table(result: object) -> pa.Table:
    """Return a result as a table."""
    return presentation(result).table(result)


def plots(result: object) -> tuple[str, ...]:
    """Return the names of the plots that a result has."""
    return tuple(presentation(result).drawings(result))


def plot(result: object, axes: Axes | str | None, what: str | None) -> Axes:
    """Draw a result on axes, or on those of a new figure of pyplot, and return them."""
    if isinstance(axes, str) and what is None:  # result.plot("tension")
        axes, what = None, axes
    if axes is not None and not hasattr(axes, "fill_between"):
        raise SettingsError(f"axes is {axes!r}: give matplotlib's axes, or the name of a plot alone")
    draw = drawing(result, what)
    from tssgeom.view.figures.plots import new_axes, style
    from tssgeom.view.figures.restyle import set_subscripts

    if axes is None or isinstance(axes, str):
        with style():
            return plot(result, new_axes(), what)
    draw(axes)
    set_subscripts(axes)
    return axes


def drawing(result: object, what: str | None) -> Callable[[Axes], object]:
    """Return what draws a plot of a result.

    Raises
    ------
    SettingsError
        Where there is no plot of this name.
    """
    drawings = presentation(result).drawings(result)
    name = next(iter(drawings), "") if what is None else what
    if name not in drawings:
        known = ", ".join(drawings) or "none"
        raise SettingsError(f"{type(result).__name__} has no plot {what!r}: its plots are {known}")
    return drawings[name]
