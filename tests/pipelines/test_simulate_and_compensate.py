"""simulate drives the model by a run, compensate turns it round; on routes that stand and that move."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as papq
import pytest

Run = Callable[..., Any]

COLUMNS = [
    "time_s",
    "tension_in_N",
    "tension_out_N",
    "elongation_m",
    "displacement_in_m",
    "displacement_out_m",
    "phase",
    "direction_index",
    "dead_zone_N",
]


def write_run(path: Path, **columns: list[float]) -> Path:
    rows = zip(*columns.values(), strict=True)
    path.write_text(",".join(columns) + "\n" + "".join(",".join(map(str, row)) + "\n" for row in rows))
    return path


@pytest.fixture
def opening(tmp_path: Path) -> Path:
    """A bend of 500 mm that opens from 180° to 90° in four seconds."""
    lines = []
    for time in range(5):
        turn = math.pi * (1 - time / 8)
        along = np.linspace(0.0, turn, 40)
        points = 500.0 / turn * np.column_stack([np.cos(along), np.sin(along), 0 * along])
        lines.append(json.dumps({"t": time, "points": points.tolist(), "unit": "mm"}))
    path = tmp_path / "opening.jsonl"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_simulate_gives_a_row_for_each_row_of_the_run(run: Run, half: Path, tmp_path: Path):
    drive = write_run(
        tmp_path / "drive.csv", time_s=[0, 1, 2, 3, 4, 5], tension_in_N=[5.0, 15.0, 15.0, 10.0, 5.0, 6.0]
    )
    done = run("simulate", half, "--drive", drive, "--out", tmp_path / "out", "--json")
    assert (done.status, done.errors) == (0, [])
    table = papq.read_table(tmp_path / "out" / "simulate.parquet")
    assert table.column_names == COLUMNS
    units = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
    assert units["elongation_m"] == "m"
    assert units["dead_zone_N"] == "N"
    rows = table.to_pydict()
    assert rows["phase"] == ["pull", "pull", "hold", "pull_to_release", "release", "release_to_pull"]
    assert rows["direction_index"] == [1, 1, 1, -1, -1, 1]
    # the paper's half circle, model page (5), (6); 4e-4 for the fit of the 40 points in the file
    assert rows["tension_out_N"][1] == pytest.approx(9.5117, rel=4e-4)
    assert rows["dead_zone_N"][3] == pytest.approx(10.0 - 6.031, rel=4e-3)
    assert rows["elongation_m"][3] == pytest.approx(1.7284e-3, rel=1e-3)
    summary = json.loads(done.out)
    assert summary["rows"] == 6
    assert summary["phases"]["pull"] == 2
    assert all(Path(file).is_file() for file in summary["files"])


def test_a_rig_that_states_its_errors_gives_bars_to_a_simulation(run: Run, half: Path, tmp_path: Path):
    """On the half circle T_out moves by T_out π for each unit of friction, and T_out counts what is left."""
    drive = write_run(tmp_path / "drive.csv", time_s=[0, 1, 2], tension_in_N=[5.0, 15.0, 20.0])
    rig = tmp_path / "rig.toml"
    rig.write_text("friction.coefficient = { value = 0.145, sd = 0.01 }\nunexplained.tension_out_N = 0.2\n")
    done = run("simulate", half, "--drive", drive, "--rig", rig, "--out", tmp_path / "out")
    assert done.status == 0
    assert "T_out up to 0.45 N" in done.out
    rows = papq.read_table(tmp_path / "out" / "simulate.parquet").to_pydict()
    assert list(rows) == [*COLUMNS, "tension_out_se_N", "elongation_se_m"]
    at_least = [math.hypot(0.01 * math.pi * pull, 0.2) for pull in rows["tension_out_N"]]
    assert rows["tension_out_se_N"] == pytest.approx(at_least, rel=0.02)
    assert all(error > 0.0 for error in rows["elongation_se_m"])


def test_a_simulation_that_cannot_write_its_recording_leaves_no_table(run: Run, half: Path, tmp_path: Path):
    out = tmp_path / "out"
    (out / "simulate.rrd").mkdir(parents=True)
    drive = write_run(tmp_path / "drive.csv", time_s=[0, 1], tension_in_N=[5.0, 15.0])
    done = run("simulate", half, "--drive", drive, "--out", out)
    assert done.status == 2
    assert f"{out}/simulate.rrd: is no file" in done.errors[-1]
    assert [path.name for path in out.iterdir()] == ["simulate.rrd"]


def test_a_simulation_that_fails_keeps_the_table_of_an_earlier_one(run: Run, half: Path, tmp_path: Path):
    out = tmp_path / "out"
    drive = write_run(tmp_path / "drive.csv", time_s=[0, 1], tension_in_N=[5.0, 15.0])
    assert run("simulate", half, "--drive", drive, "--out", out).status == 0
    before = (out / "simulate.parquet").read_bytes()
    assert run("simulate", half, "--drive", tmp_path / "mistyped.csv", "--out", out).status == 2
    assert (out / "simulate.parquet").read_bytes() == before


def test_a_run_that_the_rig_cannot_bear_is_refused(run: Run, half: Path, tmp_path: Path):
    drive = write_run(tmp_path / "drive.csv", time_s=[0, 1], tension_in_N=[5.0, 3000.0])
    done = run("simulate", half, "--drive", drive, "--out", tmp_path / "out", "--json")
    assert done.status == 2
    assert len(done.errors) == 1
    assert "3000 N, which would stretch the tendon by 95%: give newtons" in done.errors[0]


def test_a_moving_route_is_taken_between_its_frames(run: Run, opening: Path, tmp_path: Path):
    times = [0.0, 0.5, 1.0, 2.5, 4.0, 9.0]
    drive = write_run(tmp_path / "drive.csv", time_s=times, tension_in_N=[10.0] * 6)
    assert run("simulate", opening, "--drive", drive, "--out", tmp_path / "out", "--quiet").status == 0
    rows = papq.read_table(tmp_path / "out" / "simulate.parquet").to_pydict()
    angle = [math.pi * (1 - min(time, 4.0) / 8) for time in times]
    # a bend that opens lets the tendon slide on, so the whole of it stays at the edge of its cone
    expected = [10.0 * math.exp(-0.145 * one) for one in angle]
    assert rows["tension_out_N"] == pytest.approx(expected, rel=1e-3)
    assert rows["phase"] == ["pull"] + ["hold"] * 5


def test_the_commands_bring_the_distal_end_to_its_target(run: Run, opening: Path, tmp_path: Path):
    target_m = [1e-3, 4e-3, 6e-3, 5e-3, 2e-3, 3e-3]
    times = [0.0, 0.7, 1.4, 2.1, 2.8, 3.5]
    target = write_run(tmp_path / "target.csv", time_s=times, displacement_out_m=target_m)
    done = run("compensate", opening, "--target", target, "--out", tmp_path / "out", "--json")
    assert (done.status, json.loads(done.out)["rows"]) == (0, 6)
    commands = papq.read_table(tmp_path / "out" / "compensate.parquet")
    assert commands.column_names[:3] == ["time_s", "displacement_in_m", "tension_in_N"]
    assert commands["displacement_reached_m"].to_pylist() == pytest.approx(target_m, rel=1e-9)
    for drive in ("tension_in_N", "displacement_in_m"):
        path = write_run(tmp_path / f"{drive}.csv", time_s=times, **{drive: commands[drive].to_pylist()})
        assert run("simulate", opening, "--drive", path, "--out", tmp_path / drive, "--quiet").status == 0
        rows = papq.read_table(tmp_path / drive / "simulate.parquet").to_pydict()
        # tension: the same model inverted; position: bars from the start against corners first: 5e-4 of δ
        exact = drive == "tension_in_N"
        assert rows["displacement_out_m"] == pytest.approx(target_m, rel=1e-6 if exact else 2e-3, abs=1e-9)


def test_commands_that_no_tendon_bears_are_refused(run: Run, half: Path, tmp_path: Path):
    target = write_run(tmp_path / "target.csv", time_s=[0, 1], displacement_out_m=[0.0, 0.9])
    done = run("compensate", half, "--target", target, "--out", tmp_path / "out")
    assert (done.status, len(done.errors)) == (2, 1)
    assert "at time_s = 1: the target needs a move of 1.08 m" in done.errors[0]
    assert done.errors[0].endswith("[stroke]")
    assert not (tmp_path / "out" / "compensate.parquet").exists()


def test_a_target_out_of_reach_is_one_line(run: Run, half: Path, tmp_path: Path):
    target = write_run(tmp_path / "target.csv", time_s=[0, 1], displacement_out_m=[1e-3, -0.5])
    done = run("compensate", half, "--target", target, "--out", tmp_path / "out")
    assert done.status == 2
    assert len(done.errors) == 1
    assert "only pulls" in done.errors[0]
    assert f"{target} on {half}: at time_s = 1: " in done.errors[0]
    assert not (tmp_path / "out" / "compensate.parquet").exists()


def test_a_run_without_a_drive_is_one_line(run: Run, half: Path, tmp_path: Path):
    drive = write_run(tmp_path / "drive.csv", time_s=[0, 1], tension_out_N=[1.0, 2.0])
    done = run("simulate", half, "--drive", drive, "--out", tmp_path / "out")
    assert (done.status, len(done.errors)) == (2, 1)
    assert "tension_in_N or displacement_in_m" in done.errors[0]


def test_a_drive_that_cannot_be_is_one_line_that_names_its_file(run: Run, half: Path, tmp_path: Path):
    drive = write_run(tmp_path / "drive.csv", time_s=[0, 1], tension_in_N=[1.0, -2.0])
    done = run("simulate", half, "--drive", drive, "--out", tmp_path / "out")
    assert (done.status, len(done.errors)) == (2, 1)
    assert f"{drive}: tension_in_N falls to -2 N: a tendon only pulls" in done.errors[0]


def test_a_bad_frame_is_reported_and_the_rest_is_done(run: Run, opening: Path, tmp_path: Path):
    lines = opening.read_text().splitlines()
    opening.write_text("\n".join([lines[0], '{"t": 0.5, "points": [[1,2', *lines[1:]]) + "\n")
    drive = write_run(tmp_path / "drive.csv", time_s=[0, 1], tension_in_N=[1.0, 2.0])
    done = run("simulate", opening, "--drive", drive, "--out", tmp_path / "out", "--quiet")
    assert done.status == 1
    assert "frame 1" in done.errors[0]


RIG = """
[tendon]
pretension_N = 3.0

[friction]
coefficient = { value = 0.145, sd = 0.015 }

[drive]
limits = { tension_N = 12.0, displacement_m = [0.0, 0.02], speed_m_per_s = 0.05 }
"""


def risky(
    run: Run, half: Path, folder: Path, *options: str, rig: str = RIG
) -> tuple[Any, dict[str, list[Any]]]:
    (folder / "rig.toml").write_text(rig)
    target = write_run(
        folder / "target.csv", time_s=[0, 1, 2, 3], displacement_out_m=[2e-3, 1.99e-3, 8e-3, 3e-3]
    )
    out = folder / "out"
    done = run(
        "compensate", half, "--target", target, "--out", out, "--rig", folder / "rig.toml", *options, "--json"
    )
    return done, papq.read_table(out / "compensate.parquet").to_pydict()


def test_commands_come_with_their_error_and_say_what_cut_them(run: Run, half: Path, tmp_path: Path):
    done, rows = risky(run, half, tmp_path, "--tolerance-mm", "0.2")
    assert done.status == 1
    assert rows["limited"] == ["", "", "tension_N", ""]
    assert max(rows["tension_in_N"]) == pytest.approx(12.0, rel=1e-9)
    assert rows["displacement_reached_m"][2] < 8e-3
    # T_out = T_in exp(−μΦ) for a drive by tension: 5 N · π · 0.015
    assert rows["tension_out_se_by_tension_N"][0] == pytest.approx(0.236, rel=0.02)
    assert 0.0 < rows["displacement_out_se_m"][0] < rows["displacement_out_se_by_tension_m"][0]
    assert rows["out_of_tolerance"][2] > 0.99
    summary = json.loads(done.out)
    assert [each["time_s"] for each in summary["limited"]] == [2.0]
    assert summary["out_of_tolerance"]["targets"] >= 1
    assert summary["out_of_tolerance"]["time_s"] == 2.0
    assert summary["displacement_out_se_m"] == max(rows["displacement_out_se_m"])
    cut, missed = done.errors
    assert "1 of 4 commands are cut by drive.limits, the first at 2 s by tension_N" in cut
    assert "may be missed by more than 0.2 mm with a probability above 5 %, the worst at 2 s" in missed


def test_targets_below_what_friction_holds_are_flagged_and_counted_and_the_others_followed(
    run: Run, half: Path, tmp_path: Path
):
    rig = tmp_path / "rig.toml"
    rig.write_text('[[effects]]\nname = "straight_section_friction"\nforce_N_per_m = 4.0\n')
    wanted = [5.0, 0.3, 0.2, 6.0, 5.0]
    target = write_run(tmp_path / "target.csv", time_s=[0, 1, 2, 3, 4], tension_out_N=wanted)
    out = tmp_path / "out"
    done = run("compensate", half, "--target", target, "--out", out, "--rig", rig, "--json")
    rows = papq.read_table(out / "compensate.parquet").to_pydict()
    assert done.status == 1
    assert rows["limited"] == ["", "tension_N", "tension_N", "", ""]
    assert rows["tension_in_N"][1:3] == [0.0, 0.0]
    reached = rows["tension_reached_N"]
    assert [reached[row] for row in (0, 3, 4)] == pytest.approx([5.0, 6.0, 5.0], rel=1e-9)
    assert reached[1] == pytest.approx(reached[2], rel=1e-9)
    assert [each["time_s"] for each in json.loads(done.out)["limited"]] == [1.0, 2.0]
    (said,) = done.errors
    assert "2 of 5 targets are below what friction holds without any pull, so that the drive lets go" in said
    assert "first at 1 s" in said
    assert f"{reached[1]:.4g} N are reached" in said


def test_a_drive_that_may_wait_does_not_turn_for_less_than_its_error(run: Run, half: Path, tmp_path: Path):
    waited = risky(run, half, tmp_path, "--policy", "wait")[1]
    crossed = risky(run, half, tmp_path)[1]
    assert waited["waits"] == [0, 1, 0, 0]
    assert crossed["waits"] == [0, 0, 0, 0]
    assert waited["displacement_in_m"][1] == pytest.approx(waited["displacement_in_m"][0], abs=1e-9)
    assert crossed["displacement_in_m"][1] < crossed["displacement_in_m"][0] - 1e-4


def test_the_figure_of_commands_is_written(run: Run, half: Path, tmp_path: Path):
    done, _ = risky(run, half, tmp_path, "--figures", str(tmp_path / "figures"))
    written = {Path(file).name for file in json.loads(done.out)["files"]}
    assert written == {"compensate.parquet", "target_commands.pdf", "target_commands.svg"}
    assert (tmp_path / "figures" / "target_commands.svg").read_text().startswith("<?xml")


@pytest.mark.parametrize(
    ("rig", "options", "said"),
    [
        (RIG.replace("{ value = 0.145, sd = 0.015 }", '"unknown"'), [], "friction.coefficient is unknown"),
        (RIG, ["--tolerance-mm", "0"], "--tolerance-mm is 0 mm: give a finite value > 0 mm"),
        (RIG.replace("[0.0, 0.02]", "[0.01, 0.02]"), [], "drive.limits.displacement_m is [0.01, 0.02]"),
    ],
)
def test_what_no_command_can_be_made_of_is_one_line(run, half, tmp_path, rig, options, said):
    (tmp_path / "rig.toml").write_text(rig)
    target = write_run(tmp_path / "target.csv", time_s=[0, 1], displacement_out_m=[1e-3, 2e-3])
    paths = ["--target", target, "--out", tmp_path / "out", "--rig", tmp_path / "rig.toml"]
    done = run("compensate", half, *paths, *options)
    assert (done.status, len(done.errors)) == (2, 1)
    assert said in done.errors[0]
