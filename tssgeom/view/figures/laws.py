"""Figures of laws: each over what it depends on, with its band, beside what the base model has there."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tssgeom.arrays import Vector
from tssgeom.identify.finding import Candidate, Finding, LawCurve
from tssgeom.identify.law_words import OVER
from tssgeom.view import finding_wording as words
from tssgeom.view.figures.plots import BLUE, ORANGE, PAGE, figure, titles

_BAND = "#c9dcea"
_SCALES = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3)}
_COLUMNS = 2


def laws_of(finding: Finding) -> list[Candidate]:
    """Return what of a finding is a law with a curve."""
    return [each for each in finding.effects if each.law is not None and len(each.law.x) > 1]


def law_figure(finding: Finding) -> Figure:
    """Draw every law over its support with its 95 % band, beside what the rig file has there."""
    laws = laws_of(finding)
    rows = -(-len(laws) // _COLUMNS)
    with figure((PAGE, 2.9 * rows)) as drawing:
        axes = drawing.subplots(rows, min(len(laws), _COLUMNS), squeeze=False).ravel()
        for one, each in zip(axes, laws, strict=False):
            _draw(one, each, finding)
        for one in axes[len(laws) :]:
            one.set_visible(False)
    return drawing


def _draw(axes: Axes, each: Candidate, finding: Finding) -> None:
    law = each.law
    assert law is not None
    name, x, unit = _abscissa(law)
    label, y_unit, factor = _ordinate(each, law)
    axes.fill_between(x, factor * law.low, factor * law.high, color=_BAND, linewidth=0, label="95 % band")
    style = {"marker": "o", "markersize": 3} if len(x) < _FEW else {}
    axes.plot(x, factor * law.value, color=BLUE, linewidth=1.4, label="law", **style)
    if each.names[0].startswith("friction_over"):
        nominal = finding.nominal["friction"]
        axes.axhline(nominal, color=ORANGE, linestyle=(0, (4, 1.5)), linewidth=1.1, label="rig file")
    else:
        axes.axhline(0.0, color=ORANGE, linestyle=(0, (4, 1.5)), linewidth=1.1, label="base model")
    axes.margins(x=0.02)
    axes.legend(loc="best")
    titles(axes, words.candidate(each), f"{name} [{unit}]", f"{label} [{y_unit}]")


_FEW = 8  # points that are marked; chosen


def _abscissa(law: LawCurve) -> tuple[str, Vector, str]:
    if law.over in OVER:
        name, si = OVER[law.over]
    else:
        quantity = words.channel(law.over)
        return f"true {quantity.symbol}", quantity.factor * law.x, quantity.unit
    unit, factor = _SCALES.get(si, (si, 1.0))
    return name, factor * law.x, unit


def _ordinate(each: Candidate, law: LawCurve) -> tuple[str, str, float]:
    name = each.names[0]
    if name.startswith("friction_over"):
        return "friction μ", "1", 1.0
    if name == "strain_over_tension":
        return "strain beside the linear one", "1", 1.0
    unit, factor = _SCALES.get(law.unit, (law.unit, 1.0))
    if name == "strain_over_time":
        return "creep over elastic strain", "1", 1.0
    what = "reading less truth" if name.startswith("sensor") else "path beside the linear one"
    return what, unit, factor
