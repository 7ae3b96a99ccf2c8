"""`tssgeom calibrate`: friction, compliance and zeros of a rig from a pull and release on a known shape.

What it needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipelines import tssgeom_version
from pipelines.calibrate.report import channel_object, print_verdict, write_report
from pipelines.options import Figures, FigureStyle, Json, Map, Quiet, RigFile, Unit
from pipelines.terminal import print_json, print_message, print_table, step_progress
from tssgeom.view.figures.style import choose

if TYPE_CHECKING:
    from tssgeom.identify.calibration import Calibration, Estimate
    from tssgeom.identify.fit_quality import ChannelFit
    from tssgeom.io.results.keys.calibrations import Calibrated, PlainEstimate
    from tssgeom.rig import Rig
    from tssgeom.route.pieces import Arcs
    from tssgeom.view.figures.plots import Figure

_TITLES = {
    "friction": "friction coefficient μ",
    "compliance": "compliance ρ",
    "tension_out_offset": "T_out reads too much by",
    "elongation_offset": "δ reads too much by",
    "take_up": "slack taken up, d_0",
    "take_up_tension": "over a tension of, T_s",
}
_RIG = "rig.toml"
_PRINTED_UNITS = {"m": ("mm", 1e3)}


def calibrate(
    runs: Annotated[
        list[Path],
        typer.Argument(metavar="RUN…", help="Measured pull and release (CSV or Parquet), or several."),
    ],
    out: Annotated[
        Path, typer.Option("--out", help="Rig file (TOML) to write, or a folder for rig and report.")
    ],
    shapes: Annotated[
        list[Path] | None,
        typer.Option(
            "--shape", help="Shape of the route during the run; one for all, one a run, or one a tendon."
        ),
    ] = None,
    rig: RigFile = None,
    angle_from_run: Annotated[
        bool,
        typer.Option(
            "--angle-from-run", help="Estimate the curve angle from the run, where no shape is sensed."
        ),
    ] = False,
    from_tension: Annotated[
        float,
        typer.Option(
            "--from-tension", min=0.0, help="Proximal tension below which elongation does not count [N]."
        ),
    ] = 4.0,
    every: Annotated[
        float | None,
        typer.Option(
            "--every", help="Fit each piece of so many seconds by itself: a long log.", metavar="SECONDS"
        ),
    ] = None,
    unit: Unit = None,
    columns: Map = None,
    figures: Figures = None,
    style: FigureStyle = "light",
    with_errors: Annotated[
        bool,
        typer.Option(
            "--with-errors",
            help="Write what is fitted as { value, sd }: commands count these errors.",
        ),
    ] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Write the rig even where the fit fails its test.")
    ] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Estimate friction, compliance and sensor zeros, with 95 % intervals, from a run; write them as a rig.

    RUN has a column time_s, a drive (tension_in_N or displacement_in_m; the more exact one where it has both
    and no elongation) and responses (tension_out_N, elongation_m or _mm, or displacement_in_m with
    displacement_out_m). Friction, compliance and the zero of the distal cell go into the rig; the zero of the
    elongation is only reported. A folder as --out gets rig.toml, calibration.json and figures. Where the fit
    fails its test (docs/checks.md), no rig is written.

    Several runs, --angle-from-run, and a rig with several tendons, a joint, a segment or numbers that are
    "unknown" (docs/machines.md) are fitted together, with what is assumed of each number beforehand. With
    --every, pieces of one long log are fitted, each by itself, and the rig of the last good one is written.
    """
    from pipelines.calibrate.machine import calibrate_machine
    from pipelines.calibrate.pieces import calibrate_pieces
    from pipelines.inputs import analysis_of, run_settings, with_unknown_angle, without_effects
    from pipelines.runs import errors_naming, measured_run, print_run_warnings
    from tssgeom.api.inputs import measured_of
    from tssgeom.errors import SettingsError, require_replaceable
    from tssgeom.identify import calibration
    from tssgeom.identify.rig_errors import of_calibration
    from tssgeom.identify.stated import beside_stated
    from tssgeom.rig import write_rig
    from tssgeom.uncertain import CERTAIN

    choose(style)
    settings = run_settings(rig, None, unit, columns=columns, may_be_uncertain=True, takes_machines=True)
    if angle_from_run:
        settings = with_unknown_angle(settings, sensed=bool(shapes))
    folder = out if out.is_dir() or not out.suffix else None
    out = out if folder is None else folder / _RIG
    require_replaceable(out)
    if every is not None or settings.uncertain or settings.rig.is_machine or len(runs) > 1 or not shapes:
        fit = calibrate_machine if every is None else partial(calibrate_pieces, every=every)
        fit(
            runs,
            shapes or [],
            out,
            settings,
            folder=folder,
            figures=figures,
            with_errors=with_errors,
            force=force,
            as_json=as_json,
            quiet=quiet,
        )
        return
    if len(shapes) > 1:
        raise SettingsError(f"{len(shapes)} --shape for one run of one tendon: give one")
    (run,), (shape,) = runs, shapes
    read = measured_run(run, settings)
    result = analysis_of(shape.stem, shape, without_effects(settings)).results[-1]
    print_run_warnings(read, settings.rig, result.arcs, fitted=True)
    measured = measured_of(read, settings.rig)
    with step_progress(quiet=quiet or as_json) as report_step, errors_naming(run, shape):
        fitted = calibration.calibrate(
            measured, result.arcs, settings.rig, from_tension=from_tension, progress=report_step
        )
        fitted = beside_stated(fitted, settings.rig, settings.rig_file)
        report_step("done", 1.0)
    if not any(fitted.estimates[name].observable for name in ("friction", "compliance")):
        raise SettingsError(
            f"{run}: neither friction nor compliance can be estimated from it: record a pull and a release "
            "with tension_in_N and tension_out_N or elongation_m"
        )
    for warning in (*result.warnings, *fitted.warnings):
        print_message(f"{run}: warning: {warning}")
    written = force or not fitted.failures
    summary = _object(run, shape, out if written else None, fitted, result.arcs, settings.rig)
    write_report(run.stem, folder, figures, summary, _drawings(fitted))
    if written:
        errors = of_calibration(fitted, settings.rig) if with_errors else CERTAIN
        write_rig(out, fitted.applied(settings.rig), _provenance(run, shape, fitted, result.arcs), errors)
    if as_json:
        print_json(summary)
    elif not quiet:
        _print_table(run, out if written else None, fitted, result.arcs, settings.rig)
    print_verdict(run, fitted.failures, force=force, written=written)


def _drawings(fitted: Calibration) -> dict[str, Callable[[], Figure]]:
    from tssgeom.view.figures.calibration import fit_figure, phase_figure

    return {"fit": lambda: fit_figure(fitted), "phase": lambda: phase_figure(fitted)}


def _estimates(fitted: Calibration) -> list[Estimate]:
    return [fitted.estimates[name] for name in _TITLES if name in fitted.estimates]


def _nominal(name: str, rig: Rig) -> float | None:
    return {"friction": rig.friction.coefficient, "compliance": rig.tendon.compliance_per_N}.get(name)


def _object(
    run: Path, shape: Path, out: Path | None, fitted: Calibration, route: Arcs, rig: Rig
) -> Calibrated:
    return {
        "run": str(run),
        "shape": str(shape),
        "rig": None if out is None else str(out),
        "passes": not fitted.failures,
        "failures": list(fitted.failures),
        "length_m": route.total_length,
        "total_angle_rad": route.total_angle,
        "total_angle_se_rad": route.total_angle_se,
        "estimates": {each.name: _estimate(each, rig) for each in _estimates(fitted)},
        "channels": [channel_object(each) for each in fitted.channels],
        "warnings": list(fitted.warnings),
    }


def _estimate(each: Estimate, rig: Rig) -> PlainEstimate:
    return {
        "value": each.value if each.observable else None,
        "ci95": [each.low, each.high] if each.observable else None,
        "unit": each.unit,
        "observable": each.observable,
        "why": each.why or None,
        "at_bound": each.at_bound,
        "nominal": _nominal(each.name, rig),
    }


def _provenance(run: Path, shape: Path, fitted: Calibration, route: Arcs) -> list[str]:
    """Return the comment at the head of the rig file: inputs with digests, the route, all estimates."""
    from tssgeom.io.results.run_record import sha256_of

    lines = [
        f"Calibrated by tssgeom {tssgeom_version()} calibrate.",
        f"Run {run.name}, SHA-256 {sha256_of(run)}",
        f"Shape {shape.name}, SHA-256 {sha256_of(shape)}",
        f"Route: L = {route.total_length:.6g} m, angle {route.total_angle:.6g} rad "
        f"± {route.total_angle_se:.2g} rad (s.e.)",
        "With 95 % intervals; the zero of δ is that of the run and stands here for information:",
        *(f"  {_TITLES[each.name]}: {_sentence(each)}" for each in _estimates(fitted)),
    ]
    lines += [f"Fails its test: {failure}" for failure in fitted.failures]
    return lines + [f"Warning: {warning}" for warning in fitted.warnings]


def _sentence(each: Estimate) -> str:
    if not each.observable:
        return "not identifiable from this run"
    return f"{each.value:.6g} {each.unit} [{each.low:.6g}, {each.high:.6g}]".replace(" 1 [", " [")


def _print_table(run: Path, out: Path | None, fitted: Calibration, route: Arcs, rig: Rig) -> None:
    rows = [_row(each, rig) for each in _estimates(fitted)]
    fits = [
        f"{each.name}: {each.count} readings met within "
        + _number(each.rms, each.unit)
        + f" rms, {each.over_noise:.3g} × their noise, {_white(each)}; "
        f"as their errors last, they count as {each.effective_count:.0f}"
        for each in fitted.channels
    ]
    title = f"{run.name} on a route of {1e3 * route.total_length:.1f} mm, Φ = {route.total_angle:.4f} rad"
    unknown = [f"{_TITLES[each.name]}: {each.why}" for each in _estimates(fitted) if each.why]
    notes = [*fits, *unknown, *([] if out is None else [f"rig: {out}"])]
    print_table(title, ("", "value", "95 % interval", "unit", "rig before"), rows, notes=notes)


def _white(each: ChannelFit) -> str:
    """Say whether the residuals of a channel are white, and what follows."""
    p = f"(p = {each.whiteness_p:.2g})"
    if each.lacks_an_effect:
        return f"not white {p}, so that the model lacks an effect"
    return f"white {p}" if each.is_white else f"not white {p}, but small"


def _row(each: Estimate, rig: Rig) -> list[str]:
    before = _nominal(each.name, rig)
    nominal = "" if before is None else f"{before:.5g}"
    unit, factor = _PRINTED_UNITS.get(each.unit, (each.unit, 1.0))
    if not each.observable:
        return [_TITLES[each.name], "not identifiable", "", unit, nominal]
    value, low, high = (f"{factor * number:.5g}" for number in (each.value, each.low, each.high))
    return [_TITLES[each.name], value, f"{low} to {high}", unit, nominal]


def _number(value: float, unit: str) -> str:
    name, factor = _PRINTED_UNITS.get(unit, (unit, 1.0))
    return f"{factor * value:.3g} {name}"
