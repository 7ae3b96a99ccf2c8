"""Presentation of calibrations and findings, and of the channels of a machine over a run."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from tssgeom.api.machine_calls import MachineChannels
from tssgeom.api.presentation import Drawings, Numbers, Presentation
from tssgeom.channel_names import words_of
from tssgeom.identify.calibration import Calibration
from tssgeom.identify.calibration import Estimate as Calibrated
from tssgeom.identify.finding import Estimate, Finding
from tssgeom.identify.machine_estimates import MachineCalibration, MachineEstimate
from tssgeom.view.quantities import quantity

if TYPE_CHECKING:
    import pyarrow as pa

_SYMBOLS = {"friction": "μ", "compliance": "ρ", "tension_out_offset": "zero of T_out"}
_SYMBOLS |= {"elongation_offset": "zero of δ", "take_up": "take-up", "take_up_tension": "take-up tension"}


def _interval(each: Calibrated | MachineEstimate) -> str:
    from tssgeom.view.finding_wording import displayed

    return displayed(Estimate(each.value, each.unit, each.low, each.high)).removesuffix(" 1")


def _calibration(fitted: Calibration) -> Numbers:
    return [
        (
            _SYMBOLS.get(name, name.replace("_", " ")),
            _interval(each) if each.observable else "not identifiable",
        )
        for name, each in fitted.estimates.items()
        if not name.startswith("turn_")
    ]


def _calibration_table(fitted: Calibration) -> pa.Table:
    more = {
        "observable": "whether the run identifies it",
        "at_bound": "whether the fit ended at a bound",
        "why": "why the run does not identify it",
    }
    return _estimates_table(list(fitted.estimates.values()), {}, more)


def _estimates_table(
    estimates: Sequence[Calibrated | MachineEstimate], first: dict[str, str], more: dict[str, str]
) -> pa.Table:
    """Return estimates with their intervals, with columns behind their names and at the end."""
    from tssgeom.io.results.geometry import table_of

    meanings = {
        "name": "what is estimated",
        **first,
        "value": "estimate, in `unit`",
        "low": "lower end of the 95 % interval",
        "high": "upper end of the 95 % interval",
        "unit": "unit of the three",
        **more,
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
            ("held_out_fall", "fall of χ² of the held-out runs", [each.held_out_fall for each in evidence]),
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
    from tssgeom.identify.misfit import measured_channels
    from tssgeom.view.figures import finding as figures

    drawings: dict[str, Any] = {"ranking": partial(figures.draw_ranking, finding=finding)}
    for name in figures.displayed_channels(figures.judged(finding)):
        drawings[f"{name}_loop"] = partial(figures.draw_loops, finding=finding, name=name)
    for name in measured_channels(finding.traces):
        drawings[f"{name}_residual"] = partial(figures.draw_residual, finding=finding, name=name)
    return drawings


def _channels(run: MachineChannels) -> Numbers:
    numbers = [("", "1 row" if len(run) == 1 else f"{len(run)} rows")]
    for name, values in run.channels.items():
        if name != "time_s":
            of = quantity(name)
            low, high = of.factor * float(values.min()), of.factor * float(values.max())
            numbers.append((of.symbol, f"{low:.4g} to {high:.4g} {of.unit}"))
    return numbers


def _channels_table(run: MachineChannels) -> pa.Table:
    from tssgeom.io.results.geometry import table_of

    names = run.channels.items()
    return table_of((name, words_of(name), each) for name, each in names)


def _of_channels(run: MachineChannels) -> Drawings:
    from tssgeom.view.figures.runs import draw_channels

    time, drawings = run.channels["time_s"], dict[str, Any]()
    for name, values in run.channels.items():
        if name != "time_s":
            drawings[name] = partial(draw_channels, time=time, channels={name: values}, readings={})
    return drawings


def _machine(fitted: MachineCalibration) -> Numbers:
    return [
        (each.key or each.name, _interval(each) if each.identified else "not identified")
        for each in fitted.estimates
    ]


def _machine_table(fitted: MachineCalibration) -> pa.Table:
    key = {"key": "where it stands in the rig"}
    estimates = (*fitted.estimates, fitted.friction_angle, *fitted.bends)
    return _estimates_table(estimates, key, {"identified": "whether the runs identify it"})


def _of_machine(fitted: MachineCalibration) -> Drawings:
    from tssgeom.view.figures.machine import draw_bends, draw_fit, draw_loops, draw_residual

    drawings: dict[str, Any] = {"loops": lambda axes: draw_loops(axes, fitted).legend()}
    if fitted.bends:
        drawings["bends"] = lambda axes: draw_bends(axes, fitted).legend()
    for which, run in enumerate(fitted.runs):
        stem = "" if len(fitted.runs) == 1 else f"{run.name}_"
        for name in run.measured:
            given = {"fitted": fitted, "which": which, "name": name}
            drawings[f"{stem}{name}"] = partial(draw_fit, **given)
            drawings[f"{stem}{name}_residual"] = partial(draw_residual, **given)
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
    "MachineChannels": Presentation(_channels, _channels_table, _of_channels, heading=lambda run: run.drive),
    "MachineCalibration": Presentation(_machine, _machine_table, _of_machine),
}
