"""`tssgeom check`: what a file or a campaign holds, in which units, and what is wrong with it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.console import complain, say
from pipelines.work import Refusal, guarded, inputs_of
from tssgeom.arrays import Matrix
from tssgeom.errors import ShapeError, TssgeomError
from tssgeom.io.formats.campaigns import is_campaign, read_campaign
from tssgeom.io.formats.columns import CHANNELS
from tssgeom.io.formats.files import Recording, open_recording
from tssgeom.io.formats.meshes import ENDINGS, read_lumen
from tssgeom.io.formats.runs import holds_run, read_run
from tssgeom.rig import Rig, read_rig
from tssgeom.route.fibre.sensed import Fibre, clean_fibre, fit_fibre
from tssgeom.stream import Frame, Rejected, fit_frame, require_usable

_MOST_FAULTS = 5
_ANY_RIG = Rig()
_MEASURED = ("tension_in", "tension_out", "displacement_in", "elongation", "temperature")


def run(files: Sequence[Path], unit: str | None, *, as_json: bool) -> int:
    """Check the files and return the exit status."""
    reports = list[dict[str, Any]]()
    for item in _inputs(files):
        report = item if isinstance(item, Refusal) else guarded(item, partial(checked, item, unit))
        if isinstance(report, Refusal):
            complain(report.reason)
            report = {
                "file": str(report.source),
                "holds": "nothing that can be used",
                "wrong": [report.reason],
            }
        elif not as_json:
            say(_as_text(report))
        reports.append(report)
    if as_json:
        say(json.dumps(reports, indent=1, ensure_ascii=False, allow_nan=False))
    usable = [report for report in reports if report["holds"] != "nothing that can be used"]
    return 2 if not usable else int(any(report["wrong"] for report in reports))


def _inputs(files: Sequence[Path]) -> Iterator[Path | Refusal]:
    """Yield campaigns whole, then all else file by file."""
    campaigns = [path for path in files if is_campaign(path)]
    yield from campaigns
    yield from inputs_of(path for path in files if path not in campaigns)


def checked(path: Path, unit: str | None) -> dict[str, Any]:
    """Tell what is in a file or folder: a campaign, a rig, a mesh, a run, a shape or a recording.

    Raises
    ------
    ShapeError, SourceError, SettingsError
        Where the file as a whole cannot be used.
    """
    if is_campaign(path):
        return _checked_campaign(path, unit)
    if path.suffix.lower() == ".toml":
        rig = read_rig(path)
        told = f"friction {rig.friction.coefficient:g}, compliance {rig.tendon.compliance_per_N:g} /N"
        return {"file": str(path), "holds": "rig", "told": told, "wrong": []}
    if path.suffix.lower() in ENDINGS:
        mesh = read_lumen(path, unit or "mm")
        size = " × ".join(f"{extent * 1e3:.1f}" for extent in mesh.extents)
        told = f"{len(mesh.faces)} triangles, {size} mm if it is in {unit or 'mm'}; a mesh states no unit"
        return {"file": str(path), "holds": "mesh", "told": told, "wrong": []}
    return _checked_run(path) if holds_run(path) else _checked_recording(open_recording(path, unit))


def _checked_run(path: Path) -> dict[str, Any]:
    run = read_run(path)
    found = {name: getattr(run, name) for name, _ in CHANNELS.values()}
    gaps = {name: int(np.isnan(values).sum()) for name, values in found.items() if values is not None}
    told = ", ".join(f"{name} ({count} missing)" if count else name for name, count in gaps.items())
    return {
        "file": str(path),
        "holds": "measured run",
        "told": f"{len(run.time)} samples in {np.ptp(run.time):.4g} s: {told}",
        "wrong": [],
    }


def _checked_campaign(path: Path, unit: str | None) -> dict[str, Any]:
    campaign = read_campaign(path, unit)
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


@dataclass(slots=True)
class _Findings:
    """What the frames of a recording have in common, and what is wrong with some."""

    counts: list[int] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    unseen: int = 0
    measured: set[str] = field(default_factory=set)
    stations: bool = False
    wrong: list[str] = field(default_factory=list)
    sensed: dict[str, Any] | None = None
    """Length, noise and warnings of the first frame that can be used."""

    def look(self, seq: int, item: Frame | Rejected) -> None:
        """Look at one frame."""
        if isinstance(item, Rejected):
            self.wrong.append(f"frame {seq}: {item.reason}")
            return
        rows = _rows(item)
        self.counts.append(len(rows))
        self.times.append(item.time)
        self.unseen += int(np.isnan(rows).any(axis=1).sum())
        self.measured |= {name for name in _MEASURED if getattr(item, name) is not None}
        self.stations |= item.stations is not None
        try:
            require_usable(item)
            self.sensed = self.sensed or _sensed(item)
        except TssgeomError as error:
            self.wrong.append(f"frame {seq}: {error}")


def _rows(frame: Frame) -> Matrix:
    """Return what should have been seen: the points, or the gratings between the marks of the ends."""
    if frame.curvatures is None:
        return frame.points
    read = np.flatnonzero(~np.isnan(frame.curvatures).any(axis=1))
    return frame.curvatures[read[0] : read[-1] + 1] if len(read) else frame.curvatures


def _checked_recording(recording: Recording) -> dict[str, Any]:
    findings = _Findings()
    for seq, item in enumerate(recording.frames):
        findings.look(seq, item)
    if findings.sensed is None:
        reason = findings.wrong[0].partition(": ")[2] if findings.wrong else "it holds no frame"
        raise ShapeError(f"{recording.path}: {reason}")
    report = {
        "file": str(recording.path),
        "holds": "recording" if recording.timed else "shape",
        "kind": recording.kind,
        "unit": recording.unit,
        "frames": recording.frame_count,
        "points": [min(findings.counts), max(findings.counts)],
        "points_not_seen": findings.unseen,
        "stations": findings.stations,
        "measured": sorted(findings.measured),
        "wrong": findings.wrong,
    }
    if recording.timed:
        report["duration_s"] = max(findings.times) - min(findings.times)
    warnings = [*recording.warnings, *findings.sensed["warnings"]]
    return report | findings.sensed | {"warnings": warnings}


def _sensed(frame: Frame) -> dict[str, Any]:
    """Tell length, noise and warnings of a frame, as analyse does."""
    if frame.curvatures is not None:
        return _sensed_fibre(clean_fibre(frame.curvatures, frame.stations))
    shape, tracked = fit_frame(frame, _ANY_RIG)
    fit = tracked.fit
    return {
        "length_m": fit.arcs.total_length,
        "noise_m": float(fit.noise),
        "warnings": [*shape.warnings, *fit.warnings],
    }


def _sensed_fibre(fibre: Fibre) -> dict[str, Any]:
    """Tell length and noise of a fibre; that of its places is that of the distal end."""
    found = fit_fibre(fibre)
    return {
        "length_m": fibre.length,
        "noise_m": float(found.fit.noise),
        "curvature_noise_per_m": float(found.curvature_noise),
        "warnings": [*fibre.warnings, *found.fit.warnings],
    }


def _as_text(report: dict[str, Any]) -> str:
    if "told" in report:
        return f"{report['file']}: {report['holds']}, {report['told']}"
    if "runs" in report:
        return _campaign_as_text(report)
    low, high = report["points"]
    timed = f", {report['frames']} frames in {report['duration_s']:.4g} s" if "duration_s" in report else ""
    lines = [
        f"{report['file']}: {report['holds']} in {report['unit']} ({report['kind']}){timed}",
        f"  {_what(report)}: {low if low == high else f'{low} to {high}'}{_unseen(report)}",
        f"  length {report['length_m'] * 1e3:.1f} mm, noise {_noise(report)}"
        + (" (first good frame)" if timed else ""),
        f"  stations: {'told' if report['stations'] else 'not told'}",
        f"  measured: {', '.join(report['measured']) or 'nothing'}",
        *(f"  warning: {warning}" for warning in report["warnings"]),
        *(f"  wrong: {fault}" for fault in report["wrong"][:_MOST_FAULTS]),
    ]
    more = len(report["wrong"]) - _MOST_FAULTS
    if more > 0:
        lines.append(f"  wrong: {more} more frames: see tssgeom check --json")
    return "\n".join(lines)


def _campaign_as_text(report: dict[str, Any]) -> str:
    routes = ", ".join(f"{name} {length * 1e3:.1f} mm" for name, length in report["length_m"].items())
    lines = [f"{report['file']}: campaign of {len(report['runs'])} runs on {routes}"]
    for run in report["runs"]:
        held = ", held out" if run["held_out"] else ""
        lines.append(
            f"  {run['name']} on {run['route']}: {run['samples']} samples in {run['duration_s']:.4g} s: "
            f"{', '.join(run['measured'])}{held}"
        )
    return "\n".join([*lines, *(f"  warning: {warning}" for warning in report["warnings"])])


def _what(report: dict[str, Any]) -> str:
    return "gratings" if "curvature_noise_per_m" in report else "points"


def _noise(report: dict[str, Any]) -> str:
    places = f"{report['noise_m'] * 1e3:.2g} mm"
    if "curvature_noise_per_m" not in report:
        return places
    return f"{report['curvature_noise_per_m']:.2g} /m in curvature, {places} at the distal end"


def _unseen(report: dict[str, Any]) -> str:
    count = report["points_not_seen"]
    return f", {count} not seen (gaps)" if count else ", no gaps"
