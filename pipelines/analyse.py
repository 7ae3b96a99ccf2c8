"""`tssgeom analyse`: one table, or JSON, of a few shapes.

What it needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipelines.options import (
    Figures,
    FigureStyle,
    GeometryOnly,
    Inputs,
    Json,
    Map,
    Quiet,
    RigFile,
    TensionIn,
    TubeMm,
    Unit,
)
from pipelines.terminal import json_text, print_json
from tssgeom.view.figures.style import choose

if TYPE_CHECKING:
    from pipelines.inputs import Refusal, RunSettings
    from pipelines.lumen import SensedLumen
    from tssgeom.io.results.shapes import Analysis

_SLENDERNESS = 150
"""Length of a route over the radius of its tube in the mesh, where no diameter is given [1]; chosen."""


def analyse(
    shapes: Inputs,
    rig: RigFile = None,
    tension_in: TensionIn = None,
    unit: Unit = None,
    columns: Map = None,
    as_json: Json = False,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for result.json, .rrd and tube .glb.")
    ] = None,
    export: Annotated[
        str, typer.Option("--export", help="Files for other programs, in DIR: any of mrk.json,vtp,ply,csv.")
    ] = "",
    lumen: Annotated[
        Path | None, typer.Option("--lumen", help="Mesh around the route; NAME_lumen.* beside it by default.")
    ] = None,
    tube_mm: TubeMm = None,
    figures: Figures = None,
    style: FigureStyle = "light",
    at: Annotated[
        float | None,
        typer.Option("--at", help="Time of the frame to show, in s; at the highest peak of T_in by default."),
    ] = None,
    geometry_only: GeometryOnly = False,
    same: Annotated[
        bool, typer.Option("--same", help="The shapes are one route, sensed several times: estimate it too.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Report length, angle, pieces, distal tension and elongation of each shape."""
    from pipelines.inputs import Refusal, each_analysis, inputs_of, run_settings
    from pipelines.left_out import print_left_out
    from tssgeom.errors import SettingsError
    from tssgeom.io.results.exports import missing_libraries, selected_endings

    choose(style)
    settings = run_settings(
        *(rig, tension_in, unit),
        lumen=lumen,
        geometry_only=geometry_only,
        tube_mm=tube_mm,
        columns=columns,
        at=at,
        takes_machines=True,
    )
    if export and out is None:
        raise SettingsError(f"--export {export}: there is no folder to write to: give --out DIR too")
    endings = selected_endings(export)
    missing = missing_libraries(endings)
    written = [ending for ending in endings if ending not in missing]
    results = _Results(settings, out, written, figures, same=same)
    besides = [] if out is None else [out]
    inputs = list(inputs_of(shapes, besides, settings.columns))
    print_left_out(shapes, besides)
    tally = each_analysis(inputs, settings, results.add, quiet=quiet or as_json)
    if same and (refusal := results.add_common()) is not None:
        tally.refuse(refusal)
    for ending, reason in missing.items():
        tally.refuse(Refusal(ending, f"--export {ending}: {reason}"))
    # no folder of files, no file of several shapes
    one_file = inputs == list(shapes) and len(inputs) == 1 and not same
    results.report(one_file=one_file, as_json=as_json, quiet=quiet)
    raise typer.Exit(tally.status)


class _Results:
    """JSON objects and summary rows of all inputs, and the files of each."""

    def __init__(
        self,
        settings: RunSettings,
        out: Path | None,
        endings: Sequence[str],
        figures: Path | None,
        *,
        same: bool,
    ) -> None:
        self._settings, self._out, self._endings, self._figures = settings, out, endings, figures
        self._objects, self._rows = list[dict[str, Any]](), list[dict[str, Any]]()
        self._same = same
        self._lines: list[Analysis] = []

    def add(self, analysis: Analysis) -> None:
        """Take in the analysis of one input, and write its files."""
        from pipelines.figures import write_shape_figures
        from pipelines.lumen import add_clearance, lumen_of
        from tssgeom.io.results.shapes import analysis_object, summary_row

        if self._same:
            self._lines.append(analysis)
        self._objects.append(analysis_object(analysis))
        self._rows.append(summary_row(analysis))
        lumen = lumen_of(Path(analysis.source), analysis.unit, self._settings)
        if lumen is not None:
            add_clearance(self._objects[-1], self._rows[-1], analysis, lumen)
        if self._out is not None:
            write_scene(analysis, self._settings, self._out, self._endings, lumen)
        if self._figures is not None:
            what = analysis.representative, analysis.results
            write_shape_figures(self._figures, analysis.name, *what, timed=analysis.timed)

    def add_common(self) -> Refusal | None:
        """Estimate the one route that all shapes are, and add it as a shape; return why it is none."""
        from pipelines.inputs import Refusal, attempt
        from tssgeom.analysis import analyse_same
        from tssgeom.io.results.shapes import Analysis, frame_row
        from tssgeom.summary import RunningSummary

        frames = [line.representative.frame for line in self._lines]
        work = partial(analyse_same, frames, self._settings.rig, tension_in=self._settings.tension_in)
        outcome = attempt("--same", work)
        if isinstance(outcome, Refusal):
            return Refusal(outcome.source, f"--same: {outcome.reason.removeprefix('--same: ')}")
        result, common = outcome
        running, first = RunningSummary.of(1), self._lines[0]
        running.add(result, frame_row(result))
        self.add(Analysis("same_route", first.source, first.unit, first.kind, False, running.close()))
        self._objects[-1] |= {
            "lines": [one["shape"] for one in self._objects[:-1]],
            "error_m": common.error,
            "error_length_m": common.error_length,
        }
        return None

    def report(self, *, one_file: bool, as_json: bool, quiet: bool) -> None:
        """Write result.json and print JSON or the table; of one file the object itself, else a list."""
        from pipelines.summary_table import print_summary
        from tssgeom.atomic import write_text
        from tssgeom.io.formats.files import ANALYSIS_MARK

        objects = self._objects
        value = objects[0] if one_file and objects else objects
        if self._out is not None and objects:
            write_text(self._out / ANALYSIS_MARK, json_text(value) + "\n")
        if as_json and (objects or not one_file):
            print_json(value)
        elif not quiet and objects:
            print_summary(self._rows, self._settings)


def write_scene(
    analysis: Analysis, settings: RunSettings, out: Path, endings: Sequence[str], lumen: SensedLumen | None
) -> None:
    """Write the Rerun recording of an input, and of the summary's frame the tube and the exported files.

    Raises SourceError where the disk refuses, or a library that a format needs is missing.
    """
    from tssgeom.atomic import replacing
    from tssgeom.io.results.exports import tension_line, write_exports
    from tssgeom.tendon.state import tension
    from tssgeom.view.mesh import tube
    from tssgeom.view.samples import tension_se
    from tssgeom.view.scene.recording import write_recording

    out.mkdir(parents=True, exist_ok=True)
    write_recording(
        out / f"{analysis.name}.rrd",
        analysis.name,
        analysis.results,
        timed=analysis.timed,
        lumen=None if lumen is None else lumen.mesh,
        clearance=None if lumen is None else lumen.clearance_in_picture,
    )
    result = analysis.representative
    radius = settings.tube_radius or result.profile.length / _SLENDERNESS
    pull = tension(result.state, result.profile.phi, result.profile.s)
    line = tension_line(analysis.name, analysis.unit, result, pull, tension_se(result, result.profile))
    mesh = tube(result.route.position, result.route.tangent, pull, radius, carried=line.values)
    with replacing(out / f"{analysis.name}.glb") as draft:
        mesh.export(draft)
    write_exports(out, endings, line, mesh)
