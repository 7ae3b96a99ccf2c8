"""`tssgeom calibrate`: a run and a shape in, a rig out that loads again."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from tssgeom.rig import Friction, Load, Rig, Sensor, ShapeSensor, Tendon, read_rig, write_rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.history import driven

SAMPLES = Path(__file__).parents[2] / "sample_shapes"

MU, RHO = 0.2, 4e-4
TENSION = np.concatenate([np.linspace(0.05, 15.0, 120), np.linspace(14.9, 0.3, 120)])


@pytest.fixture
def write_run(tmp_path):
    """Write a run of the half circle with chosen columns."""

    def write(*names: str):
        rig = Rig(friction=Friction(coefficient=MU), tendon=Tendon(compliance_per_N=RHO))
        ends = driven(TENSION, Arcs.exact(np.array([0.5]), np.array([math.pi])), rig)
        rng = np.random.default_rng(1)
        columns = {
            "time_s": 0.05 * np.arange(len(TENSION)),
            "tension_in_N": TENSION,
            "tension_out_N": ends.tension_out + 0.25 + 0.01 * rng.standard_normal(len(TENSION)),
            "elongation_mm": 1e3 * ends.elongation + 1.69 + 0.002 * rng.standard_normal(len(TENSION)),
        }
        path = tmp_path / "run.csv"
        table = np.column_stack([columns[name] for name in names])
        np.savetxt(path, table, delimiter=",", header=",".join(names), comments="", fmt="%.9g")
        return path

    return write


ALL = ("time_s", "tension_in_N", "tension_out_N", "elongation_mm")


def test_the_rig_that_is_written_loads_again_with_the_friction_and_compliance_of_the_run(
    run, write_run, half, tmp_path
):
    rig = tmp_path / "rig.toml"
    outcome = run("calibrate", write_run(*ALL), "--shape", half, "--out", rig, "--json")
    assert outcome.status == 0
    output = json.loads(outcome.out)["estimates"]
    read = read_rig(rig)
    assert read.friction.coefficient == output["friction"]["value"]
    assert read.tendon.compliance_per_N == output["compliance"]["value"]
    # Noise of 0.01 N on 240 readings of some 10 N.
    assert read.friction.coefficient == pytest.approx(MU, rel=0.01)
    assert read.tendon.compliance_per_N == pytest.approx(RHO, rel=0.01)
    low, high = output["elongation_offset"]["ci95"]
    assert low < 1.69e-3 < high
    assert output["tension_out_offset"]["value"] == pytest.approx(0.25, abs=0.01)
    comments = [line for line in rig.read_text(encoding="utf-8").splitlines() if line.startswith("#")]
    assert any("SHA-256" in line for line in comments)


def test_the_rig_is_used_by_the_other_commands(run, write_run, half, tmp_path):
    rig = tmp_path / "rig.toml"
    run("calibrate", write_run(*ALL), "--shape", half, "--out", rig, "--quiet")
    output = json.loads(run("analyse", half, "--rig", rig, "--json").out)
    assert output["tension_out_N"] == pytest.approx(15.0 * math.exp(-MU * math.pi), rel=0.01)


def test_what_the_columns_do_not_identify_is_null_and_not_a_number(run, write_run, half, tmp_path):
    outcome = run(
        "calibrate",
        write_run("time_s", "tension_in_N", "tension_out_N"),
        "--shape",
        half,
        "--out",
        tmp_path / "rig.toml",
        "--json",
    )
    output = json.loads(outcome.out)["estimates"]
    compliance = output["compliance"]
    assert (compliance["value"], compliance["ci95"], compliance["observable"]) == (None, None, False)
    assert (compliance["unit"], compliance["nominal"]) == ("1/N", 3.16e-4)
    assert output["friction"]["observable"]


def test_the_output_says_how_good_the_fit_is_and_why_a_number_is_missing(run, write_run, half, tmp_path):
    columns = ("time_s", "tension_in_N", "tension_out_N")
    outcome = run("calibrate", write_run(*columns), "--shape", half, "--out", tmp_path / "rig.toml", "--json")
    output = json.loads(outcome.out)
    (channel,) = output["channels"]
    assert channel["noise"] == pytest.approx(0.01, rel=0.3)
    assert channel["rms_over_noise"] == pytest.approx(1.0, abs=0.4)
    assert channel["whiteness_p"] > 0.001  # white noise was added
    assert (output["passes"], output["failures"]) == (True, [])
    assert "no channel measures the stretch" in output["estimates"]["compliance"]["why"]
    assert output["estimates"]["friction"]["why"] is None


def test_the_zero_of_the_distal_cell_is_in_the_rig_and_a_second_calibration_keeps_it(
    run, write_run, half, tmp_path
):
    first, second = tmp_path / "first.toml", tmp_path / "second.toml"
    run("calibrate", write_run(*ALL), "--shape", half, "--out", first, "--quiet")
    (effect,) = read_rig(first).effects
    assert effect.offset_N == pytest.approx(0.25, abs=0.01)
    run("calibrate", write_run(*ALL), "--shape", half, "--rig", first, "--out", second, "--quiet")
    (again,) = read_rig(second).effects
    assert again.offset_N == pytest.approx(0.25, abs=0.01)


def test_a_folder_gets_rig_report_and_figures(run, write_run, half, tmp_path):
    outcome = run(
        *("calibrate", write_run(*ALL), "--shape", half, "--out", tmp_path / "report"),
        *("--figures", tmp_path / "figures", "--quiet"),
    )
    assert outcome.status == 0
    report = {path.name for path in (tmp_path / "report").iterdir()}
    assert report == {"rig.toml", "calibration.json"} | {
        f"{name}.{ending}" for name in ("fit", "phase") for ending in ("pdf", "png", "svg")
    }
    assert json.loads((tmp_path / "report" / "calibration.json").read_text("utf-8"))["passes"]
    assert {path.name for path in (tmp_path / "figures").iterdir()} == {
        f"run_{name}.{ending}" for name in ("fit", "phase") for ending in ("pdf", "svg")
    }


def test_a_fit_that_fails_its_test_writes_a_rig_only_by_force(run, write_run, half, tmp_path):
    path = write_run(*ALL)
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    table[:, 2] += 3.0 * np.sin(table[:, 0])  # a distal cell that nothing like the model moves
    np.savetxt(path, table, delimiter=",", header=",".join(ALL), comments="", fmt="%.9g")
    rig = tmp_path / "rig.toml"
    refused = run("calibrate", path, "--shape", half, "--out", rig, "--quiet")
    assert refused.status == 2
    assert not rig.exists()
    assert any("the fit fails its test: tension_out is met within" in line for line in refused.errors)
    assert "no rig is written" in refused.errors[-1]
    forced = run("calibrate", path, "--shape", half, "--out", rig, "--quiet", "--force")
    assert forced.status == 0
    assert "# Fails its test: tension_out is met within" in rig.read_text("utf-8")


@pytest.mark.parametrize("columns", [ALL, ("time_s", "tension_in_N", "tension_out_N")])
def test_an_inverted_cell_is_one_line_and_writes_nothing(run, write_run, half, tmp_path, columns):
    path = write_run(*columns)
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    table[:, 1] *= -1.0
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")
    outcome = run("calibrate", path, "--shape", half, "--out", tmp_path / "rig.toml")
    assert (outcome.status, len(outcome.errors)) == (2, 1)
    assert outcome.errors[0].endswith("[inverted_cell]")
    assert not (tmp_path / "rig.toml").exists()


def test_a_run_with_no_response_is_one_line_and_writes_nothing(run, write_run, half, tmp_path):
    rig = tmp_path / "rig.toml"
    outcome = run("calibrate", write_run("time_s", "tension_in_N"), "--shape", half, "--out", rig)
    assert outcome.status == 2
    assert len(outcome.errors) == 1
    assert "tension_out_N" in outcome.errors[0]
    assert "run.csv on " in outcome.errors[0]
    assert not rig.exists()


def test_an_elongation_in_millimetres_under_the_name_of_metres_is_refused(run, write_run, half, tmp_path):
    path = write_run(*ALL)
    path.write_text(path.read_text().replace("elongation_mm", "elongation_m", 1))
    outcome = run("calibrate", path, "--shape", half, "--out", tmp_path / "rig.toml")
    assert outcome.status == 2
    assert "check its unit, elongation_m or elongation_mm" in outcome.errors[0]


def test_every_rig_comes_back_from_its_file(tmp_path):
    rig = Rig(
        tendon=Tendon(compliance_per_N=1 / 3000.0, pretension_N=2.5),
        friction=Friction(coefficient=0.1),
        load=Load(stiffness_N_per_m=1234.5),
        sensors={"tension_out_N": Sensor(noise=0.01, full_scale=50.0)},
        shape=ShapeSensor(noise_mm=0.2, angle_gain_sd=0.01),
    )
    for each in (rig, Rig()):
        write_rig(tmp_path / "rig.toml", each, ["one line", "two\nlines"])
        assert read_rig(tmp_path / "rig.toml") == each


@pytest.mark.parametrize(
    ("campaign", "lacks"), [("campaign_clean", False), ("campaign_load_dependent_friction", True)]
)
@pytest.mark.parametrize(
    ("name", "shape"), [("half_slow", "half_circle"), ("half_fast", "half_circle"), ("chain", "chain")]
)
def test_only_a_run_that_an_effect_acted_on_is_said_to_lack_one(run, tmp_path, campaign, lacks, name, shape):
    folder = SAMPLES / campaign
    inputs = (folder / f"{name}.csv", "--shape", folder / f"route_{shape}.csv", "--rig", folder / "rig.toml")
    outcome = run("calibrate", *inputs, "--out", tmp_path / "rig.toml", "--force", "--json")
    warnings = json.loads(outcome.out)["warnings"]
    assert any("the model lacks an effect" in each for each in warnings) is lacks
    assert not any("what the rig states" in each for each in warnings)


def stated(friction: float, compliance: float) -> str:
    return f"[friction]\ncoefficient = {friction}\n[tendon]\ncompliance_per_N = {compliance}\n"


@pytest.mark.parametrize("runs", [1, 2])
def test_a_number_far_from_the_one_that_the_rig_states_has_a_warning_with_both(
    run, write_run, half, tmp_path, runs
):
    rig = tmp_path / "stated.toml"
    rig.write_text(stated(0.45 * MU, 2.2 * RHO))
    inputs = (*[write_run(*ALL)] * runs, "--shape", half, "--rig", rig, "--out", tmp_path / "out", "--json")
    outcome = run("calibrate", *inputs)
    output = json.loads(outcome.out)
    said = [each for each in output["warnings"] if "what the rig states" in each]
    assert [each.split(" is fitted as ")[0] for each in said] == ["friction", "compliance"]
    for each, before, ratio in zip(said, (0.45 * MU, 2.2 * RHO), ("2.2", "0.45"), strict=True):
        assert f"{ratio}" in each.split(" × ")[0].split(", ")[1]
        assert f"what the rig states, {before:.3g}: check that shape and run belong together" in each
        assert sum(each in line for line in outcome.errors) == 1
    if runs == 1:
        assert "what the rig states" in (tmp_path / "out" / "calibration.json").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "rig", ["", stated(0.6 * MU, 1.7 * RHO)], ids=["not stated", "within what wear and unlike lots change"]
)
def test_numbers_near_the_stated_ones_or_beside_none_have_no_such_warning(
    run, write_run, half, tmp_path, rig
):
    (tmp_path / "stated.toml").write_text(rig)
    inputs = (write_run(*ALL), "--shape", half, "--rig", tmp_path / "stated.toml")
    output = json.loads(run("calibrate", *inputs, "--out", tmp_path / "rig.toml", "--json").out)
    assert not any("what the rig states" in each for each in output["warnings"])


def test_a_run_on_the_route_of_another_is_said_to_be_far_from_the_rig(run, tmp_path):
    folder = SAMPLES / "campaign_clean"
    inputs = (
        folder / "loop_slow.csv",
        "--shape",
        folder / "route_half_circle.csv",
        "--rig",
        folder / "rig.toml",
    )
    output = json.loads(run("calibrate", *inputs, "--out", tmp_path / "x.toml", "--force", "--json").out)
    (said,) = [each for each in output["warnings"] if "what the rig states" in each]
    assert "friction is fitted as 0.44" in said
    assert "3.1 × what the rig states, 0.145: check that shape and run belong together" in said
