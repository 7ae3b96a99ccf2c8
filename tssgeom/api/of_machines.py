"""Presentation of machines: their channels over a run, and their calibration."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from tssgeom.api.machine_calls import MachineChannels
from tssgeom.api.presentation import Drawings, Numbers, Presentation
from tssgeom.identify.finding import Estimate
from tssgeom.identify.machine_estimates import MachineCalibration
from tssgeom.view.quantities import quantity

if TYPE_CHECKING:
    import pyarrow as pa


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
    return table_of((name, name.rpartition("_")[0].replace("_", " "), each) for name, each in names)


def _of_channels(run: MachineChannels) -> Drawings:
    from tssgeom.view.figures.runs import draw_channels

    time, drawings = run.channels["time_s"], dict[str, Any]()
    for name, values in run.channels.items():
        if name != "time_s":
            drawings[name] = partial(draw_channels, time=time, channels={name: values}, readings={})
    return drawings


def _calibration(fitted: MachineCalibration) -> Numbers:
    from tssgeom.view.finding_wording import displayed

    return [
        (
            each.key or each.name,
            displayed(Estimate(each.value, each.unit, each.low, each.high)).removesuffix(" 1")
            if each.identified
            else "not identified",
        )
        for each in fitted.estimates
    ]


def _calibration_table(fitted: MachineCalibration) -> pa.Table:
    from tssgeom.io.results.geometry import table_of

    meanings = {
        "name": "what is estimated",
        "key": "where it stands in the rig",
        "value": "estimate, in `unit`",
        "low": "lower end of the 95 % interval",
        "high": "upper end of the 95 % interval",
        "unit": "unit of the three",
        "identified": "whether the runs identify it",
    }
    estimates = (*fitted.estimates, fitted.friction_angle, *fitted.bends)
    return table_of(
        (name, text, [getattr(each, name) for each in estimates]) for name, text in meanings.items()
    )


def _of_calibration(fitted: MachineCalibration) -> Drawings:
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
    "MachineChannels": Presentation(_channels, _channels_table, _of_channels, heading=lambda run: run.drive),
    "MachineCalibration": Presentation(_calibration, _calibration_table, _of_calibration),
}
