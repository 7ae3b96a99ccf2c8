"""What a file or a campaign holds, as `check` reports it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.inputs import Refusal, inputs_of, print_reading
from tssgeom.arrays import Matrix, Vector
from tssgeom.errors import ShapeError, TssgeomError
from tssgeom.io.formats.campaigns import is_campaign, listing_of, read_campaign, read_plan
from tssgeom.io.formats.columns import CHANNELS, MEASURED
from tssgeom.io.formats.files import Recording, open_recording
from tssgeom.io.formats.laboratory.mapping import ColumnMap
from tssgeom.io.formats.meshes import ENDINGS, read_lumen
from tssgeom.io.formats.runs import IN_SI, holds_run, read_run
from tssgeom.mechanism import tendon_count
from tssgeom.plausibility.frames import rig_remarks
from tssgeom.plausibility.runs import run_remarks
from tssgeom.rig import Rig, read_uncertain_rig
from tssgeom.route.fibre.sensed import Fibre, clean_fibre, fit_fibre
from tssgeom.sensed_route import require_usable, sensed_route
from tssgeom.stream import Frame, Rejected

_ANY_RIG = Rig()  # the geometry does not depend on it
_ROUTE_OF_RIG = "the route of the rig"
_NOISES = {"noise", "curvature_noise"}  # of the points, of a fibre
_MEASURED = {field for field, _ in MEASURED.values()} - _NOISES


def files_and_campaigns(paths: Sequence[Path], columns: ColumnMap) -> Iterator[Path | Refusal]:
    """Yield campaigns whole, then all else file by file."""
    campaigns = [path for path in paths if is_campaign(path)]
    yield from campaigns
    yield from inputs_of((path for path in paths if path not in campaigns), (), columns)


def checked(path: Path, unit: str | None, columns: ColumnMap) -> dict[str, Any]:
    """Report what is in a file or folder: a campaign, a rig, a mesh, a run, a shape or a recording.

    Raises ShapeError, SourceError or SettingsError where the file as a whole cannot be used.
    """
    if is_campaign(path):
        return _checked_campaign(path, unit, columns)
    if path.suffix.lower() == ".toml":
        rig, uncertain = read_uncertain_rig(path)
        numbers = f"friction {rig.friction.coefficient:g}, compliance {rig.tendon.compliance_per_N:g} /N"
        if rig.is_machine:
            tendons = tendon_count(rig.drive, rig.end)
            numbers += f"; drive {rig.drive.kind!r}, end {rig.end.kind!r}, tendons: {tendons}"
        for stated, words in ((False, "unknown"), (True, "with an error")):
            keys = ", ".join(each.key for each in uncertain if each.stated == stated)
            numbers += f"; {words}: {keys}" if keys else ""
        warnings = [each.text for each in rig_remarks(rig)]
        return {"file": str(path), "holds": "rig", "told": numbers, "warnings": warnings, "wrong": []}
    if path.suffix.lower() in ENDINGS:
        mesh = read_lumen(path, unit or "mm")
        size = " × ".join(f"{extent * 1e3:.1f}" for extent in mesh.extents)
        numbers = f"{len(mesh.faces)} triangles, {size} mm if it is in {unit or 'mm'}; a mesh states no unit"
        return {"file": str(path), "holds": "mesh", "told": numbers, "wrong": []}
    if holds_run(path, columns):
        return _checked_run(path, columns)
    return _checked_recording(open_recording(path, unit, columns), columns)


def _checked_run(path: Path, columns: ColumnMap) -> dict[str, Any]:
    run = read_run(path, columns)
    channels = {name: getattr(run, name) for name, _ in CHANNELS.values()} | dict(run.of_machine)
    missing_rows = {
        name: int(np.isnan(values).sum()) for name, values in channels.items() if values is not None
    }
    listed = ", ".join(f"{name} ({count} missing)" if count else name for name, count in missing_rows.items())
    remarks = run_remarks(run.columns)
    return {
        "file": str(path),
        "holds": "measured run",
        "told": f"{len(run.time)} samples in {np.ptp(run.time):.4g} s: {listed}",
        "read": list(run.notes),
        "warnings": [*run.warnings, *(each.text for each in remarks if each.severity == "warn")],
        "wrong": [each.text for each in remarks if each.severity == "refuse"],
    }


def _checked_campaign(path: Path, unit: str | None, columns: ColumnMap) -> dict[str, Any]:
    from tssgeom.io.formats.machine_campaigns import is_machine_campaign  # loads how machines are fitted

    if is_machine_campaign(path, columns):
        return _checked_machine_campaign(path, unit, columns)
    campaign = read_campaign(path, unit, columns)
    runs = [
        {
            "name": run.name,
            "route": run.route.name,
            "samples": len(run.columns["time_s"]),
            "duration_s": float(np.ptp(run.columns["time_s"])),
            "measured": [name for name in run.columns if name != "time_s"],
            "held_out": run.held_out,
        }
        for run in campaign.runs
    ]
    routes = {run.route.name: float(run.route.arcs.total_length) for run in campaign.runs}
    return {
        "file": str(path),
        "holds": "campaign",
        "runs": runs,
        "length_m": routes,
        "warnings": list(campaign.notes),
        "wrong": [],
    }


def _checked_machine_campaign(path: Path, unit: str | None, columns: ColumnMap) -> dict[str, Any]:
    from tssgeom.io.formats.machine_campaigns import read_machine_campaign

    campaign = read_machine_campaign(path, unit, columns)
    routes, runs = dict[str, float](), []
    for listed, run in zip(read_plan(listing_of(path)).run, campaign.runs, strict=True):
        shapes = (listed.shape,) if isinstance(listed.shape, str) else listed.shape
        name = ", ".join(Path(shape).stem for shape in shapes if shape) or _ROUTE_OF_RIG
        routes[name] = float(max(arcs.total_length for arcs in run.routes))
        runs.append(
            {
                "name": run.name,
                "route": name,
                "samples": len(run.given["time_s"]),
                "duration_s": float(np.ptp(run.given["time_s"])),
                "measured": [name for name in (*run.given, *run.measured) if name != "time_s"],
                "held_out": run.name in campaign.held_out,
            }
        )
    notes = [f"{run.name}: {note}" for run in campaign.runs for note in run.notes]
    return {
        "file": str(path),
        "holds": "campaign",
        "runs": runs,
        "length_m": routes,
        "warnings": [*campaign.notes, *notes],
        "wrong": [],
    }


@dataclass(slots=True)
class _RecordingReport:
    """Counts over the frames of a recording, and the errors of those that cannot be used."""

    counts: list[int] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    missing: int = 0
    measured: set[str] = field(default_factory=set)
    stations: bool = False
    wrong: list[str] = field(default_factory=list)
    readings: dict[str, list[float]] = field(default_factory=dict)
    """Measured channels by their names in SI, NaN where a frame has none."""
    first_usable: dict[str, Any] | None = None
    """Length, noise and warnings of the first frame that can be used."""

    def add(self, seq: int, item: Frame | Rejected) -> None:
        """Take in one frame."""
        if isinstance(item, Rejected):
            self.wrong.append(f"frame {seq}: {item.reason}")
            return
        rows = _rows(item)
        self.counts.append(len(rows))
        self.times.append(item.time)
        self.missing += int(np.isnan(rows).any(axis=1).sum())
        self.measured |= {name for name in _MEASURED if getattr(item, name) is not None}
        for name, column in IN_SI.items():
            value = getattr(item, name, None)
            self.readings.setdefault(column, []).append(math.nan if value is None else value)
        self.stations |= item.stations is not None
        try:
            require_usable(item)
            self.first_usable = self.first_usable or _fitted(item)
        except TssgeomError as error:
            self.wrong.append(f"frame {seq}: {error}")

    @property
    def columns(self) -> dict[str, Vector]:
        """Time and the readings of the channels that were measured."""
        columns = {name: np.array(values) for name, values in self.readings.items()}
        return {"time_s": np.array(self.times)} | {
            name: values for name, values in columns.items() if np.isfinite(values).any()
        }


def _rows(frame: Frame) -> Matrix:
    """Return the rows that a sensor measures: the points, or the gratings between the ends' marks."""
    if frame.curvatures is None:
        return frame.points
    valid = np.flatnonzero(~np.isnan(frame.curvatures).any(axis=1))
    return frame.curvatures[valid[0] : valid[-1] + 1] if len(valid) else frame.curvatures


def _checked_recording(recording: Recording, columns: ColumnMap) -> dict[str, Any]:
    frames = _RecordingReport()
    for seq, item in enumerate(recording.frames):
        frames.add(seq, item)
    if frames.first_usable is None:
        reason = frames.wrong[0].partition(": ")[2] if frames.wrong else "it holds no frame"
        hints = "".join(f" ({warning})" for warning in recording.warnings)
        print_reading(recording.path, recording.notes, columns)
        raise ShapeError(f"{recording.path}: {reason}{hints}")
    report = {
        "file": str(recording.path),
        "holds": "recording" if recording.timed else "shape",
        "kind": recording.kind,
        "unit": recording.unit,
        "frames": recording.frame_count,
        "points": [min(frames.counts), max(frames.counts)],
        "points_not_seen": frames.missing,
        "stations": frames.stations,
        "measured": sorted(frames.measured),
        "read": list(recording.notes),
        "wrong": frames.wrong,
    }
    if recording.timed:
        report["duration_s"] = max(frames.times) - min(frames.times)
    remarks = [] if len(frames.times) < 2 else run_remarks(frames.columns, fitted=False)
    remarks = [each for each in remarks if each.rule != "missing"]
    warnings = [*recording.warnings, *frames.first_usable["warnings"], *(each.text for each in remarks)]
    return report | frames.first_usable | {"warnings": warnings}


def _fitted(frame: Frame) -> dict[str, Any]:
    """Fit a frame as analyse does; return length, noise and warnings."""
    if frame.curvatures is not None:
        return _fitted_fibre(clean_fibre(frame.curvatures, frame.stations), frame.curvature_noise)
    shape, _, fit, _ = sensed_route(frame, _ANY_RIG)
    return {
        "length_m": fit.arcs.total_length,
        "noise_m": float(fit.noise),
        "warnings": [*shape.warnings, *fit.warnings],
    }


def _fitted_fibre(fibre: Fibre, noise: float | None) -> dict[str, Any]:
    """Fit a fibre; return its length, warnings, and the noise of curvature and of its distal end."""
    result = fit_fibre(fibre, noise)
    return {
        "length_m": fibre.length,
        "noise_m": float(result.fit.noise),
        "curvature_noise_per_m": float(result.curvature_noise),
        "curvature_noise_se_per_m": float(result.curvature_noise_se),
        "warnings": [*fibre.warnings, *result.fit.warnings],
    }
