"""`tssgeom check`: what a file or a campaign holds, in which units, and what is wrong with it.

What it needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from pipelines.options import Json, Map, Unit
from pipelines.terminal import print_json, print_line, print_message

_UNUSABLE = "nothing that can be used"


def check(
    files: Annotated[
        list[Path],
        typer.Argument(help="Shapes, recordings, meshes or rig files, or folders.", readable=False),
    ],
    unit: Unit = None,
    columns: Map = None,
    suggest: Annotated[
        bool, typer.Option("--suggest", help="Print the lines of columns.toml for these tables.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Report what a file holds, in which units, and what is wrong with it."""
    from functools import partial

    from pipelines.contents import checked, files_and_campaigns
    from pipelines.inputs import Refusal, attempt
    from pipelines.left_out import column_map, print_left_out
    from tssgeom.io.formats.campaigns import is_campaign

    if suggest:
        from pipelines.suggest import suggested

        raise typer.Exit(suggested(files, columns or (), unit))
    said = column_map(columns)
    reports = list[dict[str, Any]]()
    for item in files_and_campaigns(files, said):
        report = item if isinstance(item, Refusal) else attempt(item, partial(checked, item, unit, said))
        if isinstance(report, Refusal):
            print_message(report.reason)
            report = {"file": str(report.source), "holds": _UNUSABLE, "wrong": [report.reason]}
        elif not as_json:
            print_line(_as_text(report))
        reports.append(report)
    print_left_out(path for path in files if not is_campaign(path))
    if as_json:
        print_json(reports)
    usable = any(report["holds"] != _UNUSABLE for report in reports)
    raise typer.Exit(int(any(report["wrong"] for report in reports)) if usable else 2)


def _as_text(report: dict[str, Any]) -> str:
    if "told" in report:
        lines = [f"{report['file']}: {report['holds']}, {report['told']}"]
        lines += [f"  {note}" for note in report.get("read", ())]
        lines += [f"  warning: {warning}" for warning in report.get("warnings", ())]
        return "\n".join([*lines, *(f"  wrong: {fault}" for fault in report["wrong"])])
    if "runs" in report:
        return _campaign_as_text(report)
    from pipelines.inputs import MOST_REPORTED

    low, high = report["points"]
    timed = f", {report['frames']} frames in {report['duration_s']:.4g} s" if "duration_s" in report else ""
    lines = [
        f"{report['file']}: {report['holds']} in {report['unit']} ({report['kind']}){timed}",
        f"  {_counted(report)}: {low if low == high else f'{low} to {high}'}{_missing(report)}",
        f"  length {report['length_m'] * 1e3:.1f} mm, noise {_noise(report)}"
        + (" (first good frame)" if timed else ""),
        f"  stations: {'given' if report['stations'] else 'not given'}",
        f"  measured: {', '.join(report['measured']) or 'nothing'}",
        *(f"  {note}" for note in report.get("read", ())),
        *(f"  warning: {warning}" for warning in report["warnings"]),
        *(f"  wrong: {fault}" for fault in report["wrong"][:MOST_REPORTED]),
    ]
    more = len(report["wrong"]) - MOST_REPORTED
    if more > 0:
        lines.append(f"  wrong: {more} more frames: see tssgeom check --json")
    return "\n".join(lines)


def _campaign_as_text(report: dict[str, Any]) -> str:
    routes = ", ".join(f"{name} {length * 1e3:.1f} mm" for name, length in report["length_m"].items())
    runs = f"{len(report['runs'])} run{'s' if len(report['runs']) > 1 else ''}"
    lines = [f"{report['file']}: campaign of {runs} on {routes}"]
    for run in report["runs"]:
        held = ", held out" if run["held_out"] else ""
        lines.append(
            f"  {run['name']} on {run['route']}: {run['samples']} samples in {run['duration_s']:.4g} s: "
            f"{', '.join(run['measured'])}{held}"
        )
    return "\n".join([*lines, *(f"  warning: {warning}" for warning in report["warnings"])])


def _counted(report: dict[str, Any]) -> str:
    return "gratings" if "curvature_noise_per_m" in report else "points"


def _noise(report: dict[str, Any]) -> str:
    position = f"{report['noise_m'] * 1e3:.2g} mm"
    if "curvature_noise_per_m" not in report:
        return position
    return f"{report['curvature_noise_per_m']:.2g} /m in curvature, {position} at the distal end"


def _missing(report: dict[str, Any]) -> str:
    count = report["points_not_seen"]
    return f", {count} missing" if count else ", none missing"
