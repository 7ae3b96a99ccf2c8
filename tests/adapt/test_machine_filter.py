"""Machines that are followed, beside the independent simulator."""

import json
from itertools import islice

import msgspec
import numpy as np
import pytest

from tests.adapt.machine_cases import arcs_of, rig_of
from tests.twins import route_points
from tests.twins.mechanisms import SCENARIOS, pair
from tssgeom import Engine, Frame, FrameResult, SettingsError
from tssgeom.adapt.follower import Follower
from tssgeom.adapt.machine_filter import MachineFilter
from tssgeom.adapt.machine_readings import MachineReadings
from tssgeom.adapt.saved import filter_object, filter_of
from tssgeom.tendon.machine import machine_of
from tssgeom.tendon.machine_simulation import simulate_machine
from tssgeom.uncertain import Follow

BEGIN_S = 15.0


def readings(scenario, i):
    """Return what a machine read in a sample."""
    return MachineReadings({name: float(values[i]) for name, values in scenario.readings.items()})


def followed(scenario, follower, begin=0):
    """Yield what is known after each sample of a scenario, from one on."""
    arcs = arcs_of(scenario.machine)
    for i in range(begin, len(scenario.times)):
        known = follower.take(arcs, readings(scenario, i), float(scenario.times[i]))
        follower.work()
        yield known


@pytest.mark.parametrize(("kind", "seconds"), [("pair", 90.0), ("joint", 90.0), ("segment", 40.0)])
def test_drifting_friction_of_a_machine_is_followed_within_its_bars(kind, seconds):
    scenario = SCENARIOS[kind](1, seconds)
    follower = Follower(rig_of(scenario.machine))
    known = list(followed(scenario, follower))
    late = scenario.times > BEGIN_S
    off = np.array([one.values[0] for one in known])[late] - scenario.truth["friction"][late]
    se = np.array([one.se[0] for one in known])[late]
    assert np.sqrt(np.mean(off**2)) < 0.02 * scenario.machine.friction
    assert np.mean((off / se) ** 2) < 2.0
    assert follower.alert is None


def test_a_stream_may_begin_with_a_machine_that_was_moved_before():
    scenario = pair(2, 13.0)
    *_, known = islice(followed(scenario, Follower(rig_of(scenario.machine)), begin=500), 101)  # 2 s
    friction = scenario.machine.friction
    assert known.values[0] == pytest.approx(friction, rel=0.05)  # as if pulled once, it is 46 % less


def test_members_are_the_machine_without_noise():
    scenario = pair(2, 20.0, changes=())
    rig = msgspec.structs.replace(
        rig_of(scenario.machine), adapt={"friction.coefficient": Follow(sd=1e-9)}, sensors={}
    )
    run = {"time_s": scenario.times, "motor_angle_rad": np.array(scenario.truth["motor_angle_rad"])}
    expected = simulate_machine(machine_of(rig, [arcs_of(scenario.machine)]), run)
    follower = Follower(rig)
    assert isinstance(follower.begin(arcs_of(scenario.machine), readings(scenario, 0)), MachineFilter)
    for i, time in enumerate(scenario.times):
        values = MachineReadings({"motor_angle_rad": float(run["motor_angle_rad"][i])}, commanded=True)
        known = follower.take(arcs_of(scenario.machine), values, float(time))
        for name, value in known.read.items():
            if name != "motor_torque_Nm" or i > 0:
                assert value[0] == pytest.approx(expected[name][i], abs=1e-6), (name, i)


def test_a_zero_and_a_gain_of_a_sensor_are_followed_and_go_into_the_rig():
    scenario = pair(1, 60.0, changes=(), zeros={"joint_angle_rad": 0.01})
    rig = rig_of(scenario.machine)
    adapt = {**rig.adapt, "sensors.joint_angle_rad.zero": Follow(sd=0.02)}
    follower = Follower(msgspec.structs.replace(rig, adapt=adapt))
    known = list(followed(scenario, follower))[-1]
    at = known.keys.index("sensors.joint_angle_rad.zero")
    assert known.values[at] == pytest.approx(0.01, abs=1e-3)
    assert abs(known.values[at] - 0.01) < 3.0 * known.se[at]
    sensor = follower.rig.sensors["joint_angle_rad"]
    assert (sensor.zero, sensor.noise) == (
        pytest.approx(known.values[at]),
        rig.sensors["joint_angle_rad"].noise,
    )


def frames(scenario):
    """Yield a scenario as frames."""
    points = route_points(scenario.machine.lengths_m, scenario.machine.angles_rad, 60)
    for i, time in enumerate(scenario.times):
        yield Frame(points, time=float(time), of_machine=dict(readings(scenario, i).values))


def test_a_command_comes_from_the_followed_machine_with_its_error():
    scenario = pair(1, 12.0)
    rig = rig_of(scenario.machine)
    engine = Engine(rig, tension_in=5.0, follower=Follower(rig))
    for frame in frames(scenario):
        asked = Frame(
            frame.points, frame.time, of_machine={**frame.of_machine, "joint_angle_target_rad": 0.2}
        )
        result = engine.push(asked if frame.time > 10.0 else frame)
        assert isinstance(result, FrameResult), result
    assert result.followed is not None
    assert result.machine is not None
    command = result.machine.command
    assert command is not None
    assert command.outputs["joint_angle_rad"] == pytest.approx(0.2, abs=1e-6)
    assert 1e-5 < command.errors["joint_angle_rad"] < 5e-3


def test_a_machine_without_a_measured_drive_goes_where_it_is_commanded():
    scenario = pair(1, 1.0)
    rig = rig_of(scenario.machine)
    engine, points = Engine(rig, tension_in=5.0, follower=Follower(rig)), next(frames(scenario)).points
    for i, target in enumerate((0.1, 0.3, 0.2)):
        result = engine.push(Frame(points, 0.1 * i, of_machine={"joint_angle_target_rad": target}))
        assert isinstance(result, FrameResult), result
        assert result.machine is not None
        assert result.machine.channels["joint_angle_rad"] == pytest.approx(target, abs=5e-3)


@pytest.mark.parametrize("kind", ["pair", "segment"])
def test_a_saved_filter_of_a_machine_goes_on_with_the_same_digits(kind):
    scenario = SCENARIOS[kind](1, 6.0)
    rig, arcs = rig_of(scenario.machine), arcs_of(scenario.machine)
    kept, stopped, is_saved = Follower(rig), Follower(rig), False
    for i, time in enumerate(scenario.times):
        if i >= 150 and not is_saved and (kind == "pair" or has_path(stopped)):
            is_saved = True
            saved = json.loads(json.dumps(filter_object(stopped.saved()), allow_nan=False))
            stopped = Follower(rig, saved=filter_of(saved, rig))
        one, other = (
            each.take(each.carried.lies_on(arcs), readings(scenario, i), float(time))
            for each in (kept, stopped)
        )
        assert one.values.tolist() == other.values.tolist()
        assert one.read == other.read
    assert is_saved


def has_path(follower):
    """Whether one of the drives may have turned, and the members of its filter may go again."""
    saved = follower.saved()
    return saved.path is not None and len(saved.path.steps) > 0


def test_a_broken_path_of_drives_is_refused():
    scenario = SCENARIOS["segment"](1, 6.0)
    rig = rig_of(scenario.machine)
    follower = Follower(rig)
    assert any(has_path(follower) for _ in followed(scenario, follower))
    saved = json.loads(json.dumps(filter_object(follower.saved())))
    path = saved["path"]
    for key in ("committed", "values", "turns", "steps"):
        with pytest.raises(SettingsError, match="is broken"):
            filter_of(saved | {"path": {**path, key: saved["members"]}}, rig)


def test_a_broken_filter_of_a_machine_is_refused():
    scenario = pair(1, 1.0)
    rig = rig_of(scenario.machine)
    follower = Follower(rig)
    list(followed(scenario, follower))
    saved = json.loads(json.dumps(filter_object(follower.saved())))
    for key, value in (
        ("members", saved["about"]),
        ("kept", {}),
        ("now", {**saved["now"], "memory": saved["now"]["coordinate"]}),
        ("drive", "a horse"),
        ("drives", {}),
        ("random", ["0", "zz"]),
        ("time", 1e300),
    ):
        with pytest.raises(SettingsError, match="is broken"):
            filter_of(saved | {key: value}, rig)
    with pytest.raises(SettingsError, match="the saved filter follows"):
        filter_of(saved | {"keys": ["end.play_rad"]}, rig)


def test_a_drive_that_is_missing_later_is_named():
    scenario = pair(1, 1.0)
    rig, arcs = rig_of(scenario.machine), arcs_of(scenario.machine)
    follower = Follower(rig)
    follower.take(arcs, readings(scenario, 0), 0.0)
    with pytest.raises(SettingsError, match="no motor_angle_rad, which drove before"):
        follower.take(arcs, MachineReadings({"joint_angle_rad": 0.1}), 0.1)


@pytest.mark.parametrize(
    "key", ["sensors.joint_angle_rad.noise", "end.length_m", "tension_in_gain.gain_error"]
)
def test_what_cannot_be_followed_of_a_machine_is_refused(key):
    scenario = pair(1, 1.0)
    rig = msgspec.structs.replace(rig_of(scenario.machine), adapt={key: Follow(sd=0.1)})
    with pytest.raises(SettingsError, match=rf"adapt\.{key}"):
        Follower(rig).begin(arcs_of(scenario.machine), readings(scenario, 0))
