"""`tssgeom simulate --adapt`: a recorded run that the rig follows, smoothed afterwards."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipelines import tssgeom_version
from pipelines.terminal import print_json, print_line, print_message, print_table, step_progress
from tssgeom.atomic import write_text
from tssgeom.statistics import NORMAL_95

if TYPE_CHECKING:
    from pipelines.inputs import RunSettings
    from tssgeom.adapt.offline import FollowedRun, MachineColumns
    from tssgeom.arrays import Vector
    from tssgeom.io.formats.runs import MeasuredRun
    from tssgeom.io.results.keys.runs import FollowedNumber, FollowedObject, NumberAt
    from tssgeom.tendon.simulation import Measured

RUN, NUMBERS, ALERTS, REPORT, FIGURE = (
    "adapt.parquet",
    "adapt_numbers.parquet",
    "adapt_alerts.parquet",
    "adapt.json",
    "adapt",
)
_FILES = (RUN, NUMBERS, ALERTS, REPORT, *(f"{FIGURE}.{kind}" for kind in ("png", "pdf", "svg")))
_DRIVES = ("displacement_in_m", "tension_in_N")
_REPORTED = 500  # rows between two reports of the progress; chosen: half a second


def simulate_adapt(
    shapes: Path | None,
    drive: Path,
    out: Path,
    settings: RunSettings,
    *,
    write_rig: Path | None,
    figures: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Follow a run, write tables, report and figure; return the exit status."""
    from pipelines.figures import write_figure, write_figures
    from pipelines.runs import check_run, errors_naming, measured_run, outputs, sensed_route
    from tssgeom.adapt.offline import RunFollower
    from tssgeom.errors import require_replaceable
    from tssgeom.io.results.followed import followed_table, write_alerts, write_numbers
    from tssgeom.io.results.tables import write_table
    from tssgeom.view.figures.adapt import followed_figure

    if write_rig is not None:
        require_replaceable(write_rig)
    with outputs(out, *_FILES):
        run = measured_run(drive, settings)
        channel = _drive_of(run, settings)
        sensed = sensed_route(shapes, settings)
        check_run(run, sensed, settings.rig)
        with errors_naming(drive, shapes), step_progress(quiet=quiet or as_json) as report_step:
            follower = RunFollower(settings.rig, sensed.route, _columns(run, settings))
            for note in follower.notes:
                print_message(f"{drive}: warning: {note}")
            count = len(run.time)
            for row in follower.rows():
                if row % _REPORTED == 0:
                    tenth = 10 * row // count
                    report_step(
                        f"{drive}: following up to {run.time[tenth * count // 10]:.0f} s", row / count
                    )
            followed = follower.result()
        if followed.lost:
            print_message(
                f"{drive}: warning: {followed.lost} rows are left out: no equilibrium of the tendon"
            )
        out.mkdir(parents=True, exist_ok=True)
        write_table(out / RUN, followed_table(followed))
        write_numbers(out / NUMBERS, followed)
        write_alerts(out / ALERTS, followed)
        draw = partial(followed_figure, followed, *_channel_beside_drive(run, channel, followed))
        files = write_figure(draw, out, FIGURE)
        files = [(out / name).as_posix() for name in (RUN, NUMBERS, ALERTS, REPORT, *files)]
        if figures is not None:
            figures.mkdir(parents=True, exist_ok=True)
            write_figures(figures, f"{sensed.name}_{run.name}", {"adapt": draw})
        if write_rig is not None:
            _write_rig(write_rig, drive, shapes, followed)
            files.append(write_rig.as_posix())
        report = _report(sensed.name, run, channel, followed, files)
        write_text(out / REPORT, json.dumps(report, indent=1, ensure_ascii=False) + "\n")
        for alert in followed.alerts:
            print_message(
                f"{drive}: alert: {alert.channel} from {alert.since:.2f} s on: {_said(alert.sentence)}"
            )
        if as_json:
            print_json(report)
        elif not quiet:
            columns = ("", "at the start", "at the end", "smoothed, least", "smoothed, greatest")
            title = f"{run.name} followed on {sensed.name}: {len(run.time)} rows by {channel}"
            print_table(title, columns, [_row(each) for each in report["numbers"]])
            print_line(f"table: {out / RUN}   numbers: {out / NUMBERS}   figure: {out / FIGURE}.png")
        return 1 if sensed.rejected else 0


def _channel_beside_drive(run: MeasuredRun, drive: str, followed: FollowedRun) -> tuple[Vector | None, str]:
    """Return what was read of the channel that the figure has, and its name; of a machine it is no drive."""
    kind = drive.split("_")[:2]
    beside = [name for name in followed.channels if name in run.columns and name.split("_")[:2] != kind]
    if beside:
        return run.columns[beside[0]], beside[0]
    return run.tension_out, "tension_out_N"


def _drive_of(run: MeasuredRun, settings: RunSettings) -> str:
    """Return what drives, of several channels the first."""
    from tssgeom.mechanism import tendon_count
    from tssgeom.tendon.machine_simulation import drive_channels, drive_of, with_torque

    rig = settings.rig
    if not rig.is_machine:
        return run.channel(_DRIVES)[0]
    count = tendon_count(rig.drive, rig.end)
    return drive_channels(drive_of(with_torque(run.columns, rig), count), count)[0]


def _columns(run: MeasuredRun, settings: RunSettings) -> Measured | MachineColumns:
    from pipelines.runs import temperature_of
    from tssgeom.adapt.offline import MachineColumns
    from tssgeom.tendon.simulation import Measured

    if settings.rig.is_machine:
        channels = {name: values for name, values in run.columns.items() if name != "time_s"}
        return MachineColumns(run.time, channels)
    elongation = run.elongation
    if elongation is None and run.displacement_in is not None and run.displacement_out is not None:
        if "elongation_m" in settings.rig.sensors:
            elongation = run.displacement_in - run.displacement_out  # docs/model.md (44)
        else:
            print_message(
                f"{run.path}: warning: displacement_out_m is not used: the rig has no [sensors.elongation_m]"
            )
    temperature = temperature_of(run, settings)
    return Measured(run.time, run.tension_in, run.displacement_in, run.tension_out, elongation, temperature)


def _report(
    shape: str, run: MeasuredRun, channel: str, followed: FollowedRun, files: list[str]
) -> FollowedObject:
    return {
        "shape": shape,
        "run": run.name,
        "drive": channel,
        "rows": len(run.time),
        "rows_left_out": followed.lost,
        "numbers": [_number(key, followed) for key in followed.keys],
        "alerts": [
            {
                "time_s": alert.time,
                "since_s": alert.since,
                "channel": alert.channel,
                "phase": alert.phase,
                "mechanism": alert.mechanism or None,
                "where": alert.where or None,
                "probability": alert.probability if alert.mechanism else None,
                "sentence": alert.sentence or None,
            }
            for alert in followed.alerts
        ],
        "files": files,
    }


def _number(key: str, followed: FollowedRun) -> FollowedNumber:
    having = [one for one in followed.stretches if key in one.keys]
    values = [one.numbers.values[:, one.keys.index(key)] for one in having]
    first, last = having[0], having[-1]

    def at(stretch: Any, moment: int) -> NumberAt:
        i, numbers = stretch.keys.index(key), stretch.numbers
        return {
            "time_s": float(numbers.time[moment]),
            "value": float(numbers.values[moment, i]),
            "se": float(numbers.se[moment, i]),
        }

    return {
        "key": key,
        "start": at(first, 0),
        "end": at(last, -1),
        "smoothed_range": [float(min(v.min() for v in values)), float(max(v.max() for v in values))],
    }


def _row(number: FollowedNumber) -> list[str]:
    def within(at: NumberAt) -> str:
        return f"{at['value']:.5g} ± {NORMAL_95 * at['se']:.2g}"

    low, high = number["smoothed_range"]
    return [number["key"], within(number["start"]), within(number["end"]), f"{low:.5g}", f"{high:.5g}"]


def _said(sentence: str) -> str:
    return sentence or "the run ended before mechanisms were compared"


def _write_rig(path: Path, drive: Path, shapes: Path | None, followed: FollowedRun) -> None:
    from tssgeom.io.results.run_record import sha256_of
    from tssgeom.rig import write_rig

    last = followed.last
    values = zip(last.keys, last.values.tolist(), last.se.tolist(), strict=True)
    lines = [
        f"Followed by tssgeom {tssgeom_version()} simulate --adapt, as it is at {followed.time[-1]:g} s.",
        f"Run {drive.name}, SHA-256 {sha256_of(drive)}",
        "Shape of the rig" if shapes is None else f"Shape {shapes.name}, SHA-256 {sha256_of(shapes)}",
        "Followed numbers with 95 % intervals:",
        *(f"  {key}: {value:.6g} ± {NORMAL_95 * se:.2g}" for key, value, se in values),
        *(
            f"Alert: {one.channel} from {one.since:.2f} s on: {_said(one.sentence)}"
            for one in followed.alerts
        ),
    ]
    write_rig(path, followed.rig, lines)
