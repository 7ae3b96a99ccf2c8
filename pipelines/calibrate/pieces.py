"""`tssgeom calibrate --every`: pieces of a long log, each fitted by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from pipelines import tssgeom_version
from pipelines.calibrate.report import (
    channel_object,
    estimate_object,
    estimate_title,
    sensed_arcs,
    write_report,
)
from pipelines.terminal import print_json, print_message, print_table, step_progress
from tssgeom.errors import SettingsError

if TYPE_CHECKING:
    from pipelines.inputs import RunSettings
    from tssgeom.identify.calibrated_pieces import CalibratedPiece
    from tssgeom.io.results.keys.calibrations import FittedPiece, PiecesCalibrated


def calibrate_pieces(
    paths: Sequence[Path],
    shapes: Sequence[Path],
    out: Path,
    settings: RunSettings,
    *,
    every: float,
    folder: Path | None,
    figures: Path | None,
    with_errors: bool,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Fit the pieces of a log, print how the rig went, and write that of the last piece that passes."""
    from pipelines.runs import errors_naming, measured_run
    from tssgeom.api.machine_calls import routes_of_runs
    from tssgeom.identify import calibrated_pieces
    from tssgeom.identify.stated import beside_stated
    from tssgeom.rig import write_rig
    from tssgeom.uncertain import CERTAIN
    from tssgeom.view.figures.machine import course_figure

    if len(paths) > 1:
        raise SettingsError(f"{len(paths)} runs with --every: give one log")
    (path,) = paths
    (routes,) = routes_of_runs(1, sensed_arcs(shapes, settings), settings.rig)
    log = measured_run(path, settings)
    with step_progress(quiet=quiet or as_json) as report_step, errors_naming(path, *shapes[:1]):
        fits = calibrated_pieces.calibrate_pieces(
            log.name, log.columns, routes, settings.rig, settings.uncertain, every=every, progress=report_step
        )
        pieces = [
            piece
            if piece.fitted is None
            else replace(piece, fitted=beside_stated(piece.fitted, settings.rig, settings.rig_file))
            for piece in fits
        ]
        report_step("done", 1.0)
    for piece in pieces:
        for failure in piece.failures:
            span = f"from {piece.start:g} to {piece.end:g} s"
            print_message(f"{path}: warning: {span} the fit fails its test: {failure}")
    usable = [piece.fitted for piece in pieces if piece.fitted is not None and (force or not piece.failures)]
    summary = _object(path, shapes, out if usable else None, every, pieces)
    write_report(path.stem, folder, figures, summary, {"course": lambda: course_figure(pieces)})
    if usable:
        errors = usable[-1].errors if with_errors else CERTAIN
        write_rig(out, usable[-1].rig, _provenance(path, shapes, pieces), errors)
    if as_json:
        print_json(summary)
    elif not quiet:
        _print(path, out if usable else None, pieces)
    if not usable:
        why = f"no piece of {every:g} s passes; try longer ones, or give --force"
        print_message(f"{path}: no rig is written: {why}")
        raise typer.Exit(2)


def _object(
    path: Path, shapes: Sequence[Path], out: Path | None, every: float, pieces: Sequence[CalibratedPiece]
) -> PiecesCalibrated:
    """Return what `--json` prints."""
    return {
        "run": str(path),
        "shape": str(shapes[0]) if shapes else None,
        "rig": None if out is None else str(out),
        "every_s": every,
        "passes": out is not None,
        "pieces": [_piece_object(piece) for piece in pieces],
    }


def _piece_object(piece: CalibratedPiece) -> FittedPiece:
    fitted = piece.fitted
    facts: FittedPiece = {
        "start_s": piece.start,
        "end_s": piece.end,
        "passes": not piece.failures,
        "failures": list(piece.failures),
    }
    if fitted is None:
        return facts
    return {
        **facts,
        "estimates": {each.name: estimate_object(each) for each in fitted.estimates},
        "friction_angle": estimate_object(fitted.friction_angle),
        "channels": [channel_object(each) for each in fitted.channels],
        "warnings": list(fitted.warnings),
    }


def _keys(pieces: Sequence[CalibratedPiece]) -> list[str]:
    """Return the keys of the rig that some piece identifies."""
    known = [each for piece in pieces if piece.fitted is not None for each in piece.fitted.estimates]
    return list(dict.fromkeys(each.key for each in known if each.key and each.identified))


def _cell(piece: CalibratedPiece, key: str) -> str:
    """Return a number of a piece with half of its 95 % interval."""
    estimates = () if piece.fitted is None else piece.fitted.estimates
    each = next((one for one in estimates if one.key == key and one.identified), None)
    return "" if each is None else f"{each.value:.4g} ± {0.5 * (each.high - each.low):.1g}"


def _print(path: Path, out: Path | None, pieces: Sequence[CalibratedPiece]) -> None:
    titles = {each.key: f"{estimate_title(each)} [{each.unit}]" for each in _of_rig(pieces)}
    keys = _keys(pieces)
    rows = [
        [
            f"{piece.start:g} to {piece.end:g} s",
            *(_cell(piece, key) for key in keys),
            "fails" if piece.failures else "passes",
        ]
        for piece in pieces
    ]
    notes = ["± is half of the 95 % interval; empty: not identified"]
    notes += [] if out is None else [f"rig of the last piece that passes: {out}"]
    print_table(path.name, ("", *(titles[key] for key in keys), "fit"), rows, notes=notes)


def _of_rig(pieces: Sequence[CalibratedPiece]) -> list[Any]:
    return [each for one in pieces if one.fitted is not None for each in one.fitted.estimates if each.key]


def _provenance(path: Path, shapes: Sequence[Path], pieces: Sequence[CalibratedPiece]) -> list[str]:
    """Return the comment at the head of the rig file."""
    from tssgeom.io.results.run_record import sha256_of

    last = [piece for piece in pieces if piece.fitted is not None and not piece.failures] or pieces
    lines = [f"Calibrated by tssgeom {tssgeom_version()} calibrate."]
    lines += [f"Run {path.name}, SHA-256 {sha256_of(path)}"]
    lines += [f"Shape {shape.name}, SHA-256 {sha256_of(shape)}" for shape in shapes]
    lines.append(f"From {last[-1].start:g} to {last[-1].end:g} s; with half of the 95 % interval:")
    return lines + [f"  {key}: {_cell(last[-1], key)}" for key in _keys(last[-1:])]
