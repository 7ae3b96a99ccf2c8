"""Presentation of measured, simulated, compensated and followed runs."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from tssgeom.adapt.offline import FollowedRun
from tssgeom.api.presentation import Drawings, Numbers, Presentation
from tssgeom.api.runs import Compensation, Simulation
from tssgeom.arrays import Vector
from tssgeom.io.formats.runs import MeasuredRun
from tssgeom.tendon.command import Command
from tssgeom.tendon.command_error import bound
from tssgeom.view.wording import with_error

if TYPE_CHECKING:
    import pyarrow as pa

_TENSIONS = ("tension_in_N", "tension_out_N")
_SIMULATED = ("elongation_m", "displacement_in_m", "displacement_out_m")


def _range(values: Vector, unit: str, factor: float = 1.0, digits: int = 2) -> str:
    low, high = factor * float(np.nanmin(values)), factor * float(np.nanmax(values))
    low, high = round(low, digits) + 0.0, round(high, digits) + 0.0  # no minus before zero
    return f"{low:.{digits}f} to {high:.{digits}f} {unit}"


def _rows(count: int, time: Vector) -> Numbers:
    rows = "1 row" if count == 1 else f"{count} rows"
    return [("", rows), ("t", _range(time, "s"))] if count else [("", rows)]


def _columns(simulation: Simulation) -> dict[str, Vector]:
    names = (*_TENSIONS, *_SIMULATED)
    columns = {
        name: np.array([getattr(each.transmission, name.rpartition("_")[0]) for each in simulation])
        for name in names
    }
    return {"time_s": np.array([each.time for each in simulation]), **columns}


def _simulation(simulation: Simulation) -> Numbers:
    columns = _columns(simulation)
    numbers = _rows(len(simulation), columns["time_s"])
    if not len(simulation):
        return numbers
    return [
        *numbers,
        ("T_in", _range(columns["tension_in_N"], "N")),
        ("T_out", _range(columns["tension_out_N"], "N")),
        ("δ", _range(columns["elongation_m"], "mm", 1e3, 3)),
    ]


def _simulation_table(simulation: Simulation) -> pa.Table:
    from tssgeom.io.results.tables import simulation_table

    return simulation_table(simulation.rows)


def _of_simulation(simulation: Simulation) -> Drawings:
    columns = _columns(simulation)
    return _over_time(columns["time_s"], columns, {} if simulation.run is None else simulation.run.columns)


def _over_time(time: Vector, columns: dict[str, Vector], measured: dict[str, Vector]) -> Drawings:
    """Return plots over time, of tensions and of lengths, and the loops over the proximal tension."""
    from tssgeom.view.figures import on_axes

    drawings: dict[str, Any] = {}
    groups = {"tension": _TENSIONS, "elongation": ("elongation_m",)}
    groups["displacement"] = ("displacement_in_m", "displacement_out_m")
    for name, wanted in groups.items():
        lines = {each: columns[each] for each in wanted if each in columns}
        dots = {each: measured[each] for each in wanted if each in measured}
        if lines or dots:
            drawings[name] = partial(on_axes.draw_channels, time=time, channels=lines, measured=dots)
    pull = columns.get("tension_in_N")
    for name, each in (("transmission", "tension_out_N"), ("elongation_loop", "elongation_m")):
        if pull is not None and each in columns:
            across, up = ("tension_in_N", pull), (each, columns[each])
            drawings[name] = partial(on_axes.draw_loop, across=across, up=up)
    return drawings


def _command(command: Command) -> Numbers:
    reached, error = 1e3 * command.displacement_reached, 1e3 * command.displacement_out_se
    numbers = [
        ("x_in", f"{1e3 * command.displacement_in:.3f} mm"),
        ("T_in", f"{command.tension_in:.2f} N"),
        ("x_out", f"{with_error(reached, error, 3)} mm"),
        ("T_out", f"{with_error(command.tension_reached, command.tension_out_se, 2)} N"),
    ]
    return [*numbers, ("limited by", command.limited)] if command.limited else numbers


def _command_table(command: Command) -> pa.Table:
    from tssgeom.io.results.tables import commands_table

    time = command.state.time
    return commands_table([None if math.isnan(time) else time], [command])


def _compensation(run: Compensation) -> Numbers:
    numbers = _rows(len(run), run.time)
    if not len(run):
        return numbers
    cut, waits = sum(bool(each.limited) for each in run), sum(each.waits for each in run)
    numbers += [
        ("x_in", _range(np.array([each.displacement_in for each in run]), "mm", 1e3, 3)),
        ("T_in", _range(np.array([each.tension_in for each in run]), "N")),
    ]
    numbers += [("cut by limits", str(cut))] if cut else []
    return numbers + ([("waits", str(waits))] if waits else [])


def _compensation_table(run: Compensation) -> pa.Table:
    from tssgeom.io.results.tables import commands_table

    return commands_table(run.time.tolist(), run.rows)


def _of_compensation(run: Compensation) -> Drawings:
    from tssgeom.view.figures import on_axes

    name = "tension_out_N" if run.by_tension else "displacement_out_m"
    if run.by_tension:
        reached = np.array([each.tension_reached for each in run])
        error = np.array([bound(each.tension_out_se) for each in run])
    else:
        reached = np.array([each.displacement_reached for each in run])
        error = np.array([bound(each.displacement_out_se) for each in run])
    result = partial(
        on_axes.draw_commands, time=run.time, reached=reached, error=error, target=run.target, name=name
    )
    drive = {"displacement_in_m": np.array([each.displacement_in for each in run])}
    pull = {"tension_in_N": np.array([each.tension_in for each in run])}
    over_time = partial(on_axes.draw_channels, time=run.time, measured={})
    return {
        "result": result,
        "drive": partial(over_time, channels=drive),
        "tension": partial(over_time, channels=pull),
    }


def _run(run: MeasuredRun) -> Numbers:
    return [*_rows(len(run.time), run.time), ("columns", " ".join(list(run.columns)[1:]))]


def _run_table(run: MeasuredRun) -> pa.Table:
    from tssgeom.io.results.geometry import table_of

    return table_of(
        (name, name.rpartition("_")[0].replace("_", " "), each) for name, each in run.columns.items()
    )


def _of_run(run: MeasuredRun) -> Drawings:
    return _over_time(run.time, {}, run.columns)


def _followed_columns(run: FollowedRun) -> dict[str, Vector]:
    names = ("tension_in_N", "tension_out_N", "displacement_in_m", "displacement_out_m")
    columns = {name: run.ends[:, k] for k, name in enumerate(names)}
    return {**columns, "elongation_m": run.ends[:, 2] - run.ends[:, 3]}


def _followed(run: FollowedRun) -> Numbers:
    numbers = _rows(len(run.time), run.time)
    last = run.last
    for key, value, error in zip(last.keys, last.values, last.se, strict=True):
        numbers.append((key, with_error(float(value), float(error), 4)))
    return [*numbers, ("alerts", str(len(run.alerts)))]


def _followed_table(run: FollowedRun) -> pa.Table:
    from tssgeom.io.results.followed import followed_table

    return followed_table(run)


PRESENTATIONS = {
    "Simulation": Presentation(
        _simulation, _simulation_table, _of_simulation, heading=lambda run: run.run.name if run.run else ""
    ),
    "Command": Presentation(_command, _command_table, lambda command: {}),
    "Compensation": Presentation(_compensation, _compensation_table, _of_compensation),
    "MeasuredRun": Presentation(_run, _run_table, _of_run, heading=lambda run: run.name),
    "FollowedRun": Presentation(
        _followed, _followed_table, lambda run: _over_time(run.time, _followed_columns(run), {})
    ),
}
