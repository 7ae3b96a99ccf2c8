"""`tssgeom analyse`: one table, or JSON, of a few shapes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pipelines.console import say
from pipelines.drawing import write_shape_figures
from pipelines.summary_table import show_summary
from pipelines.surroundings import Surroundings, surroundings, tell_clearance
from pipelines.work import Options, each_analysis, inputs_of
from tssgeom.atomic import replacing, write_text
from tssgeom.errors import SettingsError
from tssgeom.io.formats.files import ANALYSIS_MARK
from tssgeom.io.results.exports import selected_endings, tension_line, write_exports
from tssgeom.io.results.shapes import Analysis, analysis_object, summary_row
from tssgeom.tendon.state import tension

_SLENDERNESS = 150
"""Length of a route over the radius of its tube where none is given, so that it looks well at any size."""


def run(
    shapes: Sequence[Path],
    chosen: Options,
    *,
    out: Path | None,
    export: str,
    figures: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Analyse the shapes and return the exit status.

    Raises
    ------
    SettingsError
        Where an export is asked for but no folder for it, or one that is not known.
    """
    if export and out is None:
        raise SettingsError(f"--export {export}: there is no folder to write to: give --out DIR too")
    endings = selected_endings(export)
    objects, rows = list[dict[str, Any]](), list[dict[str, Any]]()

    def finish(analysis: Analysis) -> None:
        objects.append(analysis_object(analysis))
        rows.append(summary_row(analysis))
        around = surroundings(Path(analysis.source), analysis.unit, chosen)
        if around is not None:
            tell_clearance(objects[-1], rows[-1], analysis, around)
        if out is not None:
            draw(analysis, chosen, out, endings, around)
        if figures is not None:
            write_shape_figures(figures, analysis.name, analysis.results, timed=analysis.timed)

    found = list(inputs_of(shapes, besides=[] if out is None else [out]))
    tally = each_analysis(found, chosen, finish, quiet=quiet or as_json)
    one_file = found == list(shapes) and len(found) == 1  # no folder of files, no file of several shapes
    if out is not None and objects:
        write_text(out / ANALYSIS_MARK, as_text(objects, one_file=one_file) + "\n")
    if as_json and (objects or not one_file):
        say(as_text(objects, one_file=one_file))
    elif not quiet and objects:
        show_summary(rows, chosen)
    return tally.status


def as_text(objects: Sequence[dict[str, Any]], *, one_file: bool) -> str:
    """Return the objects as JSON: the object itself where one file was asked for, else a list."""
    return json.dumps(objects[0] if one_file else objects, indent=1, ensure_ascii=False, allow_nan=False)


def draw(
    analysis: Analysis, chosen: Options, out: Path, endings: Sequence[str], around: Surroundings | None
) -> None:
    """Write the Rerun recording of an input, the tube of the frame that is told, and that for other programs.

    Raises
    ------
    SourceError
        Where the disk refuses, or what a format needs is missing.
    """
    from tssgeom.view.mesh import tube
    from tssgeom.view.scene.recording import write_recording

    out.mkdir(parents=True, exist_ok=True)
    write_recording(
        out / f"{analysis.name}.rrd",
        analysis.name,
        analysis.results,
        timed=analysis.timed,
        lumen=None if around is None else around.mesh,
        clearance=None if around is None else around.sketch,
    )
    told = analysis.representative
    radius = chosen.tube_radius or told.profile.length / _SLENDERNESS
    pull = tension(told.state, told.profile.phi, told.profile.s)
    line = tension_line(analysis.name, analysis.unit, told, pull)
    mesh = tube(told.route.position, told.route.tangent, pull, radius, carried=line.values)
    with replacing(out / f"{analysis.name}.glb") as draft:
        mesh.export(draft)
    write_exports(out, endings, line, mesh)
