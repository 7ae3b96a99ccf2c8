"""Rigs with a pair, a joint or unknown numbers from the command line, on files as users write them."""

import json
import math

import numpy as np
import pyarrow.parquet as papq
import pytest

from tests.described import described, optional
from tests.view.recorded import columns
from tssgeom.rig import read_rig, with_values
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.machine import machine_of
from tssgeom.tendon.machine_simulation import simulate_machine

RIG = """
[tendon]
pretension_N = 6
[drive]
kind = "pair"
radius_m = 0.01
[end]
kind = "joint"
radius_m = 0.008
stiffness_Nm_per_rad = 0.2
[route]
length_m = 0.5
angle_rad = 3.0
"""
UNKNOWN = RIG.replace("pretension_N = 6", 'pretension_N = "unknown"').replace("= 3.0", '= "unknown"')
TIME = np.linspace(0.0, 24.0, 241)


def table(path, **columns):
    np.savetxt(
        path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments=""
    )
    return path


def measured(folder, name="run", seed=0, **true):
    """A run of the rig, with noise, on its own route."""
    (folder / "true.toml").write_text(RIG)
    rig = with_values(read_rig(folder / "true.toml"), true)
    machine = machine_of(rig, [Arcs.exact(np.array([0.5]), np.array([rig.route.angle_rad]))], 30)
    angle = 0.9 * np.sin(TIME) * (0.8 + 0.2 * np.sin(TIME / 4))
    out, rng = (
        simulate_machine(machine, {"time_s": TIME, "motor_angle_rad": angle}),
        np.random.default_rng(seed),
    )
    noisy = {
        key: out[key] + 2e-3 * rng.standard_normal(len(TIME))
        for key in ("joint_angle_rad", "motor_torque_Nm")
    }
    degrees = {
        "motor_angle_deg": np.degrees(angle),
        "joint_angle_deg": np.degrees(noisy["joint_angle_rad"]),
        "motor_torque_mNm": 1e3 * noisy["motor_torque_Nm"],
    }
    return table(folder / f"{name}.csv", time_s=TIME, **degrees)


@pytest.fixture
def shape(tmp_path):
    angle = np.linspace(0.0, 3.0, 120)
    radius = 500.0 / 3.0
    return table(
        tmp_path / "shape.csv", x_mm=radius * np.sin(angle), y_mm=radius * (1 - np.cos(angle)), z_mm=0 * angle
    )


def test_a_pair_is_simulated_and_its_command_brings_the_joint_there(run, tmp_path, shape):
    (tmp_path / "rig.toml").write_text(RIG)
    target = table(tmp_path / "target.csv", time_s=TIME, joint_angle_deg=20 * np.sin(TIME))
    rig, out = str(tmp_path / "rig.toml"), tmp_path / "out"
    done = run("compensate", str(shape), "--target", str(target), "--rig", rig, "--out", str(out), "--json")
    title = "simulate --json, compensate --json of a machine"
    keys = described(title, json.loads(done.out))
    commands = papq.read_table(out / "compensate.parquet")
    drive = table(tmp_path / "drive.csv", time_s=TIME, motor_angle_rad=commands["motor_angle_rad"].to_numpy())
    done = run("simulate", str(shape), "--drive", str(drive), "--rig", rig, "--out", str(out), "--json")
    simulated = papq.read_table(out / "simulate.parquet")
    np.testing.assert_allclose(
        simulated["joint_angle_rad"].to_numpy(), np.radians(20 * np.sin(TIME)), atol=1e-5
    )
    assert json.loads(done.out)["drive"] == "motor_angle_rad"
    assert keys | described(title, json.loads(done.out)) == optional(title)
    assert {"tension_in_1_N", "tension_out_2_N", "motor_torque_Nm"} <= set(simulated.column_names)
    first, same, other = (
        columns(out / "simulate.rrd", f"/series/tension_{end}_N", timed=False)["SeriesLines:colors"]
        for end in ("in_1", "out_1", "out_2")
    )
    assert first == same != other  # a tendon has one colour


@pytest.mark.parametrize("angle", [3.0, 9.0])
def test_without_a_shape_the_even_bend_of_the_rig_is_the_route(run, tmp_path, angle):
    (tmp_path / "rig.toml").write_text(RIG.replace("= 3.0", f"= {angle}"))
    drive = table(tmp_path / "drive.csv", time_s=TIME, motor_angle_deg=20 * np.sin(TIME))
    rig, out = tmp_path / "rig.toml", tmp_path / "out"
    done = run("simulate", "--drive", drive, "--rig", rig, "--out", out, "--json")
    assert json.loads(done.out)["shape"] == "route"
    machine = machine_of(read_rig(rig), [Arcs.exact(np.array([0.5]), np.array([angle]))])
    expected = simulate_machine(machine, {"time_s": TIME, "motor_angle_rad": np.radians(20 * np.sin(TIME))})
    read = papq.read_table(out / "simulate.parquet")["joint_angle_rad"].to_numpy()
    np.testing.assert_allclose(read, expected["joint_angle_rad"], atol=1e-12)
    target = table(tmp_path / "target.csv", time_s=TIME, joint_angle_rad=expected["joint_angle_rad"])
    run("compensate", "--target", target, "--rig", rig, "--out", out, "--quiet")
    commands = papq.read_table(out / "compensate.parquet")["joint_angle_rad"].to_numpy()
    np.testing.assert_allclose(commands, expected["joint_angle_rad"], atol=1e-5)


def test_without_a_shape_and_without_a_route_in_the_rig_the_error_says_what_to_give(run, tmp_path):
    drive = table(tmp_path / "drive.csv", time_s=TIME, tension_in_N=5 - 3 * np.cos(TIME))
    done = run("simulate", "--drive", drive, "--out", tmp_path / "out")
    assert done.status == 2
    assert "give one, or route.length_m and route.angle_rad in the rig" in done.errors[0]


def test_both_draw_the_channels_of_a_machine_and_name_the_figures(run, tmp_path, shape):
    (tmp_path / "rig.toml").write_text(RIG)
    target = table(tmp_path / "target.csv", time_s=TIME, joint_angle_deg=20 * np.sin(TIME))
    drive = table(tmp_path / "drive.csv", time_s=TIME, motor_angle_deg=20 * np.sin(TIME))
    for words in (("compensate", shape, "--target", target), ("simulate", shape, "--drive", drive)):
        rig, figures = tmp_path / "rig.toml", tmp_path / words[0]
        done = run(*words, "--rig", rig, "--out", tmp_path / "out", "--figures", figures, "--json")
        expected = [figures / f"{words[-1].stem}_machine.{ending}" for ending in ("pdf", "svg")]
        assert {*map(str, expected)} <= {*json.loads(done.out)["files"]}
        text = expected[1].read_text(encoding="utf-8")
        given = "target" if words[0] == "compensate" else "of the run"
        assert all(symbol in text for symbol in ("in,1", "in,2", given, "motor angle", "joint angle"))


def test_unknown_numbers_are_identified_or_reported_as_tied(run, tmp_path):
    true = {"friction.coefficient": 0.12, "tendon.pretension_N": 8.0, "route.angle_rad": 3.6}
    file = measured(tmp_path, **true)
    (tmp_path / "rig.toml").write_text(UNKNOWN + '[friction]\ncoefficient = "unknown"\n')
    out = tmp_path / "out"
    done = run("calibrate", str(file), "--rig", str(tmp_path / "rig.toml"), "--out", str(out), "--json")
    summary = json.loads(done.out)
    described("calibrate --json of a machine", summary)
    estimates = summary["estimates"]
    low, high = estimates["tendon.pretension_N"]["ci95"]
    assert low <= 8.0 <= high < 9.0
    assert not estimates["friction.coefficient"]["observable"]
    assert not estimates["route.angle_rad"]["observable"]
    low, high = summary["friction_angle"]["ci95"]
    assert low <= 0.12 * 3.6 <= high < 0.5
    assert any("only as a product" in each for each in summary["tied"])
    assert summary["held_out"]["joint_angle_rad"]["rms"] == pytest.approx(2e-3, rel=0.3)
    assert read_rig(out / "rig.toml").tendon.pretension_N == pytest.approx(8.0, rel=0.1)
    assert {"fit.png", "loop.png", "bends.png", "calibration.json"} <= {each.name for each in out.iterdir()}


def test_several_runs_are_fitted_together_and_printed_as_a_table(run, tmp_path):
    runs = [str(measured(tmp_path, f"run{k}", k, **{"tendon.pretension_N": 7.0})) for k in range(2)]
    (tmp_path / "rig.toml").write_text(UNKNOWN)
    rig, out = str(tmp_path / "rig.toml"), str(tmp_path / "found.toml")
    done = run("calibrate", *runs, "--rig", rig, "--out", out)
    assert "2 runs" in done.out
    assert "pretension T_0" in done.out
    assert read_rig(out).tendon.pretension_N == pytest.approx(7.0, rel=0.1)


def test_the_angle_of_a_route_that_nobody_sensed_follows_from_a_run(run, tmp_path):
    tension = 8.0 - 6.5 * np.cos(TIME)
    machine = machine_of(
        with_values(read_rig(_plain(tmp_path)), {}), [Arcs.exact(np.array([1.0]), np.array([2.5]))], 30
    )
    out = simulate_machine(machine, {"time_s": TIME, "tension_in_N": tension})["tension_out_N"]
    rng = np.random.default_rng(1)
    file = table(
        tmp_path / "run.csv",
        time_s=TIME,
        tension_in_N=tension + 0.02 * rng.standard_normal(len(TIME)),
        tension_out_N=out + 0.02 * rng.standard_normal(len(TIME)),
    )
    done = run(
        *("calibrate", str(file), "--angle-from-run", "--rig", str(_plain(tmp_path))),
        *("--out", str(tmp_path / "rig_out.toml"), "--json"),
    )
    product = json.loads(done.out)["friction_angle"]
    low, high = product["ci95"]
    assert low <= 0.145 * 2.5 <= high
    assert math.prod(product["assumed95"]) == pytest.approx(
        (0.145 * 3.0) ** 2
    )  # as the rig and the page have it
    assert product["bounds"] == [None, None]
    assert any("counts as 1 m" in each for each in done.errors)
    assert math.log(high / low) < 0.1


def test_a_pretension_below_what_is_assumed_follows_from_a_run_that_begins_at_rest(run, tmp_path):
    tension = 0.6 + 4.5 * (1.0 - np.cos(TIME))
    rig = with_values(read_rig(_plain(tmp_path)), {"tendon.pretension_N": 0.6})
    machine = machine_of(rig, [Arcs.exact(np.array([1.0]), np.array([3.5]))], 30)
    out = simulate_machine(machine, {"time_s": TIME, "tension_in_N": tension})["tension_out_N"]
    rng = np.random.default_rng(2)
    noisy = {
        name: values + 0.03 * rng.standard_normal(len(TIME))
        for name, values in (("tension_in_N", tension), ("tension_out_N", out))
    }
    file = table(tmp_path / "run.csv", time_s=TIME, **noisy)
    unknown = tmp_path / "unknown.toml"
    unknown.write_text(_plain(tmp_path).read_text() + '[tendon]\npretension_N = "unknown"\n')
    done = run(
        *("calibrate", str(file), "--angle-from-run", "--rig", str(unknown)),
        *("--out", str(tmp_path / "rig_out.toml"), "--json"),
    )
    low, high = json.loads(done.out)["estimates"]["tendon.pretension_N"]["ci95"]
    assert low < 0.6 < high
    assert high < 2.5  # half of what is assumed


def _plain(folder):
    path = folder / "plain.toml"
    path.write_text("[friction]\ncoefficient = { value = 0.145, sd = 0.01 }\n")
    return path


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        (("simulate", "shape.csv", "--drive", "run.csv"), "route.angle_rad is unknown"),
        (("calibrate", "shape.csv"), "no column time_s"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(run, tmp_path, shape, monkeypatch, arguments, reported):
    measured(tmp_path)
    (tmp_path / "rig.toml").write_text(UNKNOWN)
    monkeypatch.chdir(tmp_path)
    done = run(*arguments, "--rig", "rig.toml", "--out", "out")
    assert done.status == 2
    (line,) = done.errors
    assert reported in line


@pytest.mark.parametrize(
    ("command", "option", "reported"),
    [
        ("calibrate", None, "2 samples with motor_angle_rad: give 5 or more"),
        ("simulate", "--drive", "motor_angle_rad has no value at time_s = 0.1: fill every row"),
        ("compensate", "--target", "no target: give joint_angle_rad"),
    ],
)
def test_an_error_of_a_run_names_its_file_once(run, tmp_path, monkeypatch, command, option, reported):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rig.toml").write_text(RIG)
    table(tmp_path / "run.csv", time_s=[0.0, 0.1, 0.2], motor_angle_rad=[0.0, np.nan, 0.2])
    done = run(command, *([option] if option else []), "run.csv", "--rig", "rig.toml", "--out", "out")
    assert done.status == 2
    assert done.errors == [f"tssgeom: run.csv: {reported}"]


def test_two_plain_runs_with_elongation_give_friction_and_compliance_and_name_what_is_not_used(run, tmp_path):
    (tmp_path / "plain.toml").write_text(
        "[tendon]\npretension_N = 1\n[route]\nlength_m = 0.5\nangle_rad = 3.0\n"
    )
    machine = machine_of(
        read_rig(tmp_path / "plain.toml"), [Arcs.exact(np.array([0.5]), np.array([3.0]))], 30
    )
    files, rng = [], np.random.default_rng(2)
    for k, peak in enumerate((12.0, 15.0)):
        tension = 1.0 + peak * (0.5 - 0.5 * np.cos(TIME))
        out = simulate_machine(machine, {"time_s": TIME, "tension_in_N": tension})
        noise = rng.standard_normal((2, len(TIME)))
        columns = {
            "tension_in_N": tension,
            "tension_out_N": out["tension_out_N"] + 0.02 * noise[0],
            "elongation_mm": 1e3 * out["elongation_m"] + 0.005 * noise[1],
            "joint_angle_rad": 0.0 * TIME,
        }
        files.append(table(tmp_path / f"run{k}.csv", time_s=TIME, **columns))
    out = tmp_path / "new.toml"
    done = run("calibrate", *files, "--rig", tmp_path / "plain.toml", "--out", out, "--json")
    estimates = json.loads(done.out)["estimates"]
    assert estimates["friction.coefficient"]["value"] == pytest.approx(0.145, rel=0.03)
    assert estimates["tendon.compliance_per_N"]["value"] == pytest.approx(3.16e-4, rel=0.03)
    assert any("joint_angle_rad is not used" in each for each in json.loads(done.out)["warnings"])


def test_check_says_what_a_machine_is_and_what_is_unknown_of_it(run, tmp_path):
    (tmp_path / "rig.toml").write_text(UNKNOWN)
    done = run("check", tmp_path / "rig.toml")
    assert done.status == 0
    assert "drive 'pair', end 'joint', tendons: 2" in done.out
    assert "unknown: tendon.pretension_N, route.angle_rad" in done.out


def test_what_a_rig_states_and_a_command_does_not_use_is_named(run, tmp_path, shape):
    late = '[[effects]]\nname = "channel_lag"\nlag_s = 0.3\n'
    (tmp_path / "late.toml").write_text(RIG + late)
    done = run("analyse", shape, "--rig", tmp_path / "late.toml")
    assert any("effects of sensors do not act on a machine (channel_lag)" in each for each in done.errors)
    (tmp_path / "routed.toml").write_text("[route]\nlength_m = 0.5\nangle_rad = 1.0\n")
    done = run("analyse", shape, "--rig", tmp_path / "routed.toml")
    assert any("a sensed one counts first" in each for each in done.errors)


def test_commands_on_one_tendon_say_that_they_do_not_use_the_machine(run, tmp_path, shape):
    (tmp_path / "rig.toml").write_text(RIG)
    done = run("remedy", "--shape", shape, "--rig", tmp_path / "rig.toml")
    assert any("[drive] and [end] are not used here" in each for each in done.errors)


def test_batch_has_a_column_for_each_channel_of_a_machine_and_what_was_measured(run, tmp_path):
    (tmp_path / "rig.toml").write_text(RIG)
    angle, folder = 0.5 * np.sin(TIME[:40]), tmp_path / "in"
    folder.mkdir()
    points = np.column_stack(_half_circle())
    rows = [(t, a, 0.1, 0.2, *point) for t, a in zip(TIME, angle, strict=False) for point in points]
    names = ("time_s", "motor_angle_rad", "joint_angle_rad", "joint_angle_target_rad", "x_m", "y_m", "z_m")
    table(folder / "moving.csv", **dict(zip(names, np.array(rows).T, strict=True)))
    done = run("batch", folder, "--rig", tmp_path / "rig.toml", "--out", tmp_path / "out", "--no-pictures")
    assert done.status == 0
    frames = papq.read_table(tmp_path / "out" / "frames" / "moving.parquet")
    machine = machine_of(read_rig(tmp_path / "rig.toml"), [Arcs.exact(np.array([0.5]), np.array([3.0]))])
    expected = simulate_machine(machine, {"time_s": TIME[:40], "motor_angle_rad": angle})
    for name in ("tension_out_1_N", "tension_out_2_N", "joint_angle_rad", "motor_torque_Nm"):
        np.testing.assert_allclose(frames[name].to_numpy(), expected[name], atol=1e-12)
    np.testing.assert_allclose(frames["measured_joint_angle_rad"].to_numpy(), 0.1)
    np.testing.assert_allclose(frames["joint_angle_target_rad"].to_numpy(), 0.2)
    assert not {each for each in frames.column_names if each.startswith("measured_") and "command" in each}
    assert frames.schema.field("joint_angle_rad").metadata[b"unit"] == b"rad"
    alone = run(
        "batch", folder, "--rig", tmp_path / "rig.toml", "--out", tmp_path / "alone", "--geometry-only"
    )
    assert alone.status == 0


def test_analyse_says_what_a_machine_does(run, tmp_path, shape):
    (tmp_path / "rig.toml").write_text(RIG)
    done = run("analyse", shape, "--rig", tmp_path / "rig.toml", "--tension-in", "20", "--json")
    said = json.loads(done.out)
    assert said["tension_in_2_N"] == pytest.approx(20.0)
    assert said["tension_out_1_N"] == pytest.approx(20.0 * math.exp(-0.145 * 3.0), rel=0.01)
    assert said["tension_in_assumed"]


def _half_circle():
    angle = np.linspace(0.0, 3.0, 30)
    return 0.5 / 3.0 * np.sin(angle), 0.5 / 3.0 * (1.0 - np.cos(angle)), 0.0 * angle
