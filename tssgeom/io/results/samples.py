"""Sample shapes as files: small, in mm, the same bytes at every writing."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh

from tssgeom.atomic import replacing, write_text
from tssgeom.identify.synthetic import SampleCampaign
from tssgeom.io.formats.units import PER_METRE
from tssgeom.io.results.sample_campaigns import readme_of, write_campaigns
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


def write_samples(
    folder: Path, samples: Sequence[Sample], lumen: Tube, campaigns: Sequence[SampleCampaign] = ()
) -> list[Path]:
    """Write every sample, the lumen mesh and a README with the truth of each; return what was written.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    written = [_write_sample(folder, sample) for sample in samples]
    mesh = folder / f"{lumen.name}.ply"
    _write_mesh(mesh, lumen)
    readme = folder / "README.md"
    rows = "\n".join(_row(path, sample) for path, sample in zip(written, samples, strict=True))
    prefix = lumen.name.removesuffix("_lumen")
    text = _README.format(rows=rows, lumen=mesh.name, prefix=prefix)
    write_text(readme, text + readme_of(campaigns) * bool(campaigns))
    return [*written, mesh, readme, *write_campaigns(folder, campaigns)]


def _write_sample(folder: Path, sample: Sample) -> Path:
    if sample.time is None:
        path = folder / f"{sample.name}.csv"
        write_text(path, _csv(_rounded(sample), _digits(sample)))
    else:
        path = folder / f"{sample.name}.jsonl"
        write_text(path, _json_lines(sample))
    return path


def _csv(points: np.ndarray, digits: int) -> str:
    rows = (",".join(f"{coordinate:.{digits}f}" for coordinate in point) for point in points)
    return "\n".join(["x_mm,y_mm,z_mm", *rows]) + "\n"


def _json_lines(sample: Sample) -> str:
    assert sample.time is not None
    tension = np.full(len(sample.time), np.nan) if sample.tension_in is None else sample.tension_in
    lines = []
    for time, points, pull in zip(sample.time, _rounded(sample), tension, strict=True):
        line = {"t": round(float(time), 6), "points": points.tolist(), "unit": "mm"}
        driven = {} if math.isnan(pull) else {"tension_in_N": round(float(pull), 6)}
        lines.append(json.dumps(line | driven, separators=(",", ":")))
    return "\n".join(lines) + "\n"


def _digits(sample: Sample) -> int:
    return _NOISY if sample.noise else _EXACT


def _rounded(sample: Sample) -> np.ndarray:
    """Return coordinates in mm; the sum with 0 turns -0 into 0."""
    return np.round(_PER_METRE * sample.points, _digits(sample)) + 0.0


def _write_mesh(path: Path, tube: Tube) -> None:
    vertices = np.round(_PER_METRE * tube.vertices, _NOISY) + 0.0
    with replacing(path) as draft:
        trimesh.Trimesh(vertices, tube.faces, process=False).export(draft, vertex_normal=False)


def _row(path: Path, sample: Sample) -> str:
    points = sample.points.shape[-2]
    many = f"{points} × {len(sample.points)} frames" if sample.time is not None else f"{points}"
    noise, length, angle = 1e3 * sample.noise, 1e3 * sample.total_length, sample.total_angle
    truth = f"{length:.2f} | {angle:.5f} | {math.degrees(angle):.2f}"
    return f"| `{path.name}` | {sample.text} | {many} | {noise:g} | {truth} |"
