"""Presentation of calibrations and findings."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from tssgeom.api.presentation import Drawings, Numbers, Presentation
from tssgeom.identify.calibration import Calibration
from tssgeom.identify.calibration import Estimate as Calibrated
from tssgeom.identify.finding import Estimate, Finding

if TYPE_CHECKING:
    import pyarrow as pa

_SYMBOLS = {"friction": "μ", "compliance": "ρ", "tension_out_offset": "zero of T_out"}
_SYMBOLS |= {"elongation_offset": "zero of δ", "take_up": "take-up", "take_up_tension": "take-up tension"}


def _estimate(each: Calibrated) -> str:
    if not each.observable:
        return "not identifiable"
    from tssgeom.view.finding_wording import displayed

    return displayed(Estimate(each.value, each.unit, each.low, each.high)).removesuffix(" 1")


def _calibration(fitted: Calibration) -> Numbers:
    return [
        (_SYMBOLS.get(name, name.replace("_", " ")), _estimate(each))
        for name, each in fitted.estimates.items()
        if not name.startswith("turn_")
    ]


def _calibration_table(fitted: Calibration) -> pa.Table:
    from tssgeom.io.results.geometry import table_of

    estimates = list(fitted.estimates.values())
    meanings = {
        "name": "what is estimated",
        "value": "estimate, in `unit`",
        "low": "lower end of the 95 % interval",
        "high": "upper end of the 95 % interval",
        "unit": "unit of the three",
        "observable": "whether the run identifies it",
        "at_bound": "whether the fit ended at a bound",
        "why": "why the run does not identify it",
    }
    return table_of(
        (name, text, [getattr(each, name) for each in estimates]) for name, text in meanings.items()
    )


def _of_calibration(fitted: Calibration) -> Drawings:
    from tssgeom.view.figures import calibration

    parts = {"": calibration.draw_fit, "_loop": calibration.draw_loop, "_residual": calibration.draw_residual}
    return {
        f"{each.name}{part}": partial(draw, fitted=fitted, channel=each)
        for part, draw in parts.items()
        for each in fitted.channels
    }


def _finding(finding: Finding) -> Numbers:
    from tssgeom.view.finding_wording import displayed

    numbers = [("verdict", finding.verdict)]
    for each in finding.effects:
        for name, parameters in zip(each.names, each.parameters, strict=True):
            values = ", ".join(f"{key} {displayed(one)}" for key, one in parameters.items())
            numbers.append((name, values))
    for name, symbol in (("friction", "μ"), ("compliance_per_N", "ρ")):
        if name in finding.base:
            numbers.append((symbol, displayed(finding.base[name])))
    return numbers


def _finding_table(finding: Finding) -> pa.Table:
    from tssgeom.io.results.geometry import table_of

    ranking = finding.ranking
    evidence = [each.evidence for each in ranking]
    return table_of(
        [
            ("name", "effects that were refitted together", [" + ".join(each.names) for each in ranking]),
            ("delta_bic", "fall of the information criterion", [each.delta_bic for each in evidence]),
            (
                "held_out_fall",
                "fall of χ² of the held-out runs",
                [each.held_out_fall for each in evidence],
            ),
            ("threshold", "what that fall has to exceed", [each.threshold for each in evidence]),
            (
                "size_over_guard",
                "largest change over the detection limit",
                [e.size_over_limit for e in evidence],
            ),
            (
                "heldout_ratio",
                "held-out misfit with it over that without",
                [e.heldout_ratio for e in evidence],
            ),
            ("why_not", "why it was passed over", [each.why_not for each in ranking]),
        ]
    )


def _finding_object(finding: Finding) -> Any:
    from tssgeom.io.results.findings import report_object
    from tssgeom.version import __version__

    return report_object(finding, __version__)


def _of_finding(finding: Finding) -> Drawings:
    from tssgeom.view.figures import finding as figures
    from tssgeom.view.figures.finding import draw_ranking

    drawings: dict[str, Any] = {"ranking": partial(draw_ranking, finding=finding)}
    for name in figures.displayed_channels(figures.judged(finding)):
        drawings[f"{name}_loop"] = partial(figures.draw_loops, finding=finding, name=name)
    for name in figures.measured_channels(finding.traces):
        drawings[f"{name}_residual"] = partial(figures.draw_residual, finding=finding, name=name)
    return drawings


PRESENTATIONS = {
    "Calibration": Presentation(_calibration, _calibration_table, _of_calibration),
    "Finding": Presentation(
        _finding,
        _finding_table,
        _of_finding,
        _finding_object,
        heading=lambda finding: finding.campaign.name,
        remarks=lambda finding: finding.notes,
    ),
}
