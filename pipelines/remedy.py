"""`tssgeom remedy`: the added curve of Theorem 3 for a rig and a shape, with its price."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipelines.console import complain, say, show, tracking
from pipelines.drawing import write_figure
from pipelines.work import Options, analysis_of
from tssgeom.atomic import write_text
from tssgeom.effects import named
from tssgeom.errors import SettingsError
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.design import (
    Advice,
    Curve,
    Cycle,
    Perturbation,
    Tried,
    advise,
    angles,
    perturbed_routes,
    sweep,
)
from tssgeom.tendon.design_table import Case, cases


@dataclass(frozen=True, slots=True)
class Design:
    """What the user asked for, in SI."""

    curve: Curve
    cycle: Cycle
    perturbation: Perturbation
    trials: int
    seed: int
    percentile: float
    most: float
    """Largest angle that is tried [rad]."""
    tolerance: float | None
    """Of the elongation [m]; None where none is asked for."""
    tolerance_share: float | None
    """The same over the elongation at the end of the pull without the curve [1]."""


def run(shape: Path, chosen: Options, design: Design, *, out: Path | None, as_json: bool, quiet: bool) -> int:
    """Tell what the curve does to the route, recommend one, and return the exit status.

    Raises
    ------
    SettingsError, ShapeError, SourceError
        Where an option or the shape cannot be used, or the disk refuses.
    """
    _check(design)
    if chosen.rig.effects:
        raise SettingsError(
            f"{chosen.rig_file}: Theorem 3 knows no effects, but the rig has {named(chosen.rig.effects)}: "
            "leave [[effects]] out of the rig for this command"
        )
    result = analysis_of(shape.stem, shape, chosen).results[-1]
    for warning in result.warnings:
        complain(f"{shape}: warning: {warning}")
    arcs = Arcs.exact(result.arcs.length, result.arcs.angle)
    routes = perturbed_routes(arcs, design.perturbation, design.trials, design.seed)
    found = cases(arcs, routes, chosen.rig, design.curve, design.cycle, design.percentile)
    with tracking(len(angles(design.most)), quiet=quiet or as_json) as tracker:
        tried = sweep(
            arcs,
            routes,
            chosen.rig,
            design.curve.kappa,
            design.cycle,
            design.percentile,
            most=design.most,
            tell=lambda curve: tracker.end(f"β = {math.degrees(curve.angle):.0f}° tried"),
        )
    tolerance = _tolerance(design, tried)
    advice = None if tolerance is None else advise(tried, tolerance)
    words = _sentences(design, found, advice, tolerance)
    told = _object(shape, design, found, tried, advice, tolerance, words)
    if out is not None:
        _write(out, told, found, tried, tolerance, design, words)
    if as_json:
        say(json.dumps(told, indent=1, ensure_ascii=False, allow_nan=False))
    elif not quiet:
        _show(shape, found, design, words)
    return 0


def _check(design: Design) -> None:
    cycle = design.cycle
    if not 0.0 < cycle.release_to < cycle.tension_in:
        raise SettingsError(
            f"--release-to is {cycle.release_to:g} N: give more than 0 N and less than the pull, "
            f"{cycle.tension_in:g} N"
        )
    if design.tolerance is not None and design.tolerance_share is not None:
        raise SettingsError("--tolerance-mm and --tolerance-percent are both given: give one")


def _tolerance(design: Design, tried: list[Tried]) -> float | None:
    if design.tolerance_share is not None:
        return design.tolerance_share * tried[0].price.elongation
    return design.tolerance


def _sentences(
    design: Design, found: list[Case], advice: Advice | None, tolerance: float | None
) -> list[str]:
    """Say what follows from the table, what is recommended, and what it does not do."""
    without, same_in, same_out = found
    first = (
        "At the same T_in the curve scales what perturbations change on pulling by "
        f"S = {same_in.scaling:.3f}; when all of it releases, it amplifies by "
        f"1/S = {1 / same_in.scaling:.2f}. "
        f"It adds {1e3 * same_in.price.own_elongation:.3f} mm of its own elongation and takes "
        f"{without.price.tension_out - same_in.price.tension_out:.2f} N of T_out."
    )
    second = (
        f"For the T_out of before, T_in has to be {same_out.cycle.tension_in:.2f} N; then "
        f"|Δδ| is {1e3 * same_out.pull:.3f} mm on pulling where it was {1e3 * without.pull:.3f} mm without: "
        + ("it gains nothing." if same_out.pull > 0.98 * without.pull else "it gains a little.")
    )
    told = [first, second]
    if same_out.released > 1.02 * without.released:
        told.append(
            f"On the release to {design.cycle.release_to:g} N it then makes things worse: "
            f"{1e3 * same_out.released:.3f} mm, {1e3 * without.released:.3f} mm without."
        )
    if advice is not None and tolerance is not None:
        told.append(_recommendation(design, advice, tolerance))
    return told


def _recommendation(design: Design, advice: Advice, tolerance: float) -> str:
    wanted = f"|Δδ| ≤ {1e3 * tolerance:.3g} mm at percentile {design.percentile:g}"
    if advice.verdict == "none needed":
        return f"{wanted}: no curve is needed."
    if advice.tried is None:
        return (
            f"{wanted}: no curve of up to {math.degrees(design.most):.0f}° reaches it; "
            "sense the route, or lower T_in or the friction."
        )
    curve, cost = advice.tried.curve, advice.tried.price
    place = (
        f"β = {math.degrees(curve.angle):.0f}°, K = {curve.kappa:g}/m ({1e3 * curve.length:.0f} mm of sheath)"
    )
    price = (
        f"T_out {cost.tension_out:.2f} N at {design.cycle.tension_in:g} N, "
        f"{1e3 * cost.own_elongation:.3f} mm more δ"
    )
    limit = " on pulling only, not on release" if advice.verdict == "pull only" else ""
    return f"{wanted}{limit}: {place}; price: {price}."


def _object(
    shape: Path,
    design: Design,
    found: list[Case],
    tried: list[Tried],
    advice: Advice | None,
    tolerance: float | None,
    words: list[str],
) -> dict[str, Any]:
    return {
        "shape": str(shape),
        "beta_rad": design.curve.angle,
        "curvature_per_m": design.curve.kappa,
        "perturbation": {
            "bends": design.perturbation.bends,
            "bend_sd_rad": design.perturbation.angle_sd,
            "bend_width_m": design.perturbation.width,
            "trials": design.trials,
            "seed": design.seed,
            "percentile": design.percentile,
        },
        "cases": {case.name: case.numbers() for case in found},
        "sweep": [_tried(each) for each in tried],
        "tolerance_m": tolerance,
        "recommendation": None if advice is None else _advice(advice),
        "words": words,
    }


def _tried(each: Tried) -> dict[str, float]:
    return {
        "beta_rad": each.curve.angle,
        "curvature_per_m": each.curve.kappa,
        "tension_out_N": each.price.tension_out,
        "own_elongation_m": each.price.own_elongation,
        "pull_elongation_change_m": each.disturbed.pull,
        "worst_elongation_change_m": each.disturbed.worst,
        "pull_tension_out_change_N": float(each.disturbed.tension[0]),
    }


def _advice(advice: Advice) -> dict[str, Any]:
    return {"verdict": advice.verdict, **({} if advice.tried is None else _tried(advice.tried))}


def _rows(found: list[Case]) -> list[list[str]]:
    cells = [case.cells() for case in found]
    return [[label, *(each[label] for each in cells)] for label in cells[0]]


_COLUMNS = ("", "without", "with, same T_in", "with, same T_out")


def _show(shape: Path, found: list[Case], design: Design, words: list[str]) -> None:
    title = (
        f"{shape.name} behind a curve of β = {math.degrees(design.curve.angle):.0f}°, "
        f"K = {design.curve.kappa:g}/m; Δ: percentile {design.percentile:g} of {design.trials} draws of "
        f"{design.perturbation.bends} bends, sd {math.degrees(design.perturbation.angle_sd):g}°"
    )
    show(title, _COLUMNS, _rows(found), notes=words)


def _write(
    out: Path,
    told: dict[str, Any],
    found: list[Case],
    tried: list[Tried],
    tolerance: float | None,
    design: Design,
    words: list[str],
) -> None:
    from tssgeom.view.figures.remedy import remedy_figure

    write_figure(remedy_figure(tried, tolerance, design.percentile), out, "remedy")
    write_text(out / "remedy.json", json.dumps(told, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
    lines = ["| " + " | ".join(row) + " |" for row in [list(_COLUMNS), ["---"] * 4, *_rows(found)]]
    write_text(out / "remedy.md", "\n".join(lines) + "\n\n" + "\n\n".join(words) + "\n")
