"""`tssgeom check`: what a file holds, and what is wrong with it."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh


def test_a_good_shape_is_reported(run, half):
    outcome = run("check", half)
    assert (outcome.status, outcome.errors) == (0, [])
    assert f"{half}: shape in mm (csv)" in outcome.out
    assert "points: 40, none missing" in outcome.out
    assert "length 500.0 mm" in outcome.out


def test_a_recording_is_reported_with_the_frames_that_are_wrong(run, recording):
    outcome = run("check", recording, "--json")
    (output,) = json.loads(outcome.out)
    assert outcome.status == 1
    assert (output["holds"], output["unit"]) == ("recording", "mm")
    assert (output["frames"], output["points"]) == (6, [12, 12])
    assert (output["duration_s"], output["measured"], output["stations"]) == (4.0, ["tension_in"], False)
    assert output["wrong"] == [
        "frame 2: line 3: Input data was truncated: write one JSON object a line, "
        "null for NaN or a missing point"
    ]


def test_what_analyse_refuses_of_a_frame_is_wrong(run, tmp_path):
    points = [[float(x), 0.1 * x * x, 0.0] for x in range(12)]
    frames = [{"t": 0.0, "noise_m": -1.0}, {"t": 1.0, "length_m": -2.0}, {"t": 2.0}]
    lines = "".join(json.dumps(one | {"unit": "mm", "points": points}) + "\n" for one in frames)
    (tmp_path / "bad.jsonl").write_text(lines)
    (output,) = json.loads(run("check", tmp_path / "bad.jsonl", "--json").out)
    assert [one.partition(":")[0] for one in output["wrong"]] == ["frame 0", "frame 1"]


def test_wrong_frames_beyond_the_first_few_are_counted_and_listed_in_json(run, recording):
    with recording.open("a") as file:
        file.write('{"t": 9, "points": [[1,2\n' * 6)
    for command in (run("analyse", recording).errors[-1], run("check", recording).out):
        assert "2 more frames" in command
        assert command.rstrip().endswith("see tssgeom check --json")
    (output,) = json.loads(run("check", recording, "--json").out)
    assert len(output["wrong"]) == 7


def test_missing_points_and_stations_are_reported(run, write_csv):
    angle = np.linspace(0.0, 2.0, 15)
    points = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle, angle])
    points[4, :3] = np.nan
    (output,) = json.loads(run("check", write_csv("gap.csv", points, "x_m,y_m,z_m,s_m"), "--json").out)
    assert (output["points_not_seen"], output["stations"]) == (1, True)


def test_the_noise_of_the_points_is_estimated(run, write_csv):
    x = np.linspace(0, 400, 200)
    points = np.column_stack([x, 0.001 * x**2, 0 * x]) + np.random.default_rng(5).normal(
        scale=0.3, size=(200, 3)
    )
    (output,) = json.loads(run("check", write_csv("noisy.csv", points), "--json").out)
    # the s.e. of 200 points is 5 %; 20 % is 4 s.e.
    assert output["noise_m"] == pytest.approx(0.3e-3, rel=0.2)


def hairpin(count: int) -> np.ndarray:
    """Out by 150 mm and back 5 mm beside it, the turn itself not sampled [mm]."""
    x = np.linspace(0.0, 150.0, count)
    out, back = np.column_stack([x, 0 * x, 0 * x]), np.column_stack([x, 0 * x + 5.0, 0 * x])
    return np.vstack([out, back[::-1]])


def test_length_noise_and_warnings_are_those_of_analyse(run, write_csv):
    outlier = hairpin(30)
    outlier[10, 2] = 40.0
    for name, points in (("hairpin.csv", hairpin(30)), ("outlier.csv", outlier)):
        path = write_csv(name, points)
        (output,) = json.loads(run("check", path, "--json").out)
        analysed = json.loads(run("analyse", path, "--json").out)
        for key in ("length_m", "noise_m", "warnings"):
            assert output[key] == analysed[key]


def test_a_frame_whose_points_no_fit_follows_is_wrong_and_the_next_one_is_reported(run, recording):
    few = np.delete(hairpin(4), 6, axis=0)  # one point of the way back was not sensed
    lost = {"t": -1.0, "points": few.tolist(), "unit": "mm"}
    recording.write_text(f"{json.dumps(lost)}\n{recording.read_text()}")
    (output,) = json.loads(run("check", recording, "--json").out)
    assert "frame 0: 7 points do not determine how far the route turns" in output["wrong"][0]
    assert output["length_m"] == pytest.approx(0.5, rel=1e-3)  # twelve points of the half circle


def test_a_column_that_is_not_read_is_reported(run, write_csv):
    points = np.column_stack([np.arange(6.0), np.arange(6.0) ** 2, np.zeros(6), np.ones(6)])
    outcome = run("check", write_csv("a.csv", points, "x_mm,y_mm,z_mm,temperature_V"))
    assert "warning: column 'temperature_V' is not read" in outcome.out


def test_a_key_that_is_not_read_is_reported_by_check_and_analyse(run, recording):
    lines = recording.read_text().replace('"t":', '"temprature_C": 30.0, "t":')
    recording.write_text(lines)
    warning = "'temprature_C' is not read: the nearest name is temperature_C"
    assert f"  warning: {warning}\n" in run("check", recording).out
    output = json.loads(run("analyse", recording, "--json").out)
    assert sum(warning in each for each in output["warnings"]) == 1


def test_a_column_of_a_run_that_is_not_read_is_reported_and_the_others_are_used(run, tmp_path, half):
    drive = tmp_path / "run.csv"
    drive.write_text("time_s,tension_in_N,tension_middle_N\n0,2,2\n1,3,2\n")
    outcome = run("check", drive)
    assert outcome.status == 0
    assert "2 samples in 1 s: tension_in\n  warning: column 'tension_middle_N' is not read" in outcome.out
    assert "warnings" in json.loads(run("check", drive, "--json").out)[0]
    (error,) = run("simulate", half, "--drive", drive, "--out", tmp_path / "out", "--quiet").errors
    assert f"{drive}: warning: column 'tension_middle_N' is not read" in error


def test_a_rig_and_a_mesh_are_reported(run, tmp_path):
    (tmp_path / "rig.toml").write_text("[friction]\ncoefficient = 0.2\n")
    trimesh.creation.box(extents=(10, 20, 30)).export(tmp_path / "a_lumen.ply")
    outcome = run("check", tmp_path / "rig.toml", tmp_path / "a_lumen.ply")
    assert outcome.status == 0
    assert "rig, friction 0.2" in outcome.out
    assert "mesh, 12 triangles, 10.0 × 20.0 × 30.0 mm" in outcome.out


def test_what_is_wrong_is_reported_with_the_hint_and_the_rest_is_checked(run, half, write_csv):
    plain = write_csv("bare.csv", np.zeros((5, 3)), "x,y,z")
    outcome = run("check", plain, half)
    assert outcome.status == 1
    assert outcome.errors[0].endswith("or give --unit mm|m|cm|in|…")
    assert "half.csv: shape in mm" in outcome.out


def test_unit_option_is_heard(run, write_csv):
    points = np.column_stack([np.arange(6.0), np.arange(6.0) ** 2, np.zeros(6)])
    path = write_csv("bare.csv", points, "x,y,z")
    assert run("check", path, "--unit", "m").status == 0
    assert run("check", path).status == 2


def test_a_campaign_is_reported_run_by_run_and_what_is_wrong_with_one_in_a_line(run, tmp_path):
    sample = Path(__file__).parents[2] / "sample_shapes" / "campaign_clean"
    outcome = run("check", sample)
    assert outcome.status == 0
    assert "campaign of 5 runs on route_half_circle" in outcome.out
    assert "held out" in outcome.out
    broken = shutil.copytree(sample, tmp_path / "broken")
    (broken / "loop_fast.csv").unlink()
    outcome = run("check", broken)
    assert outcome.status == 2
    assert len(outcome.errors) == 1
    assert "loop_fast.csv" in outcome.errors[0]


def test_a_measured_run_is_reported(run, tmp_path):
    path = tmp_path / "pull.csv"
    path.write_text("time_s,tension_in_N,tension_out_N\n0,1,\n0.5,2,1\n")
    outcome = run("check", path)
    assert outcome.status == 0
    assert "measured run, 2 samples in 0.5 s: tension_in, tension_out (1 missing)" in outcome.out
    path.write_text("time_s,tension_in_kPa\n0,1\n")
    (error,) = run("check", path).errors
    assert "'tension_in_kPa' may be a drive, and there is no other: give --map" in error


def test_a_column_of_an_unknown_name_is_listed_with_the_option_that_maps_it(run, tmp_path):
    table = tmp_path / "bent.csv"
    rows = "".join(f"{0.1 * k:.1f},{k % 7},{2 * k}\n" for k in range(30))
    table.write_text("Time [s],Motor [deg],Torque [mNm]\n" + rows)
    assert "not read: 'Torque [mNm]'; --map states what a column is" in run("check", table).out
    mapped = run("check", table, "--map", "Torque [mNm]=motor_torque").out
    assert "not read" not in mapped
    assert "motor_torque_Nm" in mapped


def test_a_frame_that_pushes_is_wrong(run, recording):
    recording.write_text(recording.read_text().replace('"tension_in_N": 12.0', '"tension_in_N": -12.0'))
    (output,) = json.loads(run("check", recording, "--json").out)
    assert "frame 4: tension_in is -12 N: a tendon only pulls" in output["wrong"][1]


def test_channels_of_a_recording_are_held_against_each_other(run, tmp_path):
    angle = np.linspace(0.0, np.pi, 12)
    points = (160.0 * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])).round(3).tolist()
    pull = [1.0 + 0.5 * k for k in range(20)] + [10.5 - 0.5 * k for k in range(20)]
    lines = [
        {"t": 0.1 * k, "unit": "mm", "points": points, "tension_in_N": 0.6 * value, "tension_out_N": value}
        for k, value in enumerate(pull)
    ]
    path = tmp_path / "pull.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    (report,) = json.loads(run("check", path, "--json").out)
    assert any(warning.endswith("[tension_excess]") for warning in report["warnings"])


def test_a_campaign_of_a_machine_with_unknown_numbers_is_reported_with_signs_that_are_wrong(run, tmp_path):
    time = np.linspace(0.0, 20.0, 401)
    motor = 0.8 * np.sin(time)
    joint, load = 0.9 * motor, 0.02 * np.sin(0.3 * time)
    torque = 0.05 * motor + 0.01 * np.sign(np.cos(time)) + load
    columns = np.column_stack((time, motor, joint, torque, load))
    header = "time_s,motor_angle_rad,joint_angle_rad,motor_torque_Nm,joint_torque_Nm"
    (tmp_path / "rig.toml").write_text(
        'friction.coefficient = "unknown"\ndrive = { kind = "pair", radius_m = "unknown" }\n'
        'end = { kind = "joint", radius_m = 0.01 }\nroute = { length_m = 0.5, angle_rad = 3.0 }\n'
    )
    (tmp_path / "campaign.toml").write_text('[[run]]\ndata = "run.csv"\n')
    np.savetxt(tmp_path / "run.csv", columns, delimiter=",", header=header, comments="")
    outcome = run("check", tmp_path)
    assert outcome.status == 0
    assert "campaign of 1 run on the route of the rig 500.0 mm" in outcome.out
    assert "motor_angle_rad, joint_torque_Nm, joint_angle_rad, motor_torque_Nm" in outcome.out
    assert "warning" not in outcome.out
    outcome = run("check", tmp_path, "--map", "joint_torque_Nm=joint_torque:-Nm")
    assert "[load_sign]" in outcome.out
    outcome = run("check", tmp_path, "--map", "joint_angle_rad=joint_angle:-rad")
    assert outcome.status == 2
    assert "[joint_sign]" in outcome.errors[0]


def test_a_map_that_no_file_has_is_named_also_where_the_file_is_refused(run, tmp_path):
    (tmp_path / "a.csv").write_text("x_mm,y_mm,z_mm\n0,0,0\n1,0,0\n")
    outcome = run("check", tmp_path / "a.csv", "--map", "Pos=displacement_in_m", "--map", "x_mm=x_m")
    assert "tssgeom: warning: --map 'Pos': no file that was read has a column of this name" in outcome.errors
    assert not any("--map 'x_mm'" in line for line in outcome.errors)
