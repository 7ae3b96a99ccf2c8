"""Machines frame by frame: the same as a whole run, over a restart, past bad frames, and to a target."""

import json
from typing import get_args, get_type_hints

import numpy as np
import pytest
from msgspec.structs import replace as changed

from tests.tendon.test_machine import rig
from tssgeom import Engine, Frame, FrameResult, Rejected
from tssgeom.effects import Creep
from tssgeom.errors import SettingsError
from tssgeom.io.formats.columns import MACHINE_CHANNELS
from tssgeom.io.formats.jsonl import frame_of
from tssgeom.io.formats.states import read_state, write_state
from tssgeom.io.results.answers import answer
from tssgeom.mechanism import Drive, End, GivenRoute, all_channels, answering, channels_of
from tssgeom.rig import Friction, Rig, Sensor, Tendon
from tssgeom.sensed_route import fit_frame
from tssgeom.tendon.machine import machine_of, routed
from tssgeom.tendon.machine_command import command_machine
from tssgeom.tendon.machine_simulation import simulate_machine
from tssgeom.tendon.machine_stream import CarriedMachine

TIME = np.linspace(0.0, 12.0, 61)
TURN = np.linspace(0.0, 3.0, 40)
POINTS = 0.5 / 3.0 * np.column_stack((np.sin(TURN), 1.0 - np.cos(TURN), 0.0 * TURN))
ANGLE = 0.8 * np.sin(TIME) * np.cos(0.3 * TIME)
PLAYS = changed(
    rig(),
    drive=Drive(kind="pair", radius_m=0.01, play_rad=0.03, friction_Nm=0.01, torque_constant_Nm_per_A=0.05),
    end=changed(rig().end, play_rad=0.02, friction_Nm=0.002, gravity_Nm=0.02, gravity_at_rad=0.3),
    sensors={"joint_angle_rad": Sensor(lag_s=0.3, zero=0.01, gain=1.1)},
)
SEGMENT = Rig(
    tendon=Tendon(pretension_N=2.0),
    friction=Friction(coefficient=0.1),
    drive=Drive(kind="tendons"),
    end=End(
        kind="segment",
        radius_m=0.004,
        tendon_angles_deg=(0.0, 120.0, 240.0),
        stiffness_Nm_per_rad=0.02,
        length_m=0.06,
    ),
)
PULLED = 1e-3 * np.sin(TIME)
RUNS = {
    "a pair with play, friction and a sensor that lags": (PLAYS, {"motor_angle_rad": ANGLE}),
    "a motor by its torque": (changed(rig(), drive=PLAYS.drive), {"motor_current_A": 2.0 * np.sin(TIME)}),
    "a pair against a load": (
        rig(),
        {"motor_angle_rad": ANGLE, "joint_torque_Nm": 0.02 * np.sin(2.0 * TIME)},
    ),
    "a joint that is moved from outside": (
        changed(rig(), end=changed(rig().end, given="angle", friction_Nm=0.01)),
        {"motor_angle_rad": ANGLE, "joint_angle_rad": 0.5 * np.sin(1.3 * TIME)},
    ),
    "two tendons by their tensions": (
        rig(),
        {"tension_in_1_N": 12.0 + 8.0 * np.sin(TIME), "tension_in_2_N": 12.0 - 8.0 * np.sin(TIME)},
    ),
    "a segment": (SEGMENT, {f"displacement_in_{k + 1}_m": np.roll(PULLED, 9 * k) for k in range(3)}),
    "a band on a frame": (
        changed(rig(), drive=Drive(radius_m=0.01), end=End(kind="carried")),
        {"motor_angle_rad": ANGLE},
    ),
    "tendons that creep": (
        changed(rig(), effects=(Creep(ratio=0.1, time_s=3.0),)),
        {"motor_angle_rad": ANGLE},
    ),
}


def frames(columns, points=POINTS, time=TIME):
    for k, now in enumerate(time):
        readings = {name: float(values[k]) for name, values in columns.items()}
        yield Frame(points, float(now), of_machine=readings)


def carried(hardware, columns, engine=None, **others):
    engine = engine or Engine(hardware, tension_in=15.0)
    results = [engine.push(frame) for frame in frames(columns, **others)]
    assert all(isinstance(each, FrameResult) for each in results), results[0]
    return results


def simulated(hardware, columns, points=POINTS):
    tracked = fit_frame(Frame(points, 0.0), hardware)[1]
    machine = machine_of(hardware, [routed(tracked.fit.arcs, hardware)])
    end_given = hardware.end.given == "angle"
    return simulate_machine(machine, {"time_s": TIME, **columns}, end_given=end_given)


@pytest.mark.parametrize(("hardware", "columns"), RUNS.values(), ids=RUNS)
def test_frame_by_frame_a_machine_does_what_simulate_does(hardware, columns):
    expected = simulated(hardware, columns)
    results = carried(hardware, columns)
    assert results[0].machine.channels.keys() == expected.keys()
    for name, values in expected.items():
        got = [each.machine.channels[name] for each in results]
        # a run's first step lasts as long as its second, a stream's a second: only creep knows the difference
        close = 2e-3 * np.ptp(values) if hardware.effects else 1e-11
        np.testing.assert_allclose(got, values, rtol=0.0, atol=close, err_msg=name)


def test_a_single_tendon_on_a_joint_is_driven_by_the_readings_of_one_tendon():
    hardware = changed(rig(), drive=Drive(radius_m=0.01))
    engine, tension = Engine(hardware, tension_in=15.0), 8.0 + 5.0 * np.sin(TIME)
    results = [engine.push(Frame(POINTS, t, tension_in=pull)) for t, pull in zip(TIME, tension, strict=True)]
    expected = simulated(hardware, {"tension_in_N": tension})
    got = [each.machine.channels["joint_angle_rad"] for each in results]
    np.testing.assert_allclose(got, expected["joint_angle_rad"], atol=1e-12)
    assert results[-1].transmission.tension_out == pytest.approx(expected["tension_out_N"][-1])


def test_the_machine_goes_on_after_a_restart_to_the_last_bit(tmp_path):
    columns = {"motor_angle_rad": ANGLE}
    whole = carried(PLAYS, columns)
    engine = Engine(PLAYS, tension_in=15.0)
    carried(PLAYS, {name: values[:30] for name, values in columns.items()}, engine, time=TIME[:30])
    write_state(tmp_path / "machine.json", engine.state)
    again = Engine(PLAYS, tension_in=15.0, state=read_state(tmp_path / "machine.json"))
    rest = carried(PLAYS, {name: values[30:] for name, values in columns.items()}, again, time=TIME[30:])
    for one, other in zip(whole[30:], rest, strict=True):
        assert one.machine.channels == other.machine.channels


def test_a_machine_at_rest_is_saved_too(tmp_path):
    write_state(tmp_path / "machine.json", CarriedMachine())
    assert read_state(tmp_path / "machine.json") == CarriedMachine()


@pytest.mark.parametrize(
    "damage",
    [
        lambda saved: saved.update(way=3),
        lambda saved: saved["history"].update(drive="a horse"),
        lambda saved: saved["history"]["memory"].pop(),
        lambda saved: saved["history"]["memory"][0].pop(),
        lambda saved: saved["history"].update(held=[[1.0, None], [2.0, 3.0]]),
        lambda saved: saved["history"].update(coordinate=[[0.1]]),
        lambda saved: saved["history"].update(motor=[1.0]),
        lambda saved: saved.pop("route"),
        lambda saved: saved.update(version=4),
    ],
)
def test_a_damaged_state_of_a_machine_is_refused(tmp_path, damage):
    engine, path = Engine(PLAYS, tension_in=15.0), tmp_path / "machine.json"
    carried(PLAYS, {"motor_angle_rad": ANGLE[:3]}, engine, time=TIME[:3])
    write_state(path, engine.state)
    saved = json.loads(path.read_text())
    damage(saved)
    path.write_text(json.dumps(saved))
    with pytest.raises(SettingsError, match=r"machine\.json.*(broken|version)"):
        read_state(path)


BAD = {
    "no drive": ({"joint_torque_Nm": 0.1}, "no motor_angle_rad"),
    "another drive": ({"displacement_in_1_m": 0.0, "displacement_in_2_m": 0.0}, "no motor_angle_rad"),
    "no number": ({"motor_angle_rad": float("nan")}, "motor_angle_rad is nan"),
    "another unit": ({"motor_angle_rad": 1e300}, "check its unit"),
}


@pytest.mark.parametrize(("readings", "reason"), BAD.values(), ids=BAD)
def test_a_bad_frame_leaves_the_machine_as_it_was(readings, reason):
    engine = Engine(PLAYS, tension_in=15.0)
    carried(PLAYS, {"motor_angle_rad": ANGLE[:5]}, engine, time=TIME[:5])
    before = engine.state
    rejected = engine.push(Frame(POINTS, 2.0, of_machine=readings))
    assert isinstance(rejected, Rejected)
    assert reason in rejected.reason
    assert engine.state is before


def test_a_target_brings_the_command_that_compensate_computes():
    hardware = changed(rig(), drive=Drive(kind="pair", radius_m=0.01, play_rad=0.03))
    target, load = 0.4 * np.sin(TIME), 0.01 * np.sin(TIME / 2)
    engine = Engine(hardware, tension_in=15.0)
    columns = {"joint_angle_target_rad": target, "joint_torque_Nm": load}
    results = carried(hardware, columns, engine)
    tracked = fit_frame(Frame(POINTS, 0.0), hardware)[1]
    machine = machine_of(hardware, [routed(tracked.fit.arcs, hardware)])
    expected = command_machine(machine, TIME, {"joint_angle_rad": target}, load)
    got = [each.machine.command.inputs["motor_angle_rad"] for each in results]
    # in a dead zone the search ends within 1e-7 rad of the joint, from slightly different angles
    np.testing.assert_allclose(got, expected.inputs[:, 0], atol=1e-5)
    reached = [each.machine.channels["joint_angle_rad"] for each in results]
    np.testing.assert_allclose(reached, target, atol=1e-6)


def test_where_the_drive_is_measured_the_command_is_its_next_angle():
    hardware = rig()
    engine = Engine(hardware, tension_in=15.0)
    first = engine.push(
        Frame(POINTS, 0.0, of_machine={"motor_angle_rad": 0.1, "joint_angle_target_rad": 0.3})
    )
    assert first.machine.channels["joint_angle_rad"] < 0.2
    there = engine.push(
        Frame(POINTS, 1.0, of_machine={"motor_angle_rad": first.machine.command.inputs["motor_angle_rad"]})
    )
    assert there.machine.channels["joint_angle_rad"] == pytest.approx(0.3, abs=1e-6)


def test_a_target_out_of_reach_says_what_is_reached():
    one = changed(rig(1.0, 0.0), drive=Drive(kind="tendon", radius_m=0.01))
    result = Engine(one, tension_in=15.0).push(
        Frame(POINTS, 0.0, of_machine={"joint_angle_target_rad": -0.5})
    )
    assert not result.machine.command.reached
    assert result.machine.numbers["joint_angle_reached_rad"] == pytest.approx(-0.05, rel=1e-6)


def test_frames_without_a_drive_pull_every_tendon_with_the_tension_of_the_option():
    result = Engine(rig(), tension_in=20.0).push(Frame(POINTS))
    assert result.machine.channels["tension_in_2_N"] == pytest.approx(20.0)
    assert result.machine.channels["joint_angle_rad"] == pytest.approx(0.0, abs=1e-9)


def test_a_route_that_moves_takes_the_tensions_with_it_and_one_that_trembles_does_not():
    hardware, engine = rig(), Engine(rig(), tension_in=15.0)
    held = {"motor_angle_rad": np.full(1, 0.5)}
    before = carried(hardware, held, engine, time=[0.0])[0]
    noisy = POINTS + 2e-5 * np.random.default_rng(0).standard_normal(POINTS.shape)
    trembling = carried(hardware, held, engine, points=noisy, time=[1.0])[0]
    for name, value in before.machine.channels.items():
        assert trembling.machine.channels[name] == pytest.approx(value, rel=1e-9, abs=1e-12), name
    straight = np.column_stack((np.linspace(0.0, 0.5, 40), np.zeros((40, 2))))
    moved = carried(hardware, held, engine, points=straight, time=[2.0])[0].machine.channels
    # a straight sheath holds nothing back: the joint turns on, and each tendon has one tension
    assert moved["joint_angle_rad"] > before.machine.channels["joint_angle_rad"]
    assert moved["tension_out_1_N"] == pytest.approx(moved["tension_in_1_N"], rel=1e-6)


def test_standard_errors_of_a_first_tendon_come_from_its_route():
    noisy = POINTS + 2e-3 * np.random.default_rng(0).standard_normal(POINTS.shape)
    result = carried(rig(), {"motor_angle_rad": np.full(1, 1.0)}, points=noisy, time=[0.0])[0]
    ends, se = result.transmission, result.arcs.total_angle_se
    assert ends.tension_out_se == pytest.approx(0.145 * se * ends.tension_out, rel=0.05)
    given = changed(rig(), route=GivenRoute(angle_rad=3.0))
    result = carried(given, {"motor_angle_rad": np.full(1, 1.0)}, points=noisy, time=[0.0])[0]
    assert result.transmission.tension_out_se == 0.0


def test_a_line_of_json_brings_the_readings_and_its_answer_the_channels():
    line = {
        "t": 0.0,
        "unit": "m",
        "points": POINTS.tolist(),
        "motor_angle_deg": 30.0,
        "joint_torque_mNm": 5.0,
        "joint_angle_target_deg": 10.0,
    }
    frame = frame_of(json.dumps(line).encode(), None)
    assert frame.of_machine == {
        "joint_angle_target_rad": pytest.approx(np.radians(10.0)),
        "joint_torque_Nm": pytest.approx(0.005),
        "motor_angle_rad": pytest.approx(np.radians(30.0)),
    }
    result = Engine(rig(), tension_in=15.0).push(frame)
    said = json.loads(answer(result, 0.0, 0, 1.0, 0))
    assert {"tension_out_1_N", "tension_out_2_N", "joint_angle_rad", "motor_angle_command_rad"} <= said.keys()
    assert {"length_m", "tension_in_N", "tension_out_N", "elongation_m", "direction_index"} <= said.keys()
    assert said["tension_out_N"] == said["tension_out_1_N"]


def test_readings_that_no_rig_has_are_named():
    one = Engine(Rig(), tension_in=15.0)
    result = one.push(Frame(POINTS, 0.0, tension_in=10.0, of_machine={"joint_angle_rad": 0.1}))
    assert any("joint_angle_rad: not read" in each for each in result.warnings)
    rejected = one.push(Frame(POINTS, 1.0, of_machine={"motor_angle_rad": 0.1}))
    assert "motor_angle_rad is of a machine" in rejected.reason
    pair = Engine(rig(), tension_in=15.0)
    result = pair.push(Frame(POINTS, 0.0, of_machine={"motor_angle_rad": 0.1, "bending_x_rad": 0.0}))
    assert any("bending_x_rad is not used" in each for each in result.warnings)
    result = pair.push(Frame(POINTS, 0.5, of_machine={"motor_angle_rad": 0.1, "motor_current_A": 0.2}))
    assert any("give drive.torque_constant_Nm_per_A" in each for each in result.warnings)
    rejected = pair.push(Frame(POINTS, 1.0, displacement_target=0.001))
    assert "joint_angle_target_rad" in rejected.reason


def test_under_an_angle_gain_of_the_rig_the_elongation_has_the_error_of_the_sensed_route():
    noisy = POINTS + np.random.default_rng(3).normal(0.0, 2e-4, POINTS.shape)
    errors = []
    for gain in (1.0, 1.1):
        hardware = changed(PLAYS, route=GivenRoute(angle_gain=gain))
        last = carried(hardware, {"motor_angle_rad": ANGLE[:20]}, points=noisy, time=TIME[:20])[-1]
        errors.append(last.transmission.elongation_se)
    assert 0.9 * errors[0] < errors[1] < 1.1 * errors[0]


def test_a_length_and_an_angle_of_the_rig_have_no_error():
    hardware = changed(PLAYS, route=GivenRoute(length_m=0.3, angle_rad=3.0))
    noisy = POINTS + np.random.default_rng(3).normal(0.0, 2e-4, POINTS.shape)
    last = carried(hardware, {"motor_angle_rad": ANGLE[:5]}, points=noisy, time=TIME[:5])[-1]
    assert last.transmission.elongation_se == 0.0


def test_a_joint_has_channels_of_its_angle_and_a_segment_of_its_bending():
    joint, segment = (channels_of(each.drive, each.end) for each in (rig(30.0, 0.1), SEGMENT))
    assert not {*joint} & {"bending_x_rad", "tip_x_m"}
    assert {"bending_x_rad", "tip_x_m"} <= {*segment}
    assert not {*segment} & {"joint_angle_rad", "joint_torque_Nm"}


@pytest.mark.parametrize("kind", get_args(get_type_hints(End)["kind"]))
def test_a_file_can_hold_what_a_machine_computes_and_answers_in(kind):
    end = End(kind=kind, radius_m=0.01, tendon_angles_deg=(0.0, 180.0))
    many = kind == "segment"
    drive = Drive(kind="tendons" if many else "tendon", radius_m=0.0 if many else 0.01)
    computed, answers = {*channels_of(drive, end)}, {*answering(drive, end)}
    assert computed <= {*all_channels(2 if many else 1)}
    assert {*all_channels(2)} <= MACHINE_CHANNELS.keys()
    assert answers <= computed | {"elongation_m"}
