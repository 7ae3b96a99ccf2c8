"""Sample campaigns as folders: plain CSV and TOML, the same bytes at every writing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec
import numpy as np

from tssgeom.arrays import Points, Vector
from tssgeom.atomic import write_text
from tssgeom.identify.synthetic import BELIEVED, TRUE, SampleCampaign, SampleRun
from tssgeom.io.formats.files import CAMPAIGN
from tssgeom.io.formats.rigs import write_rig
from tssgeom.io.formats.units import PER_METRE

_DIGITS = {"time_s": 6, "tension_in_N": 2, "tension_out_N": 2, "elongation_m": 6, "displacement_in_m": 7}
"""Digits after the point: what each channel resolves."""

_README = """
## Campaigns

For `tssgeom discover`; the code is in `tssgeom/identify/synthetic.py`. Five runs each, on a half
circle, on setup A and, held out, on a route in space. The rig file holds what its owner believes: μ =
{believed_friction:g} and ρ = {believed_compliance:g} /N. True are μ = {friction:g} and ρ =
{compliance:g} /N, and what the table says.

| folder | what acts | truth |
|---|---|---|
{rows}

The data are the model's own, with eight times the bars that a fit uses, small steps, and instruments
with noise, digits, a bent scale and zeros of the day. They show how to use the workflow and prove
nothing about it; for that there is `python -m benchmarks.discovery`, on a simulator that shares no code
with the model.
"""


def write_campaigns(folder: Path, campaigns: Sequence[SampleCampaign]) -> list[Path]:
    """Write a folder for each campaign, and return what was written.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    return [path for campaign in campaigns for path in _write_campaign(folder / campaign.name, campaign)]


def readme_of(campaigns: Sequence[SampleCampaign]) -> str:
    """Return what the README of the samples says of the campaigns."""
    return _README.format(
        believed_friction=BELIEVED.friction.coefficient,
        believed_compliance=BELIEVED.tendon.compliance_per_N,
        friction=TRUE.friction.coefficient,
        compliance=TRUE.tendon.compliance_per_N,
        rows="\n".join(f"| `{each.name}` | {each.text} | {_truth(each)} |" for each in campaigns),
    )


def _truth(campaign: SampleCampaign) -> str:
    return (
        "; ".join(f"`{_inline(msgspec.to_builtins(effect))}`" for effect in campaign.effects) or "no effect"
    )


def _inline(effect: Mapping[str, float | str]) -> str:
    numbers = ", ".join(f"{key} = {value}" for key, value in effect.items() if key != "name")
    return f"{effect['name']}: {numbers}"


def _write_campaign(folder: Path, campaign: SampleCampaign) -> list[Path]:
    written = [folder / "rig.toml", folder / CAMPAIGN]
    write_rig(written[0], BELIEVED, ["What the owner of the rig believes."])
    write_text(written[1], _listing(campaign.runs))
    for name, points in campaign.routes.items():
        written.append(folder / f"route_{name}.csv")
        write_text(written[-1], _points(points))
    for run in campaign.runs:
        written.append(folder / f"{run.plan.name}.csv")
        write_text(written[-1], _table(run.columns))
    return written


def _listing(runs: Sequence[SampleRun]) -> str:
    entries = [
        f'\n[[run]]\nname = "{run.plan.name}"\ndata = "{run.plan.name}.csv"\n'
        f'shape = "route_{run.plan.route}.csv"\nheld_out = {str(run.plan.held_out).lower()}\n'
        for run in runs
    ]
    return 'rig = "rig.toml"\n' + "".join(entries)


def _points(points: Points) -> str:
    rounded = np.round(PER_METRE["mm"] * points, 3) + 0.0
    return "\n".join(["x_mm,y_mm,z_mm", *(",".join(f"{x:.3f}" for x in row) for row in rounded)]) + "\n"


def _table(columns: Mapping[str, Vector]) -> str:
    cells = [[f"{value:.{_DIGITS[name]}f}" for value in values] for name, values in columns.items()]
    return "\n".join([",".join(columns), *(",".join(row) for row in zip(*cells, strict=True))]) + "\n"
