"""`tssgeom calibrate`: friction, compliance and zeros of a rig from a pull and release on a known shape."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pipelines.console import complain, say, show
from pipelines.runs import naming
from pipelines.version import tssgeom_version
from pipelines.work import Options, analysis_of, geometry_alone
from tssgeom.errors import SettingsError, require_replaceable
from tssgeom.identify.calibrated_run import Measured
from tssgeom.identify.calibration import Calibration, Estimate, calibrate
from tssgeom.io.formats.rigs import write_rig
from tssgeom.io.formats.runs import MeasuredRun, read_run
from tssgeom.io.results.run_record import sha256_of
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs

_TITLES = {
    "friction": "friction coefficient μ",
    "compliance": "compliance ρ",
    "tension_out_offset": "T_out reads too much by",
    "elongation_offset": "δ reads too much by",
    "take_up": "slack taken up, d_0",
    "take_up_tension": "over a tension of, T_s",
}
_SHOWN = {"m": ("mm", 1e3)}


def run(
    run_file: Path,
    shape: Path,
    chosen: Options,
    *,
    out: Path,
    from_tension: float,
    as_json: bool,
    quiet: bool,
) -> int:
    """Fit the run, write the rig and tell what was found; return the exit status.

    Raises
    ------
    SettingsError, ShapeError, SourceError, FitError
        Where an input cannot be used, the run tells nothing, or the disk refuses.
    """
    if out.is_dir():
        raise SettingsError(f"--out {out} is a folder: name the rig file, such as {out / 'rig.toml'}")
    require_replaceable(out)
    measured = read_run(run_file)
    analysis = analysis_of(shape.stem, shape, geometry_alone(chosen))
    route = analysis.results[-1].arcs
    with naming(run_file, shape):
        found = calibrate(_columns(measured), route, chosen.rig, from_tension=from_tension)
    fresh = {name for name in ("friction", "compliance") if found.estimates[name].observable}
    if not fresh:
        raise SettingsError(
            f"{run_file}: neither friction nor compliance can be told from it: record a pull and a release "
            "with tension_in_N and tension_out_N or elongation_m"
        )
    write_rig(out, found.applied(chosen.rig), _provenance(run_file, shape, found, route))
    for warning in (*analysis.results[-1].warnings, *found.warnings):
        complain(f"{run_file}: warning: {warning}")
    if as_json:
        say(json.dumps(_object(run_file, shape, out, found, route, chosen.rig), indent=1, ensure_ascii=False))
    elif not quiet:
        _show(run_file, out, found, route, chosen.rig)
    return 0


def _columns(run: MeasuredRun) -> Measured:
    elongation = run.elongation
    if elongation is None and run.displacement_in is not None and run.displacement_out is not None:
        elongation = run.displacement_in - run.displacement_out  # docs/model.md (44)
    return Measured(
        run.time, run.tension_in, run.displacement_in, run.tension_out, elongation, run.temperature
    )


def _told(found: Calibration) -> list[Estimate]:
    return [found.estimates[name] for name in _TITLES if name in found.estimates]


def _nominal(name: str, rig: Rig) -> float | None:
    return {"friction": rig.friction.coefficient, "compliance": rig.tendon.compliance_per_N}.get(name)


def _object(
    run_file: Path, shape: Path, out: Path, found: Calibration, route: Arcs, rig: Rig
) -> dict[str, Any]:
    return {
        "run": str(run_file),
        "shape": str(shape),
        "rig": str(out),
        "length_m": route.total_length,
        "total_angle_rad": route.total_angle,
        "total_angle_se_rad": route.total_angle_se,
        "estimates": {each.name: _estimate(each, rig) for each in _told(found)},
        "channels": [
            {
                "name": each.name,
                "unit": each.unit,
                "rms": each.rms,
                "readings": each.count,
                "effective_readings": each.effective_count,
            }
            for each in found.channels
        ],
        "warnings": list(found.warnings),
    }


def _estimate(each: Estimate, rig: Rig) -> dict[str, Any]:
    told = {"value": each.value, "ci95": [each.low, each.high]}
    untold = {"value": None, "ci95": None}
    seen = told if each.observable else untold
    return {**seen, "unit": each.unit, "observable": each.observable, "nominal": _nominal(each.name, rig)}


def _provenance(run_file: Path, shape: Path, found: Calibration, route: Arcs) -> list[str]:
    lines = [
        f"Calibrated by tssgeom {tssgeom_version()} calibrate.",
        f"Run {run_file.name}, SHA-256 {sha256_of(run_file)}",
        f"Shape {shape.name}, SHA-256 {sha256_of(shape)}",
        f"Route: L = {route.total_length:.6g} m, angle {route.total_angle:.6g} rad "
        f"± {route.total_angle_se:.2g} rad (s.e.)",
        "With 95 % intervals; zeros are those of the run and stand here for information:",
        *(f"  {_TITLES[each.name]}: {_sentence(each)}" for each in _told(found)),
    ]
    return lines + [f"Warning: {warning}" for warning in found.warnings]


def _sentence(each: Estimate) -> str:
    if not each.observable:
        return "this run does not tell"
    return f"{each.value:.6g} {each.unit} [{each.low:.6g}, {each.high:.6g}]".replace(" 1 [", " [")


def _show(run_file: Path, out: Path, found: Calibration, route: Arcs, rig: Rig) -> None:
    rows = [_row(each, rig) for each in _told(found)]
    fits = [
        f"{each.name}: {each.count} readings met within "
        + _number(each.rms, each.unit)
        + f" rms; as their errors last, they count as {each.effective_count:.0f}"
        for each in found.channels
    ]
    title = (
        f"{run_file.name} on a route of {1e3 * route.total_length:.1f} mm, Φ = {route.total_angle:.4f} rad"
    )
    show(title, ("", "value", "95 % interval", "unit", "rig before"), rows, notes=[*fits, f"rig: {out}"])


def _row(each: Estimate, rig: Rig) -> list[str]:
    before = _nominal(each.name, rig)
    nominal = "" if before is None else f"{before:.5g}"
    unit, factor = _SHOWN.get(each.unit, (each.unit, 1.0))
    if not each.observable:
        return [_TITLES[each.name], "not told", "", unit, nominal]
    value, low, high = (f"{factor * number:.5g}" for number in (each.value, each.low, each.high))
    return [_TITLES[each.name], value, f"{low} to {high}", unit, nominal]


def _number(value: float, unit: str) -> str:
    name, factor = _SHOWN.get(unit, (unit, 1.0))
    return f"{factor * value:.3g} {name}"
