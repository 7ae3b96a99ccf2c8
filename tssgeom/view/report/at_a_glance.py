"""The top of the page of a batch: distributions over the inputs, outlying inputs, and rejected ones."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any
from urllib.parse import quote

import numpy as np

from tssgeom.view.quantities import ANGLE, TENSION_OUT
from tssgeom.view.report.chart import Chart, limits_of
from tssgeom.view.report.kinds import kinds
from tssgeom.view.report.outlying_inputs import OutlyingInput
from tssgeom.view.report.page import with_subscripts

Row = Mapping[str, Any]
_FEWEST = 3  # inputs from which a distribution is clearer than the table; chosen
_MOST_BARS, _FEWEST_BARS = 30, 6  # of a histogram; chosen
_LONGEST_NAME = 48  # letters of a name in a table [1]; chosen
_HEAD = 16  # letters of its beginning that stay [1]; chosen: names differ at the end
_BAR, _MARK = "#9db7d5", "#d55e00"


def distributions(rows: Sequence[Row], outlying: Collection[str]) -> str:
    """Draw how Φ, L, noise and T_out are distributed over the inputs, the outlying ones marked."""
    if len(rows) < _FEWEST:
        return ""
    names = [str(row["name"]) for row in rows]
    marked = np.array([name in outlying for name in names])
    charts = "".join(
        f"<figure>{_histogram(title, unit, np.array([of(row) for row in rows]), marked)}</figure>"
        for title, unit, of in _QUANTITIES
    )
    note = " Dots: outlying inputs, below; beyond an axis at its end." if marked.any() else ""
    return (
        f'<div class="figures">{charts}</div>\n<p class="soft">Number of inputs over each quantity; of a '
        f"recording, the frame at the last of its highest peaks of T<sub>in</sub>.{note}</p>"
    )


_QUANTITIES: tuple[tuple[str, str, Callable[[Row], float]], ...] = (
    ("Curve angle Φ", "Φ [°]", lambda row: ANGLE.factor * row["total_angle_rad"]),
    ("Length L", "L [mm]", lambda row: 1e3 * row["length_m"]),
    ("Noise of a coordinate", "noise [mm]", lambda row: 1e3 * row["noise_rms_m"]),
    ("Distal tension T_out", TENSION_OUT.label, lambda row: row["tension_out_N"]),
)


def _histogram(title: str, unit: str, values: np.ndarray, marked: np.ndarray) -> str:
    usual = values[~marked]
    low, high = limits_of(usual if len(usual) >= _FEWEST else values, zero=False, room=0.0)
    count = int(np.clip(math.ceil(math.sqrt(len(values)) * 1.5), _FEWEST_BARS, _MOST_BARS))
    heights, edges = np.histogram(values, bins=count, range=(low, high))
    top = max(float(heights.max()), 4.0)  # inputs are counted in whole numbers
    chart = Chart(title, limits_of(np.array([low, high]), zero=False), (0.0, 1.18 * top))
    chart.axes(unit, "inputs")
    chart.bars(edges, heights, _BAR)
    chart.dots(
        np.clip(values[marked], low, high),
        np.full(marked.sum(), 1.09 * top),
        [_MARK] * int(marked.sum()),
        3.0,
    )
    return chart.svg()


def kinds_list(rows: Sequence[Row]) -> str:
    """Write the kinds of inputs where there are several; each input is compared with those of its kind."""
    named = kinds(rows)
    if len(named) < 2:
        return ""
    items = "".join(f"<li>{html.escape(each.words)}</li>" for each in named)
    return (
        f"<h3>Kinds of inputs ({len(named)})</h3>\n<p>They are clearly apart in L, Φ or noise. Outlying "
        f"inputs differ from those of their kind.</p>\n<ul>{items}</ul>"
    )


def outlying_table(inputs: Sequence[OutlyingInput], linked: Collection[str]) -> str:
    """Write the outlying inputs, the largest z first, with a link to those that have charts."""
    if not inputs:
        return ""
    rows = "".join(
        f"<tr><td>{input_name(each.name, linked)}</td>"
        f'<td class="text">{with_subscripts(html.escape(each.words))}</td>'
        f"<td>{each.z:.0f}</td><td>{_own_errors(each.own)}</td></tr>"
        for each in inputs
    )
    return (
        f'<h3>Outlying inputs ({len(inputs)})</h3>\n<div class="wide tall"><table><thead><tr><th>input</th>'
        '<th class="text">differs in</th><th>z beside the others</th><th>own s.e.</th></tr></thead>'
        f"<tbody>{rows}</tbody></table></div>"
    )


def _own_errors(count: float) -> str:
    """Write how many of its own standard errors an input is off; points without noise make it endless."""
    if math.isnan(count):
        return "–"
    return f"{count:.0f}" if count < 1e4 else "> 10⁴"


def rejected_table(items: Sequence[str]) -> str:
    """Write the rejected inputs and frames; an item is the row of one reason."""
    if not items:
        return ""
    return (
        '<h3>Rejected</h3>\n<div class="wide tall"><table class="rejected"><thead><tr><th>input</th>'
        '<th class="left">frames</th><th class="text">reason</th></tr></thead>'
        f"<tbody>{''.join(items)}</tbody></table></div>"
    )


def input_name(name: str, linked: Collection[str]) -> str:
    """Write the name of an input, as a link where the page has its charts."""
    text = breakable(name)
    return f'<a href="#{anchor(name)}">{text}</a>' if name in linked else f"<b>{text}</b>"


def breakable(name: str) -> str:
    """Write a name that may be broken after its underscores, points and slashes; of a long one both ends."""
    if len(name) > _LONGEST_NAME:
        text = breakable(f"{name[:_HEAD]}…{name[_HEAD - _LONGEST_NAME + 1 :]}")
        return f'<span title="{html.escape(name)}">{text}</span>'
    return re.sub(r"(?<=[_./])(?=[^\W_])", "<wbr>", html.escape(name))


def anchor(name: str) -> str:
    """Return the address of an input inside the page."""
    return f"input-{quote(name, safe='')}"
