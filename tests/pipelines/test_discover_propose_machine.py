"""`discover --propose`, measure, `--with`: the loop closes on an independent segment with three drives."""

import json

import numpy as np
import pytest

from tests.identify.test_machine_design_drives import (
    ANGLE,
    ARM,
    AROUND,
    LENGTH,
    MU,
    PRETENSION,
    RHO,
    measured,
    planned,
)

RIG = f"""
[drive]
kind = "tendons"
[end]
kind = "segment"
radius_m = {ARM}
length_m = 0.06
marker_m = 0.008
stiffness_Nm_per_rad = "unknown"
tendon_angles_deg = {list(AROUND)}
[tendon]
pretension_N = {PRETENSION}
compliance_per_N = {RHO}
[friction]
coefficient = {MU}
[route]
length_m = {LENGTH}
angle_rad = {ANGLE}
"""
CAUSE = {"viscous_drag_Ns_per_m2": 400.0}
"""At the one rate of the campaign friction that depends on speed does nearly the same."""
SAMPLES = 481
"""So many that the legs of the fast run have enough for a drag that acts within them."""


def write(folder, columns):
    folder.mkdir()
    table = np.column_stack(list(columns.values()))
    np.savetxt(folder / "run.csv", table, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")
    (folder / "campaign.toml").write_text('[[run]]\ndata = "run.csv"\n', "utf-8")
    (folder / "rig.toml").write_text(RIG, "utf-8")


def report(out):
    return json.loads((out / "report.json").read_text("utf-8"))


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """A campaign of one run at one rate."""
    room = tmp_path_factory.mktemp("segment")
    write(room / "campaign", measured("displacement", *planned("displacement", SAMPLES), 3, **CAUSE))
    return room


def test_a_proposed_run_of_three_drives_is_simulated_measured_and_decides(room, run):
    options = ("--propose", "1", "--limits", "speed_mm_per_s=3", "--quiet", "--figures", room / "figures")
    assert run("discover", room / "campaign", "--out", room / "out", *options).status == 0
    before = report(room / "out")
    assert before["verdict"] == "none"
    assert "viscous_drag" in before["proposed"]["candidates"]
    (one,) = before["proposed"]["runs"]
    assert one["drive"] == [f"displacement_in_{k}_m" for k in (1, 2, 3)]
    assert [len(each) for each in one["corners"]] == [len(one["corner_time_s"])] * 3
    drive = room / "out" / "proposed" / "run_1.csv"
    first = drive.read_text("utf-8").splitlines()[0]
    assert first == "time_s,displacement_in_1_mm,displacement_in_2_mm,displacement_in_3_mm"
    assert (room / "figures" / "campaign_proposed_run_1.pdf").is_file()
    rig = room / "out" / "rig.updated.toml"
    done = run("simulate", "--drive", drive, "--rig", rig, "--out", room / "simulated", "--json")
    assert done.status == 0
    tension = json.loads(done.out)["range"]["tension_in_1_N"]
    assert max(tension) < 1.1 * before["proposed"]["limits"]["tension_N"]
    table = np.loadtxt(drive, delimiter=",", skiprows=1)
    time, moved = table[:, 0], table[:, 1:]
    assert np.abs(np.diff(moved, axis=0) / np.diff(time)[:, None]).max() <= 3.0 * 1.001
    assert np.abs(moved).max() <= before["proposed"]["limits"]["travel_mm"] * 1.001
    write(room / "new", measured("displacement", time, 1e-3 * moved, 4, **CAUSE))
    options = ("--with", room / "new", "--out", room / "after", "--quiet")
    assert run("discover", room / "campaign", *options).status == 0
    after = report(room / "after")
    assert (after["verdict"], [each["name"] for each in after["effects"]]) == ("effect", ["viscous_drag"])
    assert [each["held_out"] for each in after["runs"]] == [False, True, False]
