"""A rig file with effects works in every command alike, and each states that they act."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as papq
import pytest

from tssgeom.rig import read_rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.model import predict

Run = Callable[..., Any]

HIDDEN = '[[effects]]\nname = "hidden_bend"\nat_m = 0.25\nangle_rad = 0.6\n'
SENSOR = '[[effects]]\nname = "tension_in_gain"\ngain_error = 0.25\n'
WARM = '[[effects]]\nname = "thermal_drift"\nexpansion_per_K = 1e-4\n'
WITHOUT, WITH = 15.0 * math.exp(-0.145 * math.pi), 15.0 * math.exp(-0.145 * (math.pi + 0.6))
FITTED = 1e-3  # what the fit of 40 points leaves of the angle


@pytest.fixture
def rig(tmp_path: Path) -> Callable[[str], Path]:
    def write(text: str) -> Path:
        path = tmp_path / "rig.toml"
        path.write_text(text)
        return path

    return write


def table(path: Path, **columns: Any) -> Path:
    np.savetxt(
        path,
        np.column_stack(list(columns.values())),
        delimiter=",",
        header=",".join(columns),
        comments="",
        fmt="%.17g",
    )
    return path


def rows(path: Path) -> dict[str, list[Any]]:
    return papq.read_table(path).to_pydict()


def test_analyse_and_batch_lose_what_a_hidden_bend_takes(run: Run, half: Path, rig: Any, tmp_path: Path):
    output = run("analyse", half, "--rig", rig(HIDDEN), "--json")
    assert json.loads(output.out)["tension_out_N"] == pytest.approx(WITH, rel=FITTED)
    assert "with hidden_bend" in " ".join(
        run("analyse", half, "--rig", rig(HIDDEN)).out.split()
    )  # lines break
    done = run("batch", half, "--rig", rig(HIDDEN), "--out", tmp_path / "out")
    assert (done.status, done.errors) == (0, [])
    assert rows(tmp_path / "out" / "summary.parquet")["tension_out_N"] == pytest.approx([WITH], rel=FITTED)
    assert "hidden_bend" in (tmp_path / "out" / "report.html").read_text()


def test_simulate_gives_what_the_march_of_a_run_predicts(run: Run, half: Path, rig: Any, tmp_path: Path):
    time = np.arange(6.0)
    pulls = np.array([5.0, 15.0, 15.0, 10.0, 4.0, 6.0])
    drive = table(tmp_path / "drive.csv", time_s=time, tension_in_N=pulls)
    done = run("simulate", half, "--drive", drive, "--rig", rig(HIDDEN), "--out", tmp_path / "out")
    assert (done.status, done.errors) == (0, [])
    assert "with hidden_bend" in done.out
    simulated = rows(tmp_path / "out" / "simulate.parquet")
    assert not any(name.startswith("read_") for name in simulated)
    assert simulated["phase"] == ["pull", "pull", "hold", "pull_to_release", "release", "release_to_pull"]
    output = predict({"time_s": time, "tension_in_N": pulls}, Arcs.exact(0.5, math.pi), read_rig(rig(HIDDEN)))
    for channel in ("tension_out_N", "elongation_m"):
        assert simulated[channel] == pytest.approx(output[channel], rel=FITTED)


def test_simulate_reports_what_is_and_beside_it_what_a_sensor_reads(
    run: Run, half: Path, rig: Any, tmp_path: Path
):
    drive = table(tmp_path / "drive.csv", time_s=[0, 1], tension_in_N=[5.0, 12.5])
    run("simulate", half, "--drive", drive, "--rig", rig(SENSOR), "--out", tmp_path / "out", "--quiet")
    simulated = rows(tmp_path / "out" / "simulate.parquet")
    assert simulated["tension_in_N"] == pytest.approx([4.0, 10.0])
    assert simulated["read_tension_in_N"] == [5.0, 12.5]
    assert simulated["read_tension_out_N"] == simulated["tension_out_N"]


def test_what_compensate_commands_brings_simulate_to_the_target(
    run: Run, half: Path, rig: Any, tmp_path: Path
):
    target_m = [1e-3, 4e-3, 6e-3, 5e-3, 2e-3, 3e-3]
    target = table(tmp_path / "target.csv", time_s=np.arange(6.0), displacement_out_m=target_m)
    options = ("--rig", rig(HIDDEN + SENSOR))
    done = run("compensate", half, "--target", target, *options, "--out", tmp_path / "out")
    assert "with hidden_bend, tension_in_gain" in done.out
    commands = rows(tmp_path / "out" / "compensate.parquet")
    assert np.array(commands["read_tension_in_N"]) == pytest.approx(1.25 * np.array(commands["tension_in_N"]))
    for column, name in (("displacement_in_m", "displacement_in_m"), ("read_tension_in_N", "tension_in_N")):
        drive = table(tmp_path / "drive.csv", time_s=commands["time_s"], **{name: commands[column]})
        run("simulate", half, "--drive", drive, *options, "--out", tmp_path / name, "--quiet")
        simulated = rows(tmp_path / name / "simulate.parquet")["displacement_out_m"]
        assert simulated == pytest.approx(target_m, rel=1e-9)


def test_heat_moves_a_recording_and_its_absence_is_reported(run: Run, half: Path, rig: Any, tmp_path: Path):
    points = np.loadtxt(half, delimiter=",", skiprows=1).tolist()
    frames = [
        {"t": t, "points": points, "unit": "mm", "displacement_in_m": 4e-3, "temperature_C": 20.0 + 5.0 * t}
        for t in range(3)
    ]
    warm, cold = tmp_path / "warm.jsonl", tmp_path / "cold.jsonl"
    warm.write_text("\n".join(json.dumps(frame) for frame in frames))
    cold.write_text("\n".join(json.dumps({**frame, "temperature_C": None}) for frame in frames))
    heated, still = (
        json.loads(run("analyse", path, "--rig", rig(WARM), "--json").out) for path in (warm, cold)
    )
    low, high = heated["range"]["tension_in_N"]
    assert high - low > 1.0  # 10 K of 1e-4 of 0.5 m is 0.5 mm, on a tendon of 6 N/mm with its load
    assert heated["warnings"] == []
    assert still["range"]["tension_in_N"][0] == still["range"]["tension_in_N"][1]
    assert any("no temperature_C: thermal_drift does nothing" in text for text in still["warnings"])
    drive = table(tmp_path / "drive.csv", time_s=[0, 1], tension_in_N=[5.0, 9.0])
    done = run("simulate", half, "--drive", drive, "--rig", rig(WARM), "--out", tmp_path / "out", "--quiet")
    assert done.errors == [f"tssgeom: {drive}: warning: no temperature_C: thermal_drift does nothing"]


def test_calibrate_holds_the_effects_and_finds_friction_and_compliance_beside_them(
    run: Run, half: Path, rig: Any, tmp_path: Path
):
    time = np.linspace(0.0, 40.0, 401)
    pulls = np.interp(time, [0.0, 20.0, 40.0], [0.0, 20.0, 0.0])
    true = rig(HIDDEN + "[friction]\ncoefficient = 0.16\n[tendon]\ncompliance_per_N = 3.6e-4\n")
    drive = {"time_s": time, "tension_in_N": pulls}
    predicted = predict(drive, Arcs.exact(0.5, math.pi), read_rig(true), bars=80)
    noise = np.random.default_rng(0)
    measured = table(
        tmp_path / "run.csv",
        time_s=time,
        tension_in_N=pulls,
        tension_out_N=predicted["tension_out_N"] + noise.normal(0.0, 0.02, 401),
        elongation_m=predicted["elongation_m"] + noise.normal(0.0, 5e-6, 401),
    )
    out = tmp_path / "found.toml"
    assert (
        run("calibrate", measured, "--shape", half, "--rig", rig(HIDDEN), "--out", out, "--quiet").status == 0
    )
    fitted = read_rig(out)
    assert fitted.effects == read_rig(true).effects
    assert fitted.friction.coefficient == pytest.approx(0.16, rel=3e-3)  # without the bend 0.19
    assert fitted.tendon.compliance_per_N == pytest.approx(3.6e-4, rel=5e-3)


def test_remedy_refuses_a_rig_with_effects_in_one_line(run: Run, half: Path, rig: Any):
    done = run("remedy", "--shape", half, "--rig", rig(HIDDEN))
    assert (done.status, len(done.errors)) == (2, 1)
    assert "Theorem 3 has no effects, but the rig has hidden_bend" in done.errors[0]


def test_an_effect_over_time_takes_a_shape_that_stands_alone_as_one_second(run: Run, half: Path, rig: Any):
    drag = rig('[[effects]]\nname = "viscous_drag"\ncoefficient_Ns_per_m2 = 100.0\n')
    output = json.loads(run("analyse", half, "--rig", drag, "--json").out)
    assert output["tension_out_N"] < WITHOUT - 0.01
