"""Commands of a joint in a stream: limits, policy, errors, and a drive whose record lags."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace as changed
from scipy.special import ndtr

from tests.tendon.test_machine import rig
from tests.test_machine_stream import ANGLE, POINTS, TIME, carried, simulated
from tssgeom import Engine, Frame
from tssgeom.api.machine_calls import commanded_machine
from tssgeom.io.formats.runs import MeasuredRun
from tssgeom.io.formats.states import read_state, write_state
from tssgeom.mechanism import Drive, DriveLimits
from tssgeom.rig import Sensor, with_values
from tssgeom.sensed_route import fit_frame
from tssgeom.tendon.commander import commander_of
from tssgeom.tendon.machine import machine_of, routed
from tssgeom.tendon.machine_command import command_machine
from tssgeom.tendon.machine_simulation import simulate_machine
from tssgeom.uncertain import Prior, Uncertain

TARGET = 0.4 * np.sin(TIME)
ARM = 0.01  # m


def pair(**drive):
    return changed(rig(), drive=Drive(kind="pair", radius_m=ARM, **drive))


def commanded(hardware, target, commander=None, time=TIME):
    engine = Engine(hardware, tension_in=15.0, commander=commander)
    return carried(hardware, {"joint_angle_target_rad": target}, engine, time=time)


def command_of(result):
    return result.machine.command


def motor_of(result):
    return command_of(result).inputs["motor_angle_rad"]


@pytest.mark.parametrize(
    ("limits", "name"),
    [
        (DriveLimits(tension_N=9.0), "tension_N"),
        (DriveLimits(displacement_m=(-2e-3, 1.5e-3)), "displacement_m"),
        (DriveLimits(speed_m_per_s=2e-3), "speed_m_per_s"),
    ],
    ids=lambda each: each if isinstance(each, str) else "",
)
def test_no_command_exceeds_a_limit_of_the_drive(limits, name):
    results = commanded(pair(play_rad=0.02, limits=limits), TARGET)
    angle = np.array([motor_of(each) for each in results])
    cut = [command_of(each).limited for each in results]
    assert name in cut
    assert set(cut) <= {"", name}
    if limits.tension_N is not None:
        pulls = [each.machine.channels[f"tension_in_{k}_N"] for each in results for k in (1, 2)]
        assert max(pulls) <= 9.0 * (1.0 + 1e-6)
    if limits.displacement_m is not None:
        assert ARM * angle.max() <= 1.5e-3 + 1e-9
        assert ARM * angle.min() >= -2e-3 - 1e-9
    if limits.speed_m_per_s is not None:
        assert ARM * np.abs(np.diff(angle)).max() <= 2e-3 * (TIME[1] - TIME[0]) + 1e-9
        assert angle[0] == pytest.approx(0.0, abs=1e-9)  # no time has passed before the first command
    first = cut.index(name)
    assert "joint_angle_reached_rad" in results[first].machine.numbers
    tracked = fit_frame(Frame(POINTS, 0.0), pair())[1]
    machine = machine_of(pair(play_rad=0.02, limits=limits), [routed(tracked.fit.arcs, pair())])
    np.testing.assert_allclose(
        command_machine(machine, TIME, {"joint_angle_rad": TARGET}).inputs[:, 0], angle, atol=1e-5
    )


def test_a_target_that_trembles_inside_the_tolerance_moves_no_motor_that_waits():
    tremble = 0.2 + 0.005 * (-1.0) ** np.arange(20)
    target = np.concatenate((np.linspace(0.0, 0.2, 5), tremble, [0.05]))
    time = 0.1 * np.arange(len(target))
    hardware = pair(play_rad=0.02)
    commander = commander_of(hardware, tolerance=1.5e-2 * hardware.end.radius_m, policy="wait")
    results = commanded(hardware, target, commander, time)
    angle = np.array([motor_of(each) for each in results])
    assert np.ptp(angle[8:25]) < 1e-12
    assert any(command_of(each).waits for each in results[5:25])
    assert not command_of(results[-1]).waits
    assert results[-1].machine.channels["joint_angle_rad"] == pytest.approx(0.05, abs=1e-6)
    crossing = [motor_of(each) for each in commanded(hardware, target, time=time)]
    assert np.ptp(crossing[8:25]) > 0.05


def test_standard_errors_hold_what_an_uncertain_friction_does_to_the_joint():
    friction = pair().friction.coefficient
    known = Uncertain("friction.coefficient", Prior(friction, 0.2 * friction, log=False), stated=True)
    target = np.concatenate((np.linspace(0.0, 0.3, 10), np.linspace(0.29, 0.1, 10)))
    time = 0.1 * np.arange(20)
    results = commanded(pair(), target, commander_of(pair(), [known], tolerance=1e-5), time)
    errors = [each.machine.numbers["joint_angle_se_rad"] for each in results]
    command = command_of(results[-1])
    run = {
        "time_s": time,
        "motor_angle_rad": np.array([motor_of(each) for each in results]),
    }
    ends = []
    for u in (-1.0, 1.0):
        other = changed(pair(), friction=changed(pair().friction, coefficient=known.prior.value(u)))
        ends.append(simulated(other, run)["joint_angle_rad"])
    np.testing.assert_allclose(errors, 0.5 * np.abs(ends[1] - ends[0]), rtol=0.05, atol=1e-6)
    assert command.out_of_tolerance is not None
    assert command.out_of_tolerance > 0.05


def test_a_motor_that_acts_later_does_frame_by_frame_what_simulate_does_over_a_restart(tmp_path):
    hardware = pair(lag_s=-0.35, play_rad=0.03)
    columns = {"motor_angle_rad": ANGLE}
    expected = simulated(hardware, columns)
    engine = Engine(hardware, tension_in=15.0)
    first = carried(hardware, {"motor_angle_rad": ANGLE[:30]}, engine, time=TIME[:30])
    write_state(tmp_path / "machine.json", engine.state)
    again = Engine(hardware, tension_in=15.0, state=read_state(tmp_path / "machine.json"))
    rest = carried(hardware, {"motor_angle_rad": ANGLE[30:]}, again, time=TIME[30:])
    for name, values in expected.items():
        got = [each.machine.channels[name] for each in (*first, *rest)]
        np.testing.assert_allclose(got, values, rtol=0.0, atol=1e-9, err_msg=name)


def test_commands_of_a_motor_that_acts_later_start_from_where_the_last_ones_will_have_led():
    """The joint is at each target once the command acts: two frames later."""
    hardware, lag = pair(lag_s=-0.4), 2
    results = commanded(hardware, TARGET)
    joint = np.array([each.machine.channels["joint_angle_rad"] for each in results])
    np.testing.assert_allclose(joint[lag:], TARGET[:-lag], atol=1e-5)


def test_commands_are_what_the_sensor_of_the_motor_reads():
    hardware = changed(pair(), sensors={"motor_angle_rad": Sensor(zero=0.05, gain=1.2)})
    tracked = fit_frame(Frame(POINTS, 0.0), hardware)[1]
    machine = machine_of(hardware, [routed(tracked.fit.arcs, hardware)])
    run = MeasuredRun("target", Path("target.csv"), TIME, of_machine={"joint_angle_rad": TARGET})
    done = commanded_machine(run, [tracked.fit.arcs], hardware)
    read = {"time_s": TIME, "motor_angle_rad": done.channels["motor_angle_rad"]}
    np.testing.assert_allclose(simulate_machine(machine, read)["joint_angle_rad"], TARGET, atol=1e-6)
    got = [motor_of(each) for each in commanded(hardware, TARGET)]
    np.testing.assert_allclose(got, done.channels["motor_angle_rad"], atol=1e-5)


def test_commands_of_a_run_know_how_far_uncertain_numbers_may_turn_the_joint_elsewhere():
    hardware, sd = pair(), 5e-5
    arcs = [fit_frame(Frame(POINTS, 0.0), hardware)[1].fit.arcs]
    arcs = [replace(arcs[0], covariance=0.0 * arcs[0].covariance)]
    rho = hardware.tendon.compliance_per_N
    uncertain = [Uncertain("tendon.compliance_per_N", Prior(rho, sd, log=False), stated=True)]
    run = MeasuredRun("target", Path("target.csv"), TIME, of_machine={"joint_angle_rad": TARGET})
    plain = commanded_machine(run, arcs, hardware)
    done = commanded_machine(run, arcs, hardware, uncertain, tolerance=1e-5)
    assert "joint_angle_se_rad" not in plain.channels
    read = {"time_s": TIME, "motor_angle_rad": plain.channels["motor_angle_rad"]}
    low, high = (
        simulate_machine(machine_of(rig, [routed(arcs[0], rig)]), read)["joint_angle_rad"]
        for rig in (with_values(hardware, {"tendon.compliance_per_N": rho + by}) for by in (-sd, sd))
    )
    error = done.channels["joint_angle_se_rad"]
    np.testing.assert_allclose(error, 0.5 * np.abs(high - low), rtol=0.02, atol=1e-5)
    far = 2.0 * ndtr(-1e-5 / (hardware.end.radius_m * error.max()))
    assert done.channels["out_of_tolerance"].max() == pytest.approx(far, rel=1e-3)
    assert "may be missed by more than 0.01 mm" in done.warnings[0]
    sure = commanded_machine(run, arcs, hardware, uncertain, tolerance=1.0)
    assert not sure.warnings
