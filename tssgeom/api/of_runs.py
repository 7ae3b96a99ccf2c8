"""Presentation of measured, simulated, compensated and followed runs."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from tssgeom.adapt.offline import FollowedRun
from tssgeom.api.presentation import Drawings, Numbers, Presentation
from tssgeom.api.runs import Compensation, RecordingResult, Simulation
from tssgeom.arrays import Vector
from tssgeom.channel_names import quantity_of, words_of
from tssgeom.io.formats.runs import MeasuredRun
from tssgeom.tendon.command import Command
from tssgeom.view.quantities import ANGLE, ELONGATION, TENSION_OUT
from tssgeom.view.wording import with_error

if TYPE_CHECKING:
    import pyarrow as pa
    from matplotlib.axes import Axes

    from tssgeom.view.report.entry import Series

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
        name: np.array([getattr(each.transmission, quantity_of(name)) for each in simulation])
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
    from tssgeom.view.report.entry import Series

    columns, measured = _columns(simulation), {} if simulation.run is None else simulation.run.columns
    blank = np.full(len(simulation), np.nan)
    series = Series.of(
        columns["time_s"].tolist(),
        [each.transmission for each in simulation],
        measured.get("tension_out_N", blank).tolist(),
        measured.get("elongation_m", blank).tolist(),
        simulation.angles,
    )
    return {**_of_series(series), "displacement": _over_time(series.time, columns, measured)["displacement"]}


def _of_series(run: Series) -> Drawings:
    """Return the plots of tension, elongation and, where it moves, Φ, over time and over a varying drive."""
    from tssgeom.view.figures.runs import draw_over_drive, draw_over_time

    over_time = {"tension": TENSION_OUT, "elongation": ELONGATION}
    over_time |= {} if run.angle is None else {"angle": ANGLE}
    over_drive = {"transmission": TENSION_OUT, "elongation_loop": ELONGATION} if run.driven else {}
    return {
        name: _with_legend(partial(draw, run=run, quantity=quantity))
        for draw, named in ((draw_over_time, over_time), (draw_over_drive, over_drive))
        for name, quantity in named.items()
    }


def _with_legend(draw: Callable[[Axes], Axes]) -> Callable[[Axes], object]:
    return lambda axes: draw(axes).legend()


def _over_time(time: Vector, columns: dict[str, Vector], measured: dict[str, Vector]) -> Drawings:
    """Return plots over time, of tensions and of lengths."""
    from tssgeom.view.figures.runs import draw_channels

    drawings: dict[str, Any] = {}
    groups = {"tension": _TENSIONS, "elongation": ("elongation_m",)}
    groups["displacement"] = ("displacement_in_m", "displacement_out_m")
    for name, wanted in groups.items():
        lines = {each: columns[each] for each in wanted if each in columns}
        dots = {each: measured[each] for each in wanted if each in measured}
        if lines or dots:
            drawings[name] = partial(draw_channels, time=time, channels=lines, readings=dots)
    return drawings


def _recording(result: RecordingResult) -> Numbers:
    numbers = _rows(len(result), np.array([each.frame.time for each in result]))
    numbers += [("rejected", str(len(result.rejected)))] if result.rejected else []
    if not len(result):
        return numbers
    ends = [each.transmission for each in result]
    return [
        *numbers,
        ("Φ", _range(np.array([each.arcs.total_angle for each in result]), "rad", 1.0, 3)),
        ("T_in", _range(np.array([each.tension_in for each in ends]), "N")),
        ("T_out", _range(np.array([each.tension_out for each in ends]), "N")),
        ("δ", _range(np.array([each.elongation for each in ends]), "mm", 1e3, 3)),
    ]


def _recording_table(result: RecordingResult) -> pa.Table:
    from tssgeom.io.results.geometry import frames_table

    return frames_table(result.rows)


def _of_recording(result: RecordingResult) -> Drawings:
    from tssgeom.view.report.entry import series_of

    return _of_series(series_of(result.rows)) if len(result) else {}


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
    letting_go, waits = sum(each.lets_go for each in run), sum(each.waits for each in run)
    cut = sum(bool(each.limited) and not each.lets_go for each in run)
    numbers += [
        ("x_in", _range(np.array([each.displacement_in for each in run]), "mm", 1e3, 3)),
        ("T_in", _range(np.array([each.tension_in for each in run]), "N")),
    ]
    numbers += [("cut by limits", str(cut))] if cut else []
    numbers += [("lets go", str(letting_go))] if letting_go else []
    return numbers + ([("waits", str(waits))] if waits else [])


def _compensation_table(run: Compensation) -> pa.Table:
    from tssgeom.io.results.tables import commands_table

    return commands_table(run.time.tolist(), run.rows)


def _of_compensation(run: Compensation) -> Drawings:
    from tssgeom.view.figures.commands import draw_commands, draw_missed
    from tssgeom.view.figures.runs import draw_channels

    given = {"time": run.time, "target": run.target, "commands": run.rows, "by_tension": run.by_tension}
    drive = {"displacement_in_m": np.array([each.displacement_in for each in run])}
    pull = {"tension_in_N": np.array([each.tension_in for each in run])}
    over_time = partial(draw_channels, time=run.time, readings={})
    return {
        "result": _with_legend(partial(draw_commands, **given)),
        "missed": partial(draw_missed, **given),
        "drive": partial(over_time, channels=drive),
        "tension": partial(over_time, channels=pull),
    }


def _run(run: MeasuredRun) -> Numbers:
    return [*_rows(len(run.time), run.time), ("columns", " ".join(list(run.columns)[1:]))]


def _run_table(run: MeasuredRun) -> pa.Table:
    from tssgeom.io.results.geometry import table_of

    return table_of((name, words_of(name), each) for name, each in run.columns.items())


def _of_run(run: MeasuredRun) -> Drawings:
    return _over_time(run.time, {}, run.columns)


def _of_followed(run: FollowedRun) -> Drawings:
    from tssgeom.view.figures.adapt import draw_followed_tension, draw_number

    numbers = {key: _with_legend(partial(draw_number, run=run, key=key)) for key in run.keys}
    return {**numbers, "tension": _with_legend(partial(draw_followed_tension, run=run))}


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
    "RecordingResult": Presentation(
        _recording, _recording_table, _of_recording, heading=lambda result: result.name
    ),
    "Simulation": Presentation(
        _simulation, _simulation_table, _of_simulation, heading=lambda run: run.run.name if run.run else ""
    ),
    "Command": Presentation(_command, _command_table, lambda command: {}),
    "Compensation": Presentation(_compensation, _compensation_table, _of_compensation),
    "MeasuredRun": Presentation(_run, _run_table, _of_run, heading=lambda run: run.name),
    "FollowedRun": Presentation(_followed, _followed_table, _of_followed),
}
