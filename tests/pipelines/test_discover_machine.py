"""`tssgeom discover` on a machine: one run, no shape, unknown numbers; other commands take its rig."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from pipelines.cli import main
from tests.identify.test_machine_discovery import ANGLE, ARM, LENGTH, MU, PRETENSION, RHO, columns
from tssgeom.errors import SettingsError
from tssgeom.io.formats.machine_campaigns import read_machine_campaign, with_machine_runs
from tssgeom.rig import read_rig

RIG = f"""
[drive]
kind = "pair"
radius_m = {ARM}
[end]
kind = "joint"
radius_m = {ARM}
stiffness_Nm_per_rad = "unknown"
[tendon]
pretension_N = {PRETENSION}
compliance_per_N = {RHO}
[friction]
coefficient = {MU}
[route]
length_m = {LENGTH}
angle_rad = {ANGLE}
"""


def command(*arguments):
    with pytest.raises(SystemExit) as ended:
        main([str(each) for each in arguments])
    return ended.value.code


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A pair by displacement alone, with a play at its joint."""
    folder = tmp_path_factory.mktemp("machine")
    run = columns(2, end_play=0.01, torque=False)
    table = np.column_stack(list(run.values()))
    np.savetxt(folder / "run.csv", table, delimiter=",", header=",".join(run), comments="", fmt="%.8g")
    (folder / "rig.toml").write_text(RIG, "utf-8")
    (folder / "campaign.toml").write_text('[[run]]\ndata = "run.csv"\n', "utf-8")
    assert not command("discover", folder, "--out", folder / "out", "--quiet")
    return folder


def test_report_page_and_rig_are_written_with_the_keys_of_one_tendon(results):
    out = results / "out"
    assert sorted(path.name for path in out.iterdir()) == ["report.html", "report.json", "rig.updated.toml"]
    report = json.loads((out / "report.json").read_text("utf-8"))
    assert report["verdict"] == "effect"
    (effect,) = report["effects"]
    assert effect["name"] == "end_play"
    assert effect["choices"] == {"key": "end.play_rad"}
    low, high = effect["parameters"]["play_rad"]["ci95"]
    assert low < 0.01 < high
    before, after = (report["gap"][when]["held_out"]["joint_angle_rad"] for when in ("before", "after"))
    assert after < 0.4 * before
    assert [(run["name"], run["held_out"]) for run in report["runs"]] == [
        ("run", False),
        ("run, held-out cycles", True),
    ]
    assert report["ranking"][0]["effects"][0]["name"] == "end_play"
    page = (out / "report.html").read_text("utf-8")
    assert "Play between the joint and what measures its angle" in page
    assert re.search(r"θ_\W*j\W+over", page)  # with subscripts


def test_other_commands_take_the_rig(results, tmp_path):
    updated = results / "out" / "rig.updated.toml"
    rig = read_rig(updated)
    assert rig.end.play_rad == pytest.approx(0.01, rel=0.1)
    run = results / "run.csv"
    assert not command("calibrate", run, "--rig", updated, "--out", tmp_path / "again.toml", "--quiet")
    again = read_rig(tmp_path / "again.toml")
    assert again.end.play_rad == rig.end.play_rad


def test_a_shape_that_is_left_out_needs_a_route_in_the_rig(results, tmp_path, capsys):
    (tmp_path / "run.csv").write_bytes((results / "run.csv").read_bytes())
    (tmp_path / "campaign.toml").write_text('[[run]]\ndata = "run.csv"\n', "utf-8")
    (tmp_path / "rig.toml").write_text(RIG.partition("[route]")[0], "utf-8")
    assert command("discover", tmp_path, "--out", tmp_path / "out", "--quiet") == 2
    assert "route.length_m and route.angle_rad" in capsys.readouterr().err


def test_new_runs_of_a_machine_are_added_and_what_is_held_out_stays(results, tmp_path):
    one = read_machine_campaign(results)
    (tmp_path / "run.csv").write_bytes((results / "run.csv").read_bytes())
    (tmp_path / "campaign.toml").write_text('[[run]]\ndata = "run.csv"\n', "utf-8")
    both = with_machine_runs(one, tmp_path)
    assert [run.name for run in both.runs] == ["run", f"{tmp_path.name}_run"]
    assert both.held_out == ()
    assert both.notes[-1].endswith(f"added from {tmp_path}")
    with pytest.raises(SettingsError, match="name each folder once"):
        with_machine_runs(both, tmp_path)
    more = tmp_path / "more"
    more.mkdir()
    (more / "run.csv").write_bytes((results / "run.csv").read_bytes())
    (more / "campaign.toml").write_text('[[run]]\ndata = "run.csv"\n', "utf-8")
    every = with_machine_runs(both, more)
    assert (every.held_out, every.in_cycles) == ((), "run")
    assert with_machine_runs(replace(both, in_cycles=""), more).held_out == (f"{tmp_path.name}_run",)


def test_a_command_takes_new_runs_of_a_machine_and_proposes_more(results, tmp_path, capsys):
    out = tmp_path / "out"
    assert command("discover", results, "--with", tmp_path / "none", "--out", out, "--quiet") == 2
    assert "none" in capsys.readouterr().err
    limits = ("--limits", "tension_N=1e-3")
    assert command("discover", results, "--propose", "1", *limits, "--out", out, "--quiet") == 2
    assert "limits forbid every run" in capsys.readouterr().err
    assert not out.exists()
    assert command("discover", results, "--propose", "1", "--out", out, "--quiet") == 0
    first, *rows = (out / "proposed" / "run_1.csv").read_text("utf-8").splitlines()
    assert first == "time_s,motor_angle_rad"
    assert len(rows) > 20
    assert "expected" in (out / "proposed" / "proposal.toml").read_text("utf-8")
    assert "run_1" in (out / "report.html").read_text("utf-8")
