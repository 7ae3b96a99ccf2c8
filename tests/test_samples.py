"""The sample shapes that ship are the ones the code makes, and the program finds their truth."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipelines.cli import app
from tssgeom.route.synthetic import samples

SAMPLES = Path(__file__).resolve().parents[1] / "sample_shapes"
STILL = [sample for sample in samples() if sample.time is None]


def test_samples_are_written_bit_for_bit(tmp_path):
    assert CliRunner().invoke(app, ["samples", "--out", str(tmp_path)]).exit_code == 0
    assert contents(tmp_path) == contents(SAMPLES)


def contents(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@pytest.mark.parametrize("sample", STILL, ids=[sample.name for sample in STILL])
def test_analyse_finds_the_true_angle_of_every_sample(sample):
    done = CliRunner().invoke(app, ["analyse", str(SAMPLES / f"{sample.name}.csv"), "--json"])
    assert done.exit_code == 0
    result = json.loads(done.stdout)
    error = result["total_angle_rad"] - sample.total_angle
    assert abs(error) < 2 * result["total_angle_se_rad"]
    assert abs(error) < (0.05 if "markers" in sample.name else 0.02) * sample.total_angle
    for whole, part in (("length_m", "length_m"), ("total_angle_rad", "angle_rad")):
        assert sum(piece[part] for piece in result["segments"]) == pytest.approx(result[whole], rel=1e-12)


def test_half_circle_gives_the_numbers_of_the_paper():
    done = CliRunner().invoke(app, ["analyse", str(SAMPLES / "half_circle.csv"), "--json"])
    result = json.loads(done.stdout)
    assert result["tension_out_N"] / result["tension_in_N"] == pytest.approx(0.6341, abs=5e-5)
    assert result["elongation_m"] == pytest.approx(1.9036e-3, abs=5e-8)
