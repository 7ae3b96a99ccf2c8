"""`tssgeom analyse`: the JSON, the table, what is written, and every bad shape."""

import json
import math
import os
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

SAMPLES = Path(__file__).parents[2] / "sample_shapes"


def half_circle(count: int = 40) -> np.ndarray:
    angle = np.linspace(0.0, math.pi, count)
    return 500 / math.pi * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])


def test_half_circle_at_15_newton_gives_the_paper_s_numbers(run, half):
    outcome = run("analyse", half, "--json")
    output = json.loads(outcome.out)
    assert outcome.status == 0
    assert (output["shape"], output["points"]) == ("half", 40)
    assert output["tension_in_N"] == pytest.approx(15.0)  # the default
    assert output["tension_out_N"] / output["tension_in_N"] == pytest.approx(0.6341, abs=1e-4)
    assert output["elongation_m"] == pytest.approx(1.9036e-3, abs=1e-7)
    assert output["total_angle_rad"] == pytest.approx(math.pi, rel=1e-5)


def test_several_shapes_are_a_list_and_one_folder_is_too(run, write_csv, tmp_path):
    for name in ("a.csv", "b.csv"):
        write_csv(f"in/{name}", half_circle())
    by_name = json.loads(run("analyse", tmp_path / "in/a.csv", tmp_path / "in/b.csv", "--json").out)
    by_folder = json.loads(run("analyse", tmp_path / "in", "--json").out)
    assert [output["shape"] for output in by_name] == ["a", "b"]
    assert by_folder == by_name


def test_tension_and_rig_are_the_user_s(run, half, tmp_path):
    (tmp_path / "rig.toml").write_text("[friction]\ncoefficient = 0.0\n")
    options = ("--tension-in", "8", "--rig", tmp_path / "rig.toml")
    output = json.loads(run("analyse", half, "--json", *options).out)
    assert output["tension_in_N"] == pytest.approx(8.0)
    assert output["tension_out_N"] == pytest.approx(8.0)
    assert output["elongation_m"] == pytest.approx(3.16e-4 * 8.0 * 0.5, rel=1e-6)


def test_frames_that_differ_by_less_than_an_error_have_one_number_in_the_table(run, tmp_path):
    header = ",".join(f"P{k}_{axis}_mm" for k in range(1, 21) for axis in "xyz")
    noise = np.random.default_rng(3).normal(0.0, 0.2, (6, 60))
    rest, bent = half_circle(count=20).ravel(), half_circle(count=23)[:20].ravel()
    np.savetxt(tmp_path / "rest.csv", rest + noise, "%.4f", ",", header=header, comments="")
    np.savetxt(tmp_path / "bent.csv", [rest, *(bent + noise)], "%.4f", ",", header=header, comments="")
    lines = run("analyse", tmp_path / "rest.csv", tmp_path / "bent.csv", "--geometry-only").out.splitlines()
    rest, bent = (next(line for line in lines if line.startswith(f" {name}")) for name in ("rest", "bent"))
    assert re.search(r" 1[78]\d\.\d+ ± ", rest)
    assert re.search(r" 1[56]\d\.\d+–1[78]\d\.\d+ ± ", bent)


def test_a_range_over_frames_has_the_range_of_their_standard_errors(run, tmp_path):
    """It had the error of one frame, such as 77–379° ± 15° where frames that reach 379° have ± 200°."""
    header = ",".join(f"P{k}_{axis}_mm" for k in range(1, 21) for axis in "xyz")
    noise = np.random.default_rng(4).normal(0.0, 0.1, (8, 60)) * np.repeat([1.0, 30.0], [6, 2])[:, None]
    bent = np.vstack([half_circle(count=count)[:20].ravel() for count in (20, 21, 22, 23, 24, 25, 26, 27)])
    np.savetxt(tmp_path / "bent.csv", bent + noise, "%.4f", ",", header=header, comments="")
    row = next(line for line in run("analyse", tmp_path / "bent.csv").out.splitlines() if "bent" in line)
    of = json.loads(run("analyse", tmp_path / "bent.csv", "--json").out)["range"]
    low, high = np.degrees(of["total_angle_se_rad"])
    printed = re.search(r" [\d.]+–[\d.]+ ± ([\d.]+)–([\d.]+) ", row)
    assert printed is not None
    assert [float(each) for each in printed.groups()] == pytest.approx([low, high], rel=0.05)
    assert high > 2 * low


def test_an_elongation_that_is_0_but_for_rounding_has_no_sign(run):
    table = run("analyse", SAMPLES / "insertion.jsonl").out
    assert " 0.0000–" in table
    assert "-0.0" not in table


def test_the_table_has_the_numbers_and_the_tension_they_belong_to(run, half):
    outcome = run("analyse", half)
    assert "T_in = 15 N" in outcome.out
    row = next(line for line in outcome.out.splitlines() if line.startswith(" half "))
    for cell in ("40", "500.0", "15.00", "9.51"):
        assert f" {cell} " in f"{row} "
    for value in ("180.0", "3.142", "1.904"):  # of exact points: the standard error is far below them
        assert re.search(rf" {re.escape(value)} ± < 0\.0+1 ", f"{row} ")


def test_quiet_leaves_stdout_empty(run, half):
    assert run("analyse", half, "--quiet") == (0, "", [])


def test_a_recording_remembers_the_pull_and_rejects_its_broken_line_only(run, recording):
    outcome = run("analyse", recording, "--json")
    output = json.loads(outcome.out)
    assert outcome.status == 1
    assert outcome.errors == [
        f"tssgeom: {recording}: frame 2: line 3: Input data was truncated: "
        "write one JSON object a line, null for NaN or a missing point"
    ]
    assert (output["frames"], output["rejected"]) == (6, 1)
    assert output["elongation_m"] == pytest.approx(1.7284e-3, rel=1e-3)  # docs/model.md: 15 N, then 10 N


def test_out_writes_the_object_the_recording_and_the_tube(run, half, tmp_path):
    outcome = run("analyse", half, "--json", "--out", tmp_path / "out")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "half.glb",
        "half.rrd",
        "result.json",
    ]
    assert (tmp_path / "out/result.json").read_text() == outcome.out
    tube = trimesh.load_mesh(tmp_path / "out/half.glb")
    np.testing.assert_allclose(tube.extents[:2], [0.5 / math.pi * 2, 0.5 / math.pi], rtol=0.05)


def test_a_lumen_that_cannot_be_read_is_reported_and_the_numbers_stay(run, half, tmp_path):
    (tmp_path / "half_lumen.ply").write_text("no mesh")
    outcome = run("analyse", half, "--json", "--out", tmp_path / "out")
    assert outcome.status == 1
    assert "half_lumen.ply: cannot be read as a mesh" in outcome.errors[0]
    assert json.loads(outcome.out)["shape"] == "half"


GOOD = half_circle()
SHUFFLED = GOOD[np.random.default_rng(3).permutation(len(GOOD))]


def with_station(stations):
    return np.column_stack([GOOD, stations])


BAD = {
    "three points": (GOOD[:3], "x_mm,y_mm,z_mm", "3 distinct points"),
    "three distinct points": (GOOD[[0, 0, 1, 1, 2, 2]], "x_mm,y_mm,z_mm", "3 distinct points"),
    "zero length": (np.tile(GOOD[0], (9, 1)), "x_mm,y_mm,z_mm", "1 distinct points"),
    "infinite": (
        np.where(np.arange(40)[:, None] == 5, np.inf, GOOD),
        "x_mm,y_mm,z_mm",
        "point 5 is infinite",
    ),
    "all missing": (GOOD * np.nan, "x_mm,y_mm,z_mm", "0 distinct points"),
    "not in order": (SHUFFLED, "x_mm,y_mm,z_mm", "not in order"),
    "no unit": (GOOD, "x,y,z", "--unit mm|m|cm|in|…"),
    "mixed units": (GOOD, "x_mm,y_mm,z_m", "mixed units"),
    "stations": (with_station(np.arange(40)[::-1]), "x_mm,y_mm,z_mm,s_mm", "stations do not increase"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_shape_is_refused_in_one_line_with_the_file_and_the_reason(run, write_csv, case):
    points, header, expected = BAD[case]
    path = write_csv("bad.csv", points, header)
    outcome = run("analyse", path, "--json")
    (error,) = outcome.errors
    assert (outcome.status, outcome.out) == (2, "")
    assert error.startswith(f"tssgeom: {path}: ")
    assert expected in error


def test_a_bad_shape_does_not_take_the_others_down(run, write_csv, half, tmp_path):
    bad = write_csv("bad.csv", GOOD[:3])
    outcome = run("analyse", bad, half, tmp_path / "missing.csv", "--json")
    assert outcome.status == 1
    assert [output["shape"] for output in json.loads(outcome.out)] == ["half"]
    assert len(outcome.errors) == 2


def test_a_file_that_may_not_be_read_does_not_take_the_others_down(run, write_csv, half):
    locked = write_csv("locked.csv", GOOD)
    locked.chmod(0)
    if os.access(locked, os.R_OK):
        pytest.skip("this user may read every file")
    outcome = run("analyse", half, locked, "--json")
    assert outcome.status == 1
    assert [output["shape"] for output in json.loads(outcome.out)] == ["half"]
    assert len(outcome.errors) == 1
    assert "Permission denied" in outcome.errors[0]


MISSING = GOOD.copy()
MISSING[15:18] = np.nan
OUTLIER = GOOD + np.random.default_rng(4).normal(scale=0.2, size=GOOD.shape)
OUTLIER[22] += [0.0, 0.0, 20.0]

UNCERTAIN = {
    "repeated points": (GOOD[np.repeat(np.arange(40), 2)], "merged"),
    "missing points": (MISSING, "3 points missing"),
    "one outlier": (OUTLIER, "1 outlying point"),
}


@pytest.mark.parametrize("case", UNCERTAIN)
def test_an_uncertain_shape_is_used_with_a_warning(run, write_csv, case):
    points, expected = UNCERTAIN[case]
    output = json.loads(run("analyse", write_csv("doubt.csv", points), "--json").out)
    assert any(expected in warning for warning in output["warnings"])
    assert output["total_angle_rad"] == pytest.approx(math.pi, rel=0.02)


def test_a_recording_whose_frames_are_all_bad_is_refused(run, write_csv):
    rows = np.column_stack([np.repeat([0.0, 1.0], 3), np.tile(GOOD[:3], (2, 1))])
    outcome = run("analyse", write_csv("bad.csv", rows, "time_s,x_mm,y_mm,z_mm"))
    (error,) = outcome.errors
    assert outcome.status == 2
    assert "none of 2 frames can be used; the first: 3 distinct points" in error


def test_the_clearance_to_a_closed_lumen_counts_the_tube(run, half, tmp_path):
    """A half circle of 500 mm in the plane z = 0, in a flat box of 40 mm, and of 20 mm."""
    lumen = tmp_path / "half_lumen.ply"
    trimesh.creation.box((400.0, 400.0, 40.0)).export(lumen)
    output = json.loads(run("analyse", half, "--tube-mm", "10", "--json").out)["clearance"]
    assert output["lumen"] == "half_lumen.ply"
    assert output["tube_radius_m"] == 0.005
    assert output["least_m"] == pytest.approx(0.015, abs=1e-6)  # the route fits exact points
    assert output["contacts"] == output["outside"] == []
    trimesh.creation.box((400.0, 400.0, 9.0)).export(lumen)
    outcome = run("analyse", half, "--tube-mm", "10", "--json")
    touching = json.loads(outcome.out)["clearance"]
    assert [one["least_m"] for one in touching["contacts"]] == [pytest.approx(-0.0005, abs=1e-6)]
    assert touching["contacts"][0]["s_end_m"] == pytest.approx(0.5, rel=1e-3)
    assert outcome.status == 0


def test_a_route_out_of_its_lumen_is_warned_of(run, half, tmp_path):
    mesh = trimesh.creation.box((400.0, 400.0, 40.0))
    mesh.apply_translation((0.0, 0.0, 50.0))
    mesh.export(tmp_path / "half_lumen.ply")
    output = json.loads(run("analyse", half, "--json").out)
    assert output["clearance"]["least_m"] == pytest.approx(-0.03, abs=1e-6)
    assert any("out of the lumen from s = 0.0 to 500.0 mm, by up to 30" in one for one in output["warnings"])


def test_the_tube_of_the_mesh_has_the_true_radius_and_is_watertight(run, half, tmp_path):
    assert run("analyse", half, "--tube-mm", "8", "--out", tmp_path / "out", "--quiet").status == 0
    tube = trimesh.load_mesh(tmp_path / "out" / "half.glb")
    assert tube.is_watertight
    assert tube.extents.min() == pytest.approx(0.008, rel=0.02)  # sixteen sides


def test_results_that_cannot_be_written_are_reported_in_plain_words(run, half, tmp_path):
    (tmp_path / "taken").touch()
    outcome = run("analyse", half, "--out", tmp_path / "taken")
    assert outcome.status == 2
    assert all("File exists" in error and "unexpected" not in error for error in outcome.errors)


def test_a_time_in_another_unit_makes_frames(run, write_csv):
    time = np.repeat(np.arange(3.0), 40)
    rows = np.column_stack([np.tile(half_circle(), (3, 1)), time])
    outcome = run("analyse", write_csv("ms.csv", rows, "x_mm,y_mm,z_mm,time_ms"), "--json")
    output = json.loads(outcome.out)
    assert (output["frames"], output["time_s"]) == (3, 0.002)
    assert output["tension_in_assumed"]
    (note,) = outcome.errors
    assert note.endswith("ms.csv: time_ms read as time_s × 0.001")


def test_a_route_that_bends_under_a_tendon_that_nobody_measured_is_said_and_may_be_pulled_anew(run, tmp_path):
    def bent(angle):
        turn = np.linspace(0.0, angle, 30)
        return 300 / angle * np.column_stack([np.sin(turn), 1 - np.cos(turn), 0 * turn])

    frames = [bent(angle) for angle in np.linspace(0.1, 3.0, 12)]
    lines = [{"t": k, "unit": "mm", "points": each.tolist()} for k, each in enumerate(frames)]
    moving, still = tmp_path / "moving.jsonl", tmp_path / "still.jsonl"
    moving.write_text("\n".join(map(json.dumps, lines)))
    still.write_text("\n".join(json.dumps(each | {"points": lines[-1]["points"]}) for each in lines))
    measured = tmp_path / "measured.jsonl"
    measured.write_text("\n".join(json.dumps(each | {"tension_in_N": 10.0}) for each in lines))
    held = "held at 10 N since the first frame; bends that came later take nothing of it, in moving:"
    assert held in run("analyse", moving, "--tension-in", "10").out
    assert "since the first frame" not in run("analyse", still, measured, "--tension-in", "10").out
    outcome = run("analyse", moving, "--tension-in", "10", "--geometry-only", "--json")
    last = json.loads(outcome.out)
    assert last["tension_out_N"] == pytest.approx(10.0 * math.exp(-0.145 * 3.0), rel=1e-3)
    assert "since the first frame" not in run("analyse", moving, "--tension-in", "10", "--geometry-only").out


def test_a_warning_that_all_inputs_have_is_printed_once(run, tmp_path):
    lines = "\n".join(f"{0.1 * t},{10 * k},{k * k},0" for t in range(3) for k in range(8))
    for name in ("a", "b"):
        (tmp_path / f"{name}.csv").write_text("frame,x_mm,y_mm,z_mm\n" + lines, encoding="utf-8")
    out = run("analyse", tmp_path / "a.csv", tmp_path / "b.csv").out
    assert out.count("no time: the frames are counted") == out.count("all 2 inputs: no time: the frames") == 1
