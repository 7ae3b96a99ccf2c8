"""Sample shapes and campaigns as files: small, plain text, the same bytes at every writing."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec
import numpy as np

from tssgeom.arrays import Vector
from tssgeom.atomic import replacing, write_text
from tssgeom.identify.synthetic import BELIEVED, TRUE, SampleCampaign, SampleRun
from tssgeom.io.formats.files import CAMPAIGN
from tssgeom.io.formats.recording import PER_METRE
from tssgeom.rig import write_rig
from tssgeom.route.synthetic import Sample, Tube

_PER_METRE = PER_METRE["mm"]
_EXACT, _NOISY = 9, 3
"""Digits after the point of a coordinate in mm, without and with noise."""

_README = """\
# Sample shapes

Made by `tssgeom samples`, bit for bit; the code is in `tssgeom/route/synthetic.py`. Every file
runs from the proximal to the distal end. The noise is the standard deviation of each coordinate.

| file | what | points | noise [mm] | true L [mm] | true Φ [rad] | true Φ [°] |
|---|---|---|---|---|---|---|
{rows}

Truth of a recording is that of its last frame.

- `.csv`: columns `x_mm`, `y_mm`, `z_mm`: coordinates in mm, a row for each point.
- `.jsonl`: a frame each line: `t` time [s], `points` [mm], `unit`, `tension_in_N` proximal tension [N].
- `{lumen}`: triangle mesh of the wall around the routes whose names begin with `{prefix}`, in mm.
"""

_DIGITS = {"time_s": 6, "tension_in_N": 2, "tension_out_N": 2, "elongation_m": 6, "displacement_in_m": 7}
"""Digits after the point: what each channel resolves."""

_README_OF_CAMPAIGNS = """
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


def write_samples(
    folder: Path, samples: Sequence[Sample], lumen: Tube, campaigns: Sequence[SampleCampaign] = ()
) -> list[Path]:
    """Write every sample, the lumen mesh and a README with the truth of each; return the written files.

    Raises SourceError where the disk refuses.
    """
    written = [_write_sample(folder, sample) for sample in samples]
    mesh = folder / f"{lumen.name}.ply"
    _write_mesh(mesh, lumen)
    readme = folder / "README.md"
    rows = "\n".join(_row(path, sample) for path, sample in zip(written, samples, strict=True))
    prefix = lumen.name.removesuffix("_lumen")
    text = _README.format(rows=rows, lumen=mesh.name, prefix=prefix)
    write_text(readme, text + _readme_of(campaigns) * bool(campaigns))
    of_campaigns = (path for each in campaigns for path in _write_campaign(folder / each.name, each))
    return [*written, mesh, readme, *of_campaigns]


def _write_sample(folder: Path, sample: Sample) -> Path:
    if sample.time is None:
        path = folder / f"{sample.name}.csv"
        digits = _digits(sample)
        write_text(path, _csv(_rounded(sample.points, digits), digits))
    else:
        path = folder / f"{sample.name}.jsonl"
        write_text(path, _json_lines(sample))
    return path


def _csv(points: np.ndarray, digits: int) -> str:
    """Return rows of coordinates [mm]."""
    rows = (",".join(f"{coordinate:.{digits}f}" for coordinate in point) for point in points)
    return "\n".join(["x_mm,y_mm,z_mm", *rows]) + "\n"


def _json_lines(sample: Sample) -> str:
    assert sample.time is not None
    tension = np.full(len(sample.time), np.nan) if sample.tension_in is None else sample.tension_in
    lines = []
    for time, points, pull in zip(
        sample.time, _rounded(sample.points, _digits(sample)), tension, strict=True
    ):
        line = {"t": round(float(time), 6), "points": points.tolist(), "unit": "mm"}
        driven = {} if math.isnan(pull) else {"tension_in_N": round(float(pull), 6)}
        lines.append(json.dumps(line | driven, separators=(",", ":")))
    return "\n".join(lines) + "\n"


def _digits(sample: Sample) -> int:
    return _NOISY if sample.noise else _EXACT


def _rounded(points: np.ndarray, digits: int) -> np.ndarray:
    """Return coordinates [m] in mm; the sum with 0 turns -0 into 0."""
    return np.round(_PER_METRE * points, digits) + 0.0


def _write_mesh(path: Path, tube: Tube) -> None:
    import trimesh

    vertices = _rounded(tube.vertices, _NOISY)
    with replacing(path) as draft:
        trimesh.Trimesh(vertices, tube.faces, process=False).export(draft, vertex_normal=False)


def _row(path: Path, sample: Sample) -> str:
    points = sample.points.shape[-2]
    many = f"{points} × {len(sample.points)} frames" if sample.time is not None else f"{points}"
    noise, length, angle = 1e3 * sample.noise, 1e3 * sample.total_length, sample.total_angle
    truth = f"{length:.2f} | {angle:.5f} | {math.degrees(angle):.2f}"
    return f"| `{path.name}` | {sample.text} | {many} | {noise:g} | {truth} |"


def _readme_of(campaigns: Sequence[SampleCampaign]) -> str:
    """Return the section of the README about the campaigns."""
    return _README_OF_CAMPAIGNS.format(
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
    write_rig(written[0], BELIEVED, ["The nominal rig."])
    write_text(written[1], _listing(campaign.runs))
    for name, points in campaign.routes.items():
        written.append(folder / f"route_{name}.csv")
        write_text(written[-1], _csv(_rounded(points, _NOISY), _NOISY))
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


def _table(columns: Mapping[str, Vector]) -> str:
    cells = [[f"{value:.{_DIGITS[name]}f}" for value in values] for name, values in columns.items()]
    return "\n".join([",".join(columns), *(",".join(row) for row in zip(*cells, strict=True))]) + "\n"
