"""`tssgeom remedy`: the added curve of Theorem 3 for a rig and a shape, with its price.

What it needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipelines.options import TENSION_IN, FigureStyle, Json, Map, Quiet, RigFile, Unit
from pipelines.terminal import counted_progress, json_text, print_json, print_message, print_table
from tssgeom.view.figures.style import choose

if TYPE_CHECKING:
    import tssgeom.io.results.keys.designs as keys
    from pipelines.inputs import RunSettings
    from tssgeom.tendon.design import Advice, Curve, Cycle, Perturbation, Tried
    from tssgeom.tendon.design_table import Case

_EQUAL_SHARE = 0.02
"""Change of |Δδ| over |Δδ| without the curve that counts as none, in the sentences only [1]; chosen."""


def remedy(
    shape: Annotated[Path, typer.Option("--shape", help="Shape of the route behind the added curve.")],
    rig: RigFile = None,
    tension_in: Annotated[
        float, typer.Option("--tension-in", min=0.0, help="Proximal tension at the end of the pull [N].")
    ] = TENSION_IN,
    release_to: Annotated[
        float | None,
        typer.Option(
            "--release-to",
            min=0.0,
            help="Proximal tension at the end of the release [N]; a third of --tension-in.",
        ),
    ] = None,
    beta_deg: Annotated[
        float, typer.Option("--beta-deg", min=0.0, help="Angle β of the curve in the table [°].")
    ] = 360.0,
    curvature_per_m: Annotated[
        float,
        typer.Option(
            "--curvature-per-m",
            min=1e-3,
            help="Curvature K of the curve; as sharp as the sheath allows [1/m].",
        ),
    ] = 40.0,
    tolerance_mm: Annotated[
        float | None,
        typer.Option(
            "--tolerance-mm",
            "--tolerance",
            min=0.0,
            help="Change of δ to stay below, in mm; recommends a curve.",
        ),
    ] = None,
    tolerance_percent: Annotated[
        float | None,
        typer.Option(
            "--tolerance-percent",
            min=0.0,
            help="Change of δ to stay below, in per cent of δ at the end of the pull.",
        ),
    ] = None,
    bends: Annotated[int, typer.Option("--bends", min=1, help="Unknown bends in each perturbation.")] = 2,
    bend_sd_deg: Annotated[
        float, typer.Option("--bend-sd-deg", min=0.0, help="Standard deviation of the bends' angles [°].")
    ] = 20.0,
    bend_width_mm: Annotated[
        float, typer.Option("--bend-width-mm", min=0.0, help="Length of sheath in each bend, in mm.")
    ] = 20.0,
    percentile: Annotated[
        float,
        typer.Option(
            "--percentile", min=1.0, max=100.0, help="Percentile of the changes over all perturbations."
        ),
    ] = 95.0,
    trials: Annotated[int, typer.Option("--trials", min=10, help="Number of random perturbations.")] = 500,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the random draws.")] = 1,
    most_beta_deg: Annotated[
        float, typer.Option("--most-beta-deg", min=45.0, max=3600.0, help="Largest angle to recommend [°].")
    ] = 1080.0,
    unit: Unit = None,
    columns: Map = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for figure and table.")] = None,
    style: FigureStyle = "light",
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Design the added curve of Theorem 3: what it scales down, what it costs, what it does on release.

    Unknown bends are sampled at random on the route itself. The change of T_out and δ by them is
    reported without the curve, with it at the same T_in, and with it at the same T_out.
    """
    from pipelines.inputs import as_one_tendon, run_settings
    from tssgeom.tendon.design import Curve, Cycle, Perturbation

    choose(style)
    design = Design(
        curve=Curve(math.radians(beta_deg), curvature_per_m),
        cycle=Cycle(tension_in, tension_in / 3 if release_to is None else release_to),
        perturbation=Perturbation(bends, math.radians(bend_sd_deg), 1e-3 * bend_width_mm),
        trials=trials,
        seed=seed,
        percentile=percentile,
        most=math.radians(most_beta_deg),
        tolerance=None if tolerance_mm is None else 1e-3 * tolerance_mm,
        tolerance_share=None if tolerance_percent is None else 1e-2 * tolerance_percent,
    )
    settings = as_one_tendon(run_settings(rig, tension_in, unit, columns=columns))
    _require_usable(design, settings)
    remedied = _swept(shape, settings, design, quiet=quiet or as_json)
    report = _object(shape, design, remedied)
    if out is not None:
        _write(out, report, design, remedied)
    if as_json:
        print_json(report)
    elif not quiet:
        _print_table(shape, design, remedied)


@dataclass(frozen=True, slots=True)
class Design:
    """What the user chose, in SI."""

    curve: Curve
    cycle: Cycle
    perturbation: Perturbation
    trials: int
    seed: int
    percentile: float
    most: float
    """Largest angle that is tried [rad]."""
    tolerance: float | None
    """Of the elongation [m]; None where none is given."""
    tolerance_share: float | None
    """The same over the elongation at the end of the pull without the curve [1]."""


@dataclass(frozen=True, slots=True)
class Remedied:
    """What the curve does to the route."""

    cases: list[Case]
    """Without the curve, with it at the same T_in, with it at the same T_out."""
    tried: list[Tried]
    """Curves of rising angle."""
    tolerance: float | None
    """Of the elongation [m]."""
    advice: Advice | None
    sentences: list[str]


def _require_usable(design: Design, settings: RunSettings) -> None:
    """Raise SettingsError where options or rig cannot be used."""
    from tssgeom.effects import named
    from tssgeom.errors import SettingsError

    cycle = design.cycle
    if not 0.0 < cycle.release_to < cycle.tension_in:
        raise SettingsError(
            f"--release-to is {cycle.release_to:g} N: give more than 0 N and less than the pull, "
            f"{cycle.tension_in:g} N"
        )
    if design.tolerance is not None and design.tolerance_share is not None:
        raise SettingsError("--tolerance-mm and --tolerance-percent are both given: give one")
    if settings.rig.effects:
        raise SettingsError(
            f"{settings.rig_file}: Theorem 3 has no effects, but the rig has "
            f"{named(settings.rig.effects)}: leave [[effects]] out of the rig for this command"
        )


def _swept(shape: Path, settings: RunSettings, design: Design, *, quiet: bool) -> Remedied:
    """Perturb the route at random, with and without curves of rising angle, and recommend one."""
    from pipelines.inputs import analysis_of
    from tssgeom.route.pieces import Arcs
    from tssgeom.tendon.design import advise, angles, perturbed_routes, sweep
    from tssgeom.tendon.design_table import cases

    result = analysis_of(shape.stem, shape, settings).results[-1]
    for warning in result.warnings:
        print_message(f"{shape}: warning: {warning}")
    arcs = Arcs.exact(result.arcs.length, result.arcs.angle)
    routes = perturbed_routes(arcs, design.perturbation, design.trials, design.seed)
    compared = cases(arcs, routes, settings.rig, design.curve, design.cycle, design.percentile)
    with counted_progress(len(angles(design.most)), quiet=quiet) as progress:
        tried = sweep(
            arcs,
            routes,
            settings.rig,
            design.curve.kappa,
            design.cycle,
            design.percentile,
            most=design.most,
            report=lambda curve: progress.end(f"β = {math.degrees(curve.angle):.0f}° tried"),
        )
    tolerance = _tolerance(design, tried)
    advice = None if tolerance is None else advise(tried, tolerance)
    return Remedied(compared, tried, tolerance, advice, _sentences(design, compared, advice, tolerance))


def _tolerance(design: Design, tried: list[Tried]) -> float | None:
    if design.tolerance_share is not None:
        return design.tolerance_share * tried[0].price.elongation
    return design.tolerance


def _sentences(
    design: Design, compared: list[Case], advice: Advice | None, tolerance: float | None
) -> list[str]:
    """Return in sentences what follows from the table, what is recommended, and its limits."""
    without, same_in, same_out = compared
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
        + (
            "it gains nothing."
            if same_out.pull > (1.0 - _EQUAL_SHARE) * without.pull
            else "it gains a little."
        )
    )
    sentences = [first, second]
    if same_out.released > (1.0 + _EQUAL_SHARE) * without.released:
        sentences.append(
            f"On the release to {design.cycle.release_to:g} N it then makes things worse: "
            f"{1e3 * same_out.released:.3f} mm, {1e3 * without.released:.3f} mm without."
        )
    if advice is not None and tolerance is not None:
        sentences.append(_recommendation(design, advice, tolerance))
    return sentences


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
    geometry = (
        f"β = {math.degrees(curve.angle):.0f}°, K = {curve.kappa:g}/m ({1e3 * curve.length:.0f} mm of sheath)"
    )
    price = (
        f"T_out {cost.tension_out:.2f} N at {design.cycle.tension_in:g} N, "
        f"{1e3 * cost.own_elongation:.3f} mm more δ"
    )
    limit = " on pulling only, not on release" if advice.verdict == "pull only" else ""
    return f"{wanted}{limit}: {geometry}; price: {price}."


def _object(shape: Path, design: Design, remedied: Remedied) -> keys.Remedied:
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
        "cases": {case.name: case.numbers() for case in remedied.cases},
        "sweep": [_tried(each) for each in remedied.tried],
        "tolerance_m": remedied.tolerance,
        "recommendation": None if remedied.advice is None else _advice(remedied.advice),
        "words": remedied.sentences,
    }


def _tried(each: Tried) -> keys.TriedCurve:
    return {
        "beta_rad": each.curve.angle,
        "curvature_per_m": each.curve.kappa,
        "tension_out_N": each.price.tension_out,
        "own_elongation_m": each.price.own_elongation,
        "pull_elongation_change_m": each.disturbed.pull,
        "worst_elongation_change_m": each.disturbed.worst,
        "pull_tension_out_change_N": float(each.disturbed.tension[0]),
    }


def _advice(advice: Advice) -> keys.Recommended:
    if advice.tried is None:
        return {"verdict": advice.verdict}
    return {"verdict": advice.verdict, **_tried(advice.tried)}


def _rows(compared: list[Case]) -> list[list[str]]:
    cells = [case.cells() for case in compared]
    return [[label, *(each[label] for each in cells)] for label in cells[0]]


_COLUMNS = ("", "without", "with, same T_in", "with, same T_out")


def _print_table(shape: Path, design: Design, remedied: Remedied) -> None:
    title = (
        f"{shape.name} behind a curve of β = {math.degrees(design.curve.angle):.0f}°, "
        f"K = {design.curve.kappa:g}/m; Δ: percentile {design.percentile:g} of {design.trials} draws of "
        f"{design.perturbation.bends} bends, sd {math.degrees(design.perturbation.angle_sd):g}°"
    )
    print_table(title, _COLUMNS, _rows(remedied.cases), notes=remedied.sentences)


def _write(out: Path, report: keys.Remedied, design: Design, remedied: Remedied) -> None:
    from pipelines.figures import write_figure
    from tssgeom.atomic import write_text
    from tssgeom.view.figures.commands import remedy_figure

    draw = partial(remedy_figure, remedied.tried, remedied.tolerance, design.percentile)
    write_figure(draw, out, "remedy")
    write_text(out / "remedy.json", json_text(report) + "\n")
    lines = ["| " + " | ".join(row) + " |" for row in [list(_COLUMNS), ["---"] * 4, *_rows(remedied.cases)]]
    write_text(out / "remedy.md", "\n".join(lines) + "\n\n" + "\n\n".join(remedied.sentences) + "\n")
