"""What commands on runs share: a sensed route over time, pictures of a run on it, and names in errors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from pipelines.figures import write_figures
from pipelines.inputs import RunSettings, opened, print_reading, rejection_lines
from pipelines.terminal import counted_progress, print_message
from tssgeom.analysis import even_bend
from tssgeom.api.inputs import SensedFrames, sensed_frames
from tssgeom.arrays import Vector
from tssgeom.effects import named
from tssgeom.errors import TssgeomError
from tssgeom.io.formats.columns import CHANNELS
from tssgeom.io.formats.runs import MeasuredRun, read_run
from tssgeom.plausibility.frames import strain_remarks
from tssgeom.plausibility.rules import warnings_of
from tssgeom.plausibility.runs import run_remarks
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.stream import FrameResult
from tssgeom.summary import LIMITS as SUMMARY
from tssgeom.tendon.history import last_peak
from tssgeom.tendon.machine import route_of_rig
from tssgeom.tendon.simulation import Moment
from tssgeom.view.samples import evenly

Row = TypeVar("Row")

TEMPERATURE = "temperature_C"


@contextmanager
def outputs(folder: Path, *names: str) -> Iterator[None]:
    """Remove what a command has written into its folder where it fails; what was there before stays."""
    files = [folder / name for name in names]
    before = {file: file.stat().st_mtime_ns for file in files if file.is_file()}
    try:
        yield
    except (TssgeomError, OSError):
        for file in files:
            if file.is_file() and file.stat().st_mtime_ns != before.get(file):
                file.unlink()
        raise


@contextmanager
def errors_naming(run: Path, shape: Path | None = None) -> Iterator[None]:
    """Put run and shape, where there is one, before the errors of the model, which names no files.

    An error of the run itself names it.
    """
    try:
        yield
    except TssgeomError as error:
        if str(error).startswith(f"{run}: "):
            raise
        on = run if shape is None else f"{run} on {shape}"
        raise type(error)(f"{on}: {error}") from error


def measured_run(path: Path, settings: RunSettings) -> MeasuredRun:
    """Read a run, print how it was read, and warn of columns that resemble channels and are not read."""
    run = read_run(path, settings.columns)
    print_reading(path, run.notes, settings.columns)
    for warning in run.warnings:
        print_message(f"{path}: warning: {warning}")
    return run


def warn_about_unused(run: MeasuredRun, used: str, names: Sequence[str]) -> None:
    """Warn of other columns that could have served in the same way."""
    for name in names:
        if name != used and getattr(run, CHANNELS[name][0]) is not None:
            print_message(f"{run.path}: warning: {name} is not used beside {used}: leave one out")


def check_run(run: MeasuredRun, sensed: SensedFrames, rig: Rig) -> None:
    """Print the warnings of a run that drives, or is to be followed, on the longest of its routes.

    Raises SettingsError where a rule refuses the run; docs/checks.md.
    """
    arcs = max((result.arcs for result in sensed.results), key=lambda each: each.total_length)
    print_run_warnings(run, rig, arcs, fitted=False)


def print_run_warnings(run: MeasuredRun, rig: Rig, arcs: Arcs, *, fitted: bool) -> list[str]:
    """Print and return the warnings of a run on a route; `fitted` is true where it is to be fitted.

    Raises SettingsError where a rule refuses the run; docs/checks.md.
    """
    remarks = run_remarks(run.columns, rig, length=arcs.total_length, angle=arcs.total_angle, fitted=fitted)
    warnings = warnings_of(run.path, remarks)
    for warning in warnings:
        print_message(f"{run.path}: warning: {warning}")
    return warnings


def warn_about_strain(run: Path, sensed: SensedFrames, rig: Rig, tension_in: float) -> None:
    """Warn where the rig hardly fits the longest route and the greatest tension [N] of a run."""
    longest = max(result.arcs.total_length for result in sensed.results)
    for each in strain_remarks(rig, longest, tension_in):
        print_message(f"{run}: warning: {each.text}")


def sensed_route(path: Path | None, settings: RunSettings) -> SensedFrames:
    """Fit the route of every frame of a file, and print the reasons of those that are rejected.

    Where there is no file the route is the even bend that the rig gives.

    Raises ShapeError or SourceError where the file cannot be used, or none of its frames; SettingsError where
    there is neither file nor a route in the rig.
    """
    if path is None:
        return SensedFrames("route", (even_bend(route_of_rig(settings.rig)),), ())
    sensed = sensed_frames(opened(path, settings), settings.rig)
    for line in rejection_lines(str(path), sensed.rejected, len(sensed.rejected)):
        print_message(line)
    return sensed


def computed_rows(
    rows: Iterable[Row], run: MeasuredRun, shapes: Path | None, title: str, *, quiet: bool
) -> list[Row]:
    """Compute row after row of a run, with progress; errors name the run and the shape."""
    computed = list[Row]()
    with counted_progress(1, quiet=quiet) as progress, errors_naming(run.path, shapes):
        progress.begin(title)
        for row in rows:
            computed.append(row)
            progress.frame(len(run.time))
        progress.end(str(run.path))
    return computed


def value_range(values: Sequence[float]) -> list[float]:
    """Return the least and the greatest value."""
    return [min(values), max(values)]


def temperature_of(run: MeasuredRun, settings: RunSettings) -> Vector | None:
    """Return the temperature of a run where an effect needs it [°C]; warn where it is missing.

    Raises SettingsError where the column lacks a sample.
    """
    needing = [effect for effect in settings.rig.effects if TEMPERATURE in effect.needs]
    if needing and run.temperature is None:
        print_message(f"{run.path}: warning: no {TEMPERATURE}: {named(needing)} does nothing")
    return run.channel((TEMPERATURE,))[1] if needing and run.temperature is not None else None


def write_run_recording(
    path: Path, sensed: SensedFrames, run: MeasuredRun, moments: Sequence[Moment]
) -> None:
    """Write the Rerun recording of a run, on the frames nearest in time.

    Raises SourceError where the disk refuses.
    """
    from tssgeom.view.scene.recording import write_recording

    path.parent.mkdir(parents=True, exist_ok=True)
    results = [_result_at(sensed, run, moments[k], int(k)) for k in evenly(len(moments), SUMMARY.kept)]
    write_recording(path, f"{sensed.name} driven by {run.name}", results, timed=True)


def write_run_figures(
    folder: Path, sensed: SensedFrames, run: MeasuredRun, moments: Sequence[Moment]
) -> list[str]:
    """Write the figures of a run, those of one frame at the last of its highest peaks of T_in.

    Raises SourceError where the disk refuses.
    """
    from tssgeom.view.figures.shapes import figures_of
    from tssgeom.view.report.entry import Series

    transmissions = [moment.transmission for moment in moments]
    peak = last_peak(np.array([each.tension_in for each in transmissions]))
    rows = range(len(moments))
    series = Series.of(
        [moment.time for moment in moments],
        transmissions,
        [_measured(run.tension_out, row) for row in rows],
        [_measured(run.elongation, row) for row in rows],
        [(arcs.total_angle, arcs.total_angle_se) for arcs in (sensed.nearest(m.time).arcs for m in moments)],
    )
    result = _result_at(sensed, run, moments[peak], peak)
    return write_figures(folder, f"{sensed.name}_{run.name}", figures_of(result, series))


def _result_at(sensed: SensedFrames, run: MeasuredRun, moment: Moment, row: int) -> FrameResult:
    """Return the frame nearest to a moment of the run, with the tendon of that moment."""
    nearest = sensed.nearest(moment.time)
    frame = replace(
        nearest.frame,
        time=moment.time,
        tension_in=moment.transmission.tension_in,
        tension_out=_measured(run.tension_out, row),
        elongation=_measured(run.elongation, row),
    )
    return replace(nearest, seq=row, frame=frame, state=moment.state, transmission=moment.transmission)


def _measured(channel: np.ndarray | None, row: int) -> float | None:
    return None if channel is None or np.isnan(channel[row]) else float(channel[row])
