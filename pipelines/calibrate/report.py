"""What the ways to calibrate share: the routes they read, and their reports."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from pipelines.terminal import print_message
from tssgeom.atomic import write_text

if TYPE_CHECKING:
    from pipelines.inputs import RunSettings
    from tssgeom.identify.fit_quality import ChannelFit
    from tssgeom.identify.machine_estimates import MachineEstimate
    from tssgeom.io.results.keys.calibrations import ChannelOf, MachineEstimateOf
    from tssgeom.route.pieces import Arcs
    from tssgeom.view.figures.plots import Figure

_REPORT = "calibration.json"
_TITLES = {
    "friction.coefficient": "friction coefficient μ",
    "tendon.compliance_per_N": "compliance ρ",
    "tendon.pretension_N": "pretension T_0",
    "drive.lag_s": "lag of the drive",
    "route.angle_gain": "true over sensed angle",
    "route.angle_rad": "curve angle Φ",
}


def sensed_arcs(shapes: Sequence[Path], settings: RunSettings) -> list[Arcs]:
    """Return the route of each shape, the last one of a recording."""
    from pipelines.inputs import analysis_of, without_effects

    plain = without_effects(settings)
    sensed = {
        shape: analysis_of(shape.stem, shape, plain).results[-1].arcs for shape in dict.fromkeys(shapes)
    }
    return [sensed[shape] for shape in shapes]


def write_report(
    stem: str,
    folder: Path | None,
    figures: Path | None,
    summary: object,
    drawings: dict[str, Callable[[], Figure]],
) -> None:
    """Write the report into a folder, and figures where they are wanted."""
    from pipelines.figures import write_figure, write_figures

    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / _REPORT, json.dumps(summary, indent=1, ensure_ascii=False) + "\n")
        for name, draw in drawings.items():
            write_figure(draw, folder, name)
    if figures is not None:
        figures.mkdir(parents=True, exist_ok=True)
        write_figures(figures, stem, drawings)


_REMEDY = "check signs and units (tssgeom check) and what the rig states, by the figures too (--figures DIR)"


def print_verdict(path: Path, failures: Sequence[str], *, force: bool, written: bool) -> None:
    """Say which tests a fit fails; ends with exit status 2 where no rig is written."""
    for failure in failures:
        print_message(f"{path}: {'warning: ' if force else ''}the fit fails its test: {failure}")
    if not written:
        print_message(f"{path}: no rig is written: {_REMEDY}, or give --force")
        raise typer.Exit(2)


def channel_object(each: ChannelFit) -> ChannelOf:
    """Return how well a channel is met, as `--json` prints it."""
    return {
        "name": each.name,
        "unit": each.unit,
        "rms": each.rms,
        "readings": each.count,
        "effective_readings": each.effective_count,
        "noise": each.noise,
        "rms_over_noise": each.over_noise,
        "rms_over_range": each.over_range,
        "whiteness_p": each.whiteness_p,
    }


def estimate_object(each: MachineEstimate) -> MachineEstimateOf:
    """Return a number with its interval, as `--json` prints it."""
    return {
        "value": each.value if each.identified else None,
        "ci95": [each.low, each.high] if each.identified else None,
        "unit": each.unit,
        "observable": each.identified,
        "assumed95": list(each.assumed),
        "bounds": list(each.bounds),
        "key": each.key or None,
    }


def bounds_text(each: MachineEstimate) -> str:
    """Return what a number that is not identified is beyond; empty where it may be what was assumed."""
    least, most = each.bounds
    if least is not None:
        return f"above {least:.4g}"
    return "" if most is None else f"below {most:.4g}"


def estimate_title(each: MachineEstimate) -> str:
    """Return what a number is called in tables."""
    return _TITLES.get(each.key, each.name)
