"""A machine in a stream: its channels in each answer, its command, and its state over a restart."""

import json
import subprocess

import numpy as np
import pytest

from tests.live.peers import half_circle
from tests.live_process import PATIENCE, START, live
from tests.pipelines.test_machines import RIG
from tssgeom.rig import read_rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.machine import machine_of
from tssgeom.tendon.machine_simulation import simulate_machine

TIME = 0.1 * np.arange(40)
ANGLE = 0.6 * np.sin(TIME)


@pytest.fixture
def hardware(tmp_path):
    (tmp_path / "rig.toml").write_text(RIG)
    return tmp_path / "rig.toml"


def lines(first, last, **columns):
    points = half_circle()
    for k in range(first, last):
        readings = {name: float(values[k]) for name, values in columns.items()}
        content = {"t": float(TIME[k]), "unit": "mm", "points": points.tolist(), **readings}
        yield json.dumps(content).encode() + b"\n"


def replies_to(given, *options):
    with live(*options) as stream:
        stream.input.write(b"".join(given))
        stream.input.close()
        said = [json.loads(text) for text in stream.output.read().splitlines()]
        assert stream.process.wait(PATIENCE) == 0
    return [each for each in said if "stale" not in each or not each["stale"]]


def test_live_answers_as_simulate_and_goes_on_where_it_stopped(hardware, tmp_path):
    machine = machine_of(read_rig(hardware), [Arcs.exact(np.array([0.5]), np.array([3.0]))])
    expected = simulate_machine(machine, {"time_s": TIME, "motor_angle_rad": ANGLE})
    options = ("--rig", hardware, "--state", tmp_path / "machine.json")
    said = replies_to(lines(0, 20, motor_angle_rad=ANGLE), *options)
    said += replies_to(lines(20, 40, motor_angle_rad=ANGLE), *options)
    for name in ("tension_out_1_N", "tension_out_2_N", "joint_angle_rad", "motor_torque_Nm"):
        np.testing.assert_allclose([each[name] for each in said], expected[name], atol=1e-12)
    assert {"tension_out_N", "elongation_m", "length_m", "dead_zone", "latency_us"} <= said[0].keys()


def test_a_target_is_answered_by_an_angle_of_the_motor_and_a_bad_frame_by_its_reason(hardware):
    target = 0.2 * np.sin(TIME)
    bad = lines(20, 21, displacement_in_1_m=TIME, displacement_in_2_m=TIME)
    given = [*lines(0, 20, joint_angle_target_rad=target), *bad]
    said = replies_to([*given, *lines(21, 40, joint_angle_target_rad=target)], "--rig", hardware)
    assert "motor_angle_rad" in said[20]["rejected"]
    good = said[:20] + said[21:]
    reached = [each["joint_angle_rad"] for each in good]
    np.testing.assert_allclose(reached, np.delete(target, 20), atol=1e-6)
    assert all("motor_angle_command_rad" in each for each in good)


def test_the_state_of_another_kind_of_rig_is_refused(hardware, tmp_path):
    state = tmp_path / "machine.json"
    replies_to(lines(0, 3, tension_in_N=5.0 + TIME), "--state", state)
    command = [*START, "--rig", str(hardware), "--state", str(state)]
    done = subprocess.run(command, input=b"", capture_output=True, timeout=PATIENCE, check=False)
    assert done.returncode == 2
    assert b"the state is of one tendon" in done.stderr
