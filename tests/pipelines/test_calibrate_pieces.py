"""`tssgeom calibrate --every`: a long log, piece by piece."""

import json

import msgspec
import numpy as np

from tests.described import described, optional
from tests.twins import drifting_friction, route_points
from tssgeom.mechanism import GivenRoute
from tssgeom.rig import Friction, Load, Rig, Tendon, read_rig, write_rig


def test_calibrate_of_a_log_in_pieces_writes_the_rig_of_the_last_one(run, tmp_path):
    scenario = drifting_friction(seed=1, hours=0.25)
    machine = scenario.machine
    columns = {"time_s": scenario.times}
    columns |= {name: scenario.readings[name] for name in ("tension_in_N", "displacement_in_m")}
    log, shape, rig = tmp_path / "log.csv", tmp_path / "shape.csv", tmp_path / "rig.toml"
    np.savetxt(
        log,
        np.column_stack(list(columns.values())),
        delimiter=",",
        header=",".join(columns),
        comments="",
    )
    points = route_points(machine.lengths_m, machine.angles_rad, 60)
    np.savetxt(shape, points, delimiter=",", header="x_m,y_m,z_m", comments="")
    hardware = Rig(
        tendon=Tendon(compliance_per_N=machine.compliance_per_N, pretension_N=machine.pretension_N),
        friction=Friction(coefficient=machine.friction),
        load=Load(stiffness_N_per_m=machine.stiffness_N_per_m),
    )
    given = GivenRoute(length_m=machine.length_m, angle_rad=machine.total_angle_rad)
    write_rig(rig, msgspec.structs.replace(hardware, route=given))
    bent = run("calibrate", log, "--rig", rig, "--out", tmp_path / "even.toml", "--every", "300")
    assert bent.status == 0
    assert read_rig(tmp_path / "even.toml").friction.coefficient > 0.0
    short = run("calibrate", log, "--rig", rig, "--out", tmp_path / "short.toml", "--every", "0")
    assert short.status == 2
    assert short.errors[0].startswith(f"tssgeom: {log}: ")
    write_rig(rig, hardware)
    command = ["calibrate", log, "--shape", shape, "--rig", rig, "--out", tmp_path / "day", "--json"]
    done = run(*command, "--every", "300")
    assert done.status == 0
    report = json.loads(done.out)
    assert described("calibrate --every --json", report) == optional("calibrate --every --json")
    assert [piece["passes"] for piece in report["pieces"]] == [True, True, True]
    last = report["pieces"][-1]["estimates"]["friction.coefficient"]
    assert read_rig(tmp_path / "day" / "rig.toml").friction.coefficient == last["value"]
    assert (tmp_path / "day" / "course.png").stat().st_size > 10_000
    refused = run(*command, "--every", "0")
    assert refused.status == 2
    assert "greater --every" in refused.errors[0]
