"""A fibre's curvatures through the commands."""

import json

import numpy as np
import pytest


@pytest.fixture
def fibre(tmp_path):
    """Eighteen gratings on a half circle of 500 mm, noise 0.05/m, one not read; marks of both ends."""
    s = (np.arange(18) + 0.5) * 500 / 18
    bend = np.array([0.0, 2 * np.pi]) + 0.05 * np.random.default_rng(0).standard_normal((18, 2))
    cells = [f"{a:.4f},{x:.5f},{y:.5f}" for a, (x, y) in zip(s, bend, strict=True)]
    cells[6] = f"{s[6]:.4f},,"
    path = tmp_path / "fibre.csv"
    path.write_text("\n".join(["s_mm,kappa_x_per_m,kappa_y_per_m", "0,,", *cells, "500,,"]) + "\n")
    return path


def test_analyse_gives_length_and_angle(run, fibre):
    outcome = run("analyse", fibre, "--json")
    output = json.loads(outcome.out)
    assert outcome.status == 0
    assert output["length_m"] == pytest.approx(0.5, abs=1e-12)
    assert output["points"] == 17
    assert output["total_angle_rad"] == pytest.approx(np.pi, abs=3 * output["total_angle_se_rad"])
    assert output["total_angle_se_rad"] < 0.03  # 0.05/m × 0.5 m / √17 is 0.006; the unsensed ends add to it
    assert output["warnings"] == ["1 gratings not read, bridged"]


def test_analyse_draws_it(run, fibre, tmp_path):
    assert run("analyse", fibre, "--out", tmp_path / "out").status == 0
    assert (tmp_path / "out" / "fibre.rrd").stat().st_size > 0


def test_check_reports_gratings_and_noise(run, fibre):
    outcome = run("check", fibre)
    assert "gratings: 18, 1 missing" in outcome.out
    assert "length 500.0 mm" in outcome.out
    (output,) = json.loads(run("check", fibre, "--json").out)
    assert output["curvature_noise_per_m"] == pytest.approx(0.05, rel=0.5)  # the s.e. of 34 values is 12 %


def test_a_stated_noise_of_curvature_is_used_and_that_of_points_is_not_without_a_warning(
    run, fibre, tmp_path
):
    def analysed(rig: str) -> dict:
        (tmp_path / "rig.toml").write_text(f"[shape]\n{rig}\n")
        return json.loads(run("analyse", fibre, "--rig", tmp_path / "rig.toml", "--json").out)

    small, large, wrong = map(analysed, ("curvature_noise_per_m = 0.05", "curvature_noise_per_m = 0.5", ""))
    assert large["total_angle_se_rad"] > 2 * small["total_angle_se_rad"]
    assert "noise_mm is that of points" in str(analysed("noise_mm = 0.1")["warnings"])
    assert "noise_mm" not in str(wrong["warnings"])
    head, *lines = fibre.read_text().split()
    fibre.write_text("\n".join([head + ",curvature_noise_per_m", *(line + ",0.5" for line in lines)]) + "\n")
    assert analysed("")["total_angle_se_rad"] == pytest.approx(large["total_angle_se_rad"], rel=1e-9)
    (checked,) = json.loads(run("check", fibre, "--json").out)
    assert (checked["curvature_noise_per_m"], checked["curvature_noise_se_per_m"]) == (0.5, 0.0)


def test_simulate_drives_a_tendon_on_the_route_of_a_fibre(run, fibre, tmp_path):
    drive = tmp_path / "drive.csv"
    drive.write_text("time_s,tension_in_N\n0,5\n1,15\n")
    outcome = run("simulate", fibre, "--drive", drive, "--out", tmp_path / "out", "--json")
    assert outcome.status == 0, outcome.errors
    low, high = json.loads(outcome.out)["range"]["tension_out_N"]
    # 3 standard errors of the angle, see above
    assert [low, high] == pytest.approx(np.array([5.0, 15.0]) * np.exp(-0.145 * np.pi), rel=0.145 * 0.09)
