"""Checks of a measured run before a fit: impossible values are errors, implausible ones warnings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.errors import SettingsError
from tssgeom.identify.campaign import Run
from tssgeom.identify.readings import RESPONSES
from tssgeom.rig import Rig, Sensor

DRIVES = ("tension_in_N", "displacement_in_m")


@dataclass(frozen=True, slots=True)
class PlausibleRun:
    """Bounds of a measured run; a value beyond them has a wrong unit."""

    least_rows: int = 20
    """Rows with both drive and response; chosen: a fit needs more than its parameters."""
    largest_strain: float = 0.5
    """Strain of the tendon at the largest tension [1]; chosen: no tendon recovers from more."""
    largest_stroke: float = 2.0
    """Travel of a drive over the length of the route [1]; chosen."""
    stretch_ratio: float = 30.0
    """Measured stretch over that of compliance and tension, or its inverse [1]; chosen: √1000, mm for m."""
    beyond_scale: float = 3.0
    """Reading of a sensor over its full scale [1]; chosen."""
    hottest_C: float = 150.0
    """Temperature [°C]; chosen: no plastic sheath is so hot, and no room so cold in kelvin."""


PLAUSIBLE = PlausibleRun()


def check_run(path: Path, run: Run, rig: Rig) -> list[str]:
    """Return the warnings about a run, a sentence each.

    Raises
    ------
    SettingsError
        Where drive or response is missing, they share too few rows, or numbers do not fit their unit.
    """
    _check_channels(path, run)
    _check_overlap(path, run)
    _check_tensions(path, run, rig)
    _check_temperature(path, run)
    _check_strokes(path, run)
    return [*_missing_rows(run), *_stretch(path, run, rig), *_beyond_scale(run, rig)]


def _check_channels(path: Path, run: Run) -> None:
    if not any(channel in run.columns for channel in DRIVES):
        raise SettingsError(f"{path}: no drive: add a column {' or '.join(DRIVES)}")
    if sum(channel in run.columns for channel in RESPONSES) < 2:
        others = ", ".join(name for name in RESPONSES if name not in DRIVES)
        raise SettingsError(f"{path}: a drive without a response: add one of {others}")


def _check_overlap(path: Path, run: Run) -> None:
    """Refuse a run whose drive and responses were not recorded at the same times."""
    known = {name: np.isfinite(run.columns[name]) for name in RESPONSES if name in run.columns}
    shared = max(
        int(np.count_nonzero(known[drive] & known[other]))
        for drive in DRIVES
        if drive in known
        for other in known
        if other != drive
    )
    if shared < PLAUSIBLE.least_rows:
        raise SettingsError(
            f"{path}: drive and response are both there in {shared} of {len(run.columns['time_s'])} rows: "
            f"give at least {PLAUSIBLE.least_rows} rows, on one clock"
        )


def _check_tensions(path: Path, run: Run, rig: Rig) -> None:
    for name in ("tension_in_N", "tension_out_N"):
        most = _most(run, name)
        strain = rig.tendon.compliance_per_N * most
        scale = rig.sensors.get(name, Sensor()).full_scale
        if strain > PLAUSIBLE.largest_strain:
            raise SettingsError(
                f"{path}: {name} reaches {most:g} N, which would stretch the tendon by {100 * strain:.0f} %: "
                "give newtons, or mend tendon.compliance_per_N of the rig"
            )
        if scale and most > PLAUSIBLE.beyond_scale * scale:
            raise SettingsError(
                f"{path}: {name} reaches {most:g} N and its full scale is {scale:g} N: give newtons, "
                f"or mend [sensors.{name}] of the rig"
            )


def _check_temperature(path: Path, run: Run) -> None:
    most = _most(run, "temperature_C")
    if most > PLAUSIBLE.hottest_C:
        raise SettingsError(f"{path}: temperature_C reaches {most:g} °C: give degrees Celsius, not kelvin")


def _check_strokes(path: Path, run: Run) -> None:
    length = run.route.arcs.total_length
    for name in ("displacement_in_m", "displacement_out_m"):
        span = _span(run, name)
        if span > PLAUSIBLE.largest_stroke * length:
            raise SettingsError(
                f"{path}: {name} moves by {span:g} m on a route of {length:.3g} m: give metres"
            )


def _missing_rows(run: Run) -> list[str]:
    warnings = []
    for name, values in run.columns.items():
        missing = int(np.count_nonzero(~np.isfinite(values)))
        if missing:
            warnings.append(f"{run.name}: {name} is missing in {missing} of {len(values)} rows")
    return warnings


def _stretch(path: Path, run: Run, rig: Rig) -> list[str]:
    """Compare the measured stretch with the largest that compliance and tension give."""
    name = "elongation_m" if "elongation_m" in run.columns else "displacement_in_m less displacement_out_m"
    stretch = _stretch_of(run)
    pull = max(_span(run, "tension_in_N"), _span(run, "tension_out_N"))
    most = rig.tendon.compliance_per_N * pull * run.route.arcs.total_length
    span = float(np.nanmax(stretch) - np.nanmin(stretch)) if np.isfinite(stretch).any() else 0.0
    if most <= 0.0 or span <= 0.0:
        return []
    if span > PLAUSIBLE.stretch_ratio * most:
        raise SettingsError(
            f"{path}: {name} changes by {span:g} m where compliance and tension give at most {most:.2g} m: "
            "wrong unit? name the column elongation_mm, or mend tendon.compliance_per_N of the rig"
        )
    if span < most / PLAUSIBLE.stretch_ratio:
        return [
            f"{run.name}: {name} changes by {1e3 * span:.2g} mm only, where compliance and tension give up "
            f"to {1e3 * most:.2g} mm: check its unit"
        ]
    return []


def _stretch_of(run: Run) -> Vector:
    if "elongation_m" in run.columns:
        return run.columns["elongation_m"]
    ends = [run.columns.get(f"displacement_{end}_m") for end in ("in", "out")]
    return np.full(1, np.nan) if ends[0] is None or ends[1] is None else ends[0] - ends[1]


def _beyond_scale(run: Run, rig: Rig) -> list[str]:
    warnings = []
    for name in ("tension_in_N", "tension_out_N"):
        scale, most = rig.sensors.get(name, Sensor()).full_scale, _most(run, name)
        if scale and most > scale:
            warnings.append(
                f"{run.name}: {name} reads up to {most:g} N, beyond its full scale of {scale:g} N"
            )
    return warnings


def _most(run: Run, name: str) -> float:
    values = np.abs(run.columns.get(name, np.zeros(1)))
    return float(np.max(values, where=np.isfinite(values), initial=0.0))


def _span(run: Run, name: str) -> float:
    values = run.columns.get(name, np.zeros(1))
    finite = values[np.isfinite(values)]
    return float(finite.max() - finite.min()) if len(finite) else 0.0
