"""The candidates side by side: how much each helps, against what it has to pass."""

from __future__ import annotations

import math

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tssgeom.identify.finding import Candidate, Finding
from tssgeom.view import finding_wording as words
from tssgeom.view.figures.plots import BLUE, ORANGE, PAGE, figure, legend_below, titles

MOST = 10
_PALE = "#c3c9d4"
_LINEAR = 20.0  # ΔBIC up to which the axis is linear [1]; chosen: thresholds of clean campaigns are below


def listed_candidates(finding: Finding) -> tuple[Candidate, ...]:
    """Return the first candidates of the ranking, and what acts where it is not among them."""
    first = finding.ranking[:MOST]
    names = {name for each in first for name in each.names}
    return (*(each for each in finding.effects if not names.intersection(each.names)), *first)


def ranking_figure(finding: Finding) -> Figure:
    """Draw the evidence for each candidate, and what it has to pass."""
    with figure((PAGE, 0.75 + 0.24 * len(listed_candidates(finding)))) as drawing:
        legend_below(drawing, draw_ranking(drawing.subplots(), finding))
    return drawing


def draw_ranking(axes: Axes, finding: Finding) -> Axes:
    """Draw the evidence for each of the first candidates, held-out runs included, and its threshold."""
    candidates = listed_candidates(finding)
    rows = range(len(candidates))
    gains = [each.evidence.total if math.isfinite(each.evidence.total) else 0.0 for each in candidates]
    shades = [BLUE if words.is_selected(finding, each) else _PALE for each in candidates]
    axes.barh(rows, gains, color=shades, height=0.7)
    for k, each in enumerate(candidates):
        bar = [each.evidence.threshold] * 2
        axes.plot(bar, [k - 0.45, k + 0.45], color=ORANGE, linewidth=1.6, label="_" if k else "threshold")
        end, style = (max(gains[k], 0.0), k), {"va": "center", "fontsize": 7.5}
        axes.annotate(
            words.total(each.evidence).replace("-", "\N{MINUS SIGN}"),
            end,
            xytext=(3, 0),
            textcoords="offset points",
            **style,
        )
    axes.set_yticks(rows, [words.candidate(each) for each in candidates])
    axes.invert_yaxis()
    if max(map(abs, axes.get_xlim())) > _LINEAR:  # else a logarithm has no round numbers there
        axes.set_xscale("symlog", linthresh=_LINEAR)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.grid(visible=False, axis="y")
    titles(axes, "What each effect gains, refitted through the model", f"{words.TOTAL} [1]", "")
    return axes
