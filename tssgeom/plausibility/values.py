"""Values of a run: signs and units by their size, beside the rig and the route."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from tssgeom.core.constants import CHANCE
from tssgeom.plausibility.kinds import Remark
from tssgeom.plausibility.limits import LIMITS
from tssgeom.plausibility.rules import remark
from tssgeom.plausibility.series import Series
from tssgeom.rig import Sensor

DISPLACEMENTS = ("displacement_in_m", "displacement_out_m")


def value_remarks(run: Series) -> Iterator[Remark]:
    """Yield what is wrong with single channels, and with their sizes beside rig and route."""
    yield from _tensions(run)
    yield from _temperature(run)
    yield from _strokes(run)
    yield from _stretch(run)
    yield from _missing(run)


def _tensions(run: Series) -> Iterator[Remark]:
    for name, values in run.tensions():
        least, most = float(np.nanmin(values)), run.most(name)
        if least < 0.0 and np.nanmedian(values) < 0.0 and -least > np.nanmax(values):
            yield remark("inverted_cell", "run", f"{name} falls to {least:g} N")
        elif least < -max(LIMITS.negative * run.span(name), CHANCE.never * run.noise[name]):
            yield remark("negative_tension", "run", f"{name} falls to {least:.3g} N")
        if run.rig is None:
            if most > LIMITS.strongest_N:
                yield remark("tension_unit", "run", f"{name} reaches {most:g} N")
        else:
            yield from _beside_rig(run, name, most)
        if run.moves(name) and run.span(name) < LIMITS.weakest_N:
            yield remark("tension_unit", "run", f"{name} varies by {run.span(name):.2g} N only")


def _beside_rig(run: Series, name: str, most: float) -> Iterator[Remark]:
    assert run.rig is not None
    strain, scale = run.rig.tendon.compliance_per_N * most, run.rig.sensors.get(name, Sensor()).full_scale
    if strain > LIMITS.usual_strain:
        rule = "strain" if strain > LIMITS.largest_strain else "high_strain"
        yield remark(
            rule, "run", f"{name} reaches {most:g} N, which would stretch the tendon by {strain:.0%}"
        )
    if scale and most > scale:
        rule = "full_scale" if most > LIMITS.gross * scale else "beyond_scale"
        yield remark(rule, "run", f"{name} reaches {most:g} N and its full scale is {scale:g} N")


def _temperature(run: Series) -> Iterator[Remark]:
    for name, values in run.channels.items():
        if not name.startswith("temperature"):
            continue
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        if high > LIMITS.hottest_C or low < -LIMITS.warmest_C:
            far = high if high > LIMITS.hottest_C else low
            yield remark("temperature", "run", f"{name} reaches {far:g} °C")
        elif high > LIMITS.warmest_C:
            yield remark("warm", "run", f"{name} reaches {high:g} °C")


def _strokes(run: Series) -> Iterator[Remark]:
    for name in DISPLACEMENTS:
        if (
            run.length is not None
            and name in run.channels
            and run.span(name) > LIMITS.largest_stroke * run.length
        ):
            yield remark(
                "stroke", "run", f"{name} moves by {run.span(name):g} m on a route of {run.length:.3g} m"
            )


def _stretch(run: Series) -> Iterator[Remark]:
    """Compare the measured stretch with the route, and with what compliance and tension give at most."""
    if run.length is None:
        return
    if (
        "elongation_m" in run.channels
        and (most := run.most("elongation_m")) > LIMITS.largest_strain * run.length
    ):
        reached = f"elongation_m reaches {most:g} m on a route of {run.length:.3g} m"
        yield remark("stretch_unit", "run", reached)
        return
    stretch, name = stretch_of(run)
    pulls = [run.span(name) for name in ("tension_in_N", "tension_out_N") if name in run.channels]
    if stretch is None or not pulls or run.rig is None:
        return
    given = run.rig.tendon.compliance_per_N * max(pulls) * run.length
    span = float(np.nanmax(stretch) - np.nanmin(stretch))
    if given <= 0.0 or span <= 0.0 or 1.0 / LIMITS.usual_stretch <= span / given <= LIMITS.usual_stretch:
        return
    changes = (
        f"{name} changes by {1e3 * span:.3g} mm where compliance and tension give up to {1e3 * given:.3g} mm"
    )
    yield remark("stretch_unit" if span > LIMITS.stretch_ratio * given else "stretch_size", "run", changes)


def stretch_of(run: Series) -> tuple[np.ndarray | None, str]:
    """Return the elongation as measured, or by both displacements, and its name; docs/model.md (44)."""
    if "elongation_m" in run.channels:
        return run.channels["elongation_m"], "elongation_m"
    if set(DISPLACEMENTS) <= run.channels.keys():
        stretch = run.channels["displacement_in_m"] - run.channels["displacement_out_m"]
        if np.isfinite(stretch).any():
            return stretch, "displacement_in_m less displacement_out_m"
    return None, ""


def _missing(run: Series) -> Iterator[Remark]:
    for name, values in run.columns.items():
        missing = int(np.count_nonzero(~np.isfinite(values)))
        if missing:
            yield remark("missing", "run", f"{name} is missing in {missing} of {len(values)} rows")


def apparent_friction(tension_in: float, tension_out: float, angle: float) -> float:
    """Return the friction coefficient that two tensions mean, if end fittings take what they may [1]."""
    left = (1.0 - LIMITS.fitting_share) * tension_in
    return math.log(left / tension_out) / angle if tension_out > 0.0 and angle > 0.0 else math.inf
