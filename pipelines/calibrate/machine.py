"""`tssgeom calibrate` of rigs with unknown numbers, several tendons or a joint, and of several runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pipelines import tssgeom_version
from pipelines.calibrate.report import (
    bounds_text,
    channel_object,
    estimate_object,
    estimate_title,
    print_verdict,
    sensed_arcs,
    write_report,
)
from pipelines.remarks import grouped
from pipelines.terminal import print_json, print_message, print_table, step_progress
from tssgeom.channel_names import unit_of

if TYPE_CHECKING:
    from pipelines.inputs import RunSettings
    from tssgeom.identify.machine_estimates import MachineCalibration, MachineEstimate
    from tssgeom.io.results.keys.calibrations import MachineCalibrated
    from tssgeom.view.figures.plots import Figure


def calibrate_machine(
    paths: Sequence[Path],
    shapes: Sequence[Path],
    out: Path,
    settings: RunSettings,
    *,
    folder: Path | None,
    figures: Path | None,
    with_errors: bool,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Fit a machine to runs, print the estimates, and write the rig."""
    from pipelines.runs import measured_run
    from tssgeom.api.machine_calls import fitted_machine
    from tssgeom.identify.stated import beside_stated
    from tssgeom.rig import write_rig
    from tssgeom.uncertain import CERTAIN

    arcs = sensed_arcs(shapes, settings)
    runs = [measured_run(path, settings) for path in paths]
    with step_progress(quiet=quiet or as_json) as report_step:
        fitted = fitted_machine(runs, arcs, settings.rig, settings.uncertain, report_step)
        fitted = beside_stated(fitted, settings.rig, settings.rig_file)
        report_step("done", 1.0)
    for warning in _warnings(fitted):
        print_message(f"{paths[0]}: warning: {warning}")
    written = force or not fitted.failures
    summary = _object(paths, shapes, out if written else None, fitted)
    write_report(paths[0].stem, folder, figures, summary, _drawings(fitted))
    if written:
        errors = fitted.errors if with_errors else CERTAIN
        write_rig(out, fitted.rig, _provenance(paths, shapes, fitted), errors)
    if as_json:
        print_json(summary)
    elif not quiet:
        _print(paths, out if written else None, fitted)
    print_verdict(paths[0], fitted.failures, force=force, written=written)


def _drawings(fitted: MachineCalibration) -> dict[str, Callable[[], Figure]]:
    from tssgeom.view.figures.machine import bends_figure, loop_figure, run_figure

    drawings: dict[str, Callable[[], Figure]] = {"loop": lambda: loop_figure(fitted)}
    if fitted.bends:
        drawings["bends"] = lambda: bends_figure(fitted)
    for k, run in enumerate(fitted.runs):
        name = "fit" if len(fitted.runs) == 1 else f"fit_{run.name}"
        drawings[name] = partial(run_figure, fitted, k)
    return drawings


def _object(
    paths: Sequence[Path], shapes: Sequence[Path], out: Path | None, fitted: MachineCalibration
) -> MachineCalibrated:
    """Return what `--json` prints."""
    return {
        "run": str(paths[0]),
        "runs": [str(path) for path in paths],
        "shape": str(shapes[0]) if shapes else None,
        "rig": None if out is None else str(out),
        "passes": not fitted.failures,
        "failures": list(fitted.failures),
        "estimates": {each.name: estimate_object(each) for each in fitted.estimates},
        "friction_angle": estimate_object(fitted.friction_angle),
        "bends": [estimate_object(each) for each in fitted.bends],
        "tied": list(fitted.tied),
        "held_out": {
            name: {"rms": away, "fitted_rms": inside, "unit": unit_of(name)}
            for name, (away, inside) in fitted.held_out.items()
        },
        "channels": [channel_object(each) for each in fitted.channels],
        "warnings": list(fitted.warnings),
    }


def _provenance(paths: Sequence[Path], shapes: Sequence[Path], fitted: MachineCalibration) -> list[str]:
    """Return the comment at the head of the rig file: inputs with digests, and all estimates."""
    from tssgeom.io.results.run_record import sha256_of

    lines = [f"Calibrated by tssgeom {tssgeom_version()} calibrate."]
    for kind, files in (("Run", paths), ("Shape", shapes)):
        lines += [f"{kind} {path.name}, SHA-256 {sha256_of(path)}" for path in files]
    lines.append("With 95 % intervals; what is not identified stands near what was assumed:")
    lines += [f"  {estimate_title(each)}: {_sentence(each)}" for each in _listed(fitted)]
    lines += [f"Tied: {each}" for each in fitted.tied]
    lines += [f"Fails its test: {failure}" for failure in fitted.failures]
    return lines + [f"Warning: {warning}" for warning in _warnings(fitted)]


def _warnings(fitted: MachineCalibration) -> Sequence[str]:
    return grouped(fitted.warnings, [run.name for run in fitted.runs])


def _listed(fitted: MachineCalibration) -> list[MachineEstimate]:
    """Return what is printed: numbers of the rig, and those of runs and routes that are identified."""
    return [each for each in fitted.estimates if each.key or each.identified]


def _sentence(each: MachineEstimate) -> str:
    if not each.identified:
        assumed = f"not identified; assumed {each.assumed[0]:.4g} to {each.assumed[1]:.4g} {each.unit}"
        if beyond := bounds_text(each):
            assumed = assumed.replace(";", f", {beyond};")
        return assumed.removesuffix(" 1")
    return f"{each.value:.6g} {each.unit} [{each.low:.6g}, {each.high:.6g}]".replace(" 1 [", " [")


def _print(paths: Sequence[Path], out: Path | None, fitted: MachineCalibration) -> None:
    from tssgeom.tendon.machine_simulation import drive_channels

    rows = []
    listed = _listed(fitted)
    hidden = len(fitted.estimates) - len(listed)
    for each in (*listed, fitted.friction_angle):
        assumed = f"{each.assumed[0]:.4g} to {each.assumed[1]:.4g}"
        held = (
            [f"{each.value:.5g}", f"{each.low:.5g} to {each.high:.5g}"]
            if each.identified
            else ["not identified", bounds_text(each)]
        )
        rows.append([estimate_title(each), *held, each.unit, assumed])
    notes = (
        [f"not identified, and not listed: {hidden} numbers of runs and routes (--json)"] if hidden else []
    )
    if fitted.bends:
        shares = ", ".join(f"{each.value:.0%}" for each in fitted.bends)
        notes.append(f"neither rig nor shape says where the sheath bends; parts of its angle: {shares}")
    notes += [
        *fitted.tied,
        *(
            f"{each.name}: {each.count} readings met within {each.rms:.3g} {each.unit} rms, "
            f"{each.over_noise:.3g} × their noise; they count as {each.effective_count:.0f} independent ones"
            for each in fitted.channels
        ),
    ]
    of = fitted.held.of
    for name, (away, inside) in fitted.held_out.items():
        notes.append(f"{name}: {away:.3g} {unit_of(name)} rms on {of} held out, {inside:.3g} on those fitted")
    notes += [] if out is None else [f"rig: {out}"]
    names = paths[0].name if len(paths) == 1 else f"{len(paths)} runs, {paths[0].name} …"
    drives = [channel for run in fitted.runs for channel in drive_channels(run.drive, run.tendons)]
    names += f", driven by {' and '.join(dict.fromkeys(drives))}"
    print_table(names, ("", "value", "95 % interval", "unit", "assumed"), rows, notes=notes)
