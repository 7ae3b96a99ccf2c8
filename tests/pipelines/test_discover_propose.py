"""`discover --propose`, measure, `--with`: the loop closes on a rig that shares no code with the model."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from pipelines.cli import main
from tests.campaigns import make_campaign
from tests.campaigns.measure import measure_proposed
from tests.pipelines.conftest import Run

CAUSE, PLAN, SEED = "viscous_drag", "one_rate", 0
"""One rate ties it to a refit of friction (G5)."""


@pytest.fixture(scope="module")
def tied(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign with a tie, what was proposed to break it in `out`, and what the rig measured in `new`."""
    room = tmp_path_factory.mktemp("loop")
    make_campaign(room / "campaign", SEED, CAUSE, plan=PLAN)
    with pytest.raises(SystemExit) as ended:
        main(
            [
                *("discover", str(room / "campaign"), "--out", str(room / "out"), "--quiet"),
                *("--propose", "1"),
                *("--limits", "speed_mm_per_s=3 travel_mm=5", "--figures", str(room / "figures")),
            ]
        )
    assert not ended.value.code
    measure_proposed(room / "out" / "proposed", room / "new", SEED, CAUSE, PLAN)
    return room


def report(out: Path) -> dict:
    return json.loads((out / "report.json").read_text("utf-8"))


def test_a_tie_is_broken_and_named_right_by_the_run_that_was_proposed(tied, run):
    before = report(tied / "out")
    assert before["verdict"] == "none"
    assert CAUSE in before["proposed"]["candidates"]
    out = tied / "after"
    shutil.copy(tied / "out" / "proposed" / "proposal.toml", tied / "new")
    done = run("discover", tied / "campaign", "--with", tied / "new", "--out", out, "--quiet")
    assert (done.status, done.errors) == (0, [])
    after = report(out)
    assert after["verdict"] == "effect"
    assert after["effects"][0]["name"] == CAUSE
    held = [[each["name"] for each in one["runs"] if each["held_out"]] for one in (before, after)]
    assert held[0] == held[1] == ["run_5"]
    assert [each["name"] for each in after["runs"]][-1] == "new_run_1"
    assert after["proposed"] is None


def test_a_tie_of_one_route_is_broken_on_the_other_route_that_is_proposed(tmp_path, run):
    """On a half circle friction that depends on curvature is friction (G6): no drive separates them there."""
    case = (1, "curvature_dependent_friction", "one_route")
    make_campaign(tmp_path / "campaign", *case[:2], plan=case[2])
    done = run("discover", tmp_path / "campaign", "--out", tmp_path / "out", "--propose", "1", "--quiet")
    assert done.status == 0
    before = report(tmp_path / "out")
    assert before["verdict"] == "none"
    assert before["proposed"]["candidates"] == ["base", case[1]]
    assert len(before["proposed"]["runs"][0]["new_route"]["angle_rad"]) > 1
    measure_proposed(tmp_path / "out" / "proposed", tmp_path / "new", *case)
    options = ("--with", tmp_path / "new", "--out", tmp_path / "after", "--quiet")
    assert run("discover", tmp_path / "campaign", *options).status == 0
    after = report(tmp_path / "after")
    assert (after["verdict"], after["effects"][0]["name"]) == ("effect", case[1])


def test_what_is_proposed_is_in_files_report_and_figures(tied):
    folder = tied / "out" / "proposed"
    assert sorted(path.name for path in folder.iterdir()) == ["proposal.toml", "run_1.csv"]
    proposed = report(tied / "out")["proposed"]
    assert proposed["limits"]["travel_mm"] == 5.0
    assert proposed["stated_limits"] == ["speed_mm_per_s", "travel_mm"]
    (one,) = proposed["runs"]
    assert {"route", "why", "outcomes", "expected", "corners"} <= one.keys()
    assert any("for viscous drag" in words for words in one["outcomes"]), one["outcomes"]
    page = (tied / "out" / "report.html").read_text("utf-8")
    assert "What to measure next, designed" in page
    assert (tied / "figures" / "campaign_proposed_run_1.pdf").is_file()


def test_a_proposed_drive_is_a_run_that_simulate_reads(tied, run):
    route = report(tied / "out")["proposed"]["runs"][0]["route"]
    drive = tied / "out" / "proposed" / "run_1.csv"
    done = run(
        "simulate", tied / "campaign" / f"{route}.csv", "--drive", drive, "--rig",
        tied / "out" / "rig.updated.toml", "--out", tied / "simulated", "--json",
    )  # fmt: skip
    assert done.status == 0  # one line on stderr states that positions are read in mm
    tension = json.loads(done.out)["range"]["tension_in_N"]
    assert max(tension) < 1.1 * report(tied / "out")["proposed"]["limits"]["tension_N"]


REFUSED = {
    "no folder": (["--with", "nowhere"], "no such folder"),
    "no run": (["--with", "empty"], "no run in it: put the measured runs there"),
    "no route": (["--with", "bare"], "its route is not known: copy proposal.toml"),
    "limits alone": (["--limits", "tension_N=20"], "add --propose N"),
    "no number": (["--propose", "1", "--limits", "tension_N"], "give key=value"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_done_is_refused_in_one_line_with_what_to_do(
    tied, tmp_path, run: Run, case, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "bare").mkdir()
    shutil.copy(tied / "campaign" / "run_1.csv", tmp_path / "bare" / "more.csv")
    options, words = REFUSED[case]
    done = run("discover", tied / "campaign", "--out", tmp_path / "out", *options)
    assert done.status == 2
    assert len(done.errors) == 1
    assert words in done.errors[0]
    assert not (tmp_path / "out").exists()


def test_proposals_are_not_written_over_measured_runs(tied, run):
    done = run(
        "discover",
        tied / "campaign",
        "--with",
        tied / "out" / "proposed",
        "--out",
        tied / "out",
        "--propose",
        "1",
    )
    assert done.status == 2
    assert "would write over these runs" in done.errors[0]


def test_a_drive_file_is_no_measured_run(tied, tmp_path, run):
    done = run(
        "discover",
        tied / "campaign",
        "--with",
        tied / "out" / "proposed",
        "--out",
        tmp_path / "out",
        "--quiet",
    )
    assert done.status == 2
    assert "a drive without a response" in done.errors[0]
    table = np.genfromtxt(tied / "out" / "proposed" / "run_1.csv", delimiter=",", names=True)
    assert table.dtype.names == ("time_s", "displacement_in_mm")
