"""A follower in the engine, and its filter from file to file."""

import json
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np
import pytest

from tests.twins import Machine, Scenario, drifting_friction, frames
from tssgeom import Engine, Frame, FrameResult, Rejected, Rig, SettingsError
from tssgeom.adapt.follower import Follower
from tssgeom.adapt.saved import filter_object, filter_of
from tssgeom.io.results import answers
from tssgeom.rig import Friction, Load, Sensor, Tendon
from tssgeom.route.pieces import Arcs


def rig_of(given: Machine, *, noise: bool = True) -> Rig:
    return Rig(
        tendon=Tendon(compliance_per_N=given.compliance_per_N, pretension_N=given.pretension_N),
        friction=Friction(coefficient=given.friction),
        load=Load(stiffness_N_per_m=given.stiffness_N_per_m),
        sensors={name: Sensor(noise=sd) for name, sd in given.noise.items()} if noise else {},
    )


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return drifting_friction(2, 0.05)


def sensed(scenario: Scenario, count: int, every: int = 4) -> Iterator[Frame]:
    return islice(frames(scenario, every=every, noise_m=2e-4), count)


def test_drifting_friction_is_followed_within_its_bars(scenario):
    rig = rig_of(scenario.machine)
    # the rig's file is a tenth off
    wrong = Rig(
        tendon=rig.tendon, friction=Friction(coefficient=1.1 * rig.friction.coefficient), load=rig.load,
        sensors=rig.sensors,
    )  # fmt: skip
    engine = Engine(wrong, tension_in=5.0, follower=Follower(wrong))
    errors, bars = [], []
    for i, frame in enumerate(sensed(scenario, 3000)):
        result = engine.push(frame)
        engine.idle()
        assert isinstance(result, FrameResult)
        assert result.followed is not None
        assert result.followed.keys == ("friction.coefficient", "tension_in_offset.offset_N")
        ends, at = result.transmission, 4 * i
        truth = scenario.truth
        wanted = truth["friction"][at], truth["tension_out_N"][at]
        errors.append(np.subtract((result.followed.values[0], ends.tension_out), wanted))
        bars.append((result.followed.se[0], ends.tension_out_se))
    late, bar = np.array(errors)[500:], np.array(bars)[500:]
    assert np.abs(late[:, 0]).max() < 0.03 * scenario.machine.friction
    assert np.sqrt(np.mean(late[:, 1] ** 2)) < 0.05  # N, of some 10
    assert (np.abs(late[:, 0]) < 1.96 * bar[:, 0]).mean() > 0.9
    assert result.alert is None


@pytest.mark.parametrize("idle", [False, True])
def test_an_alert_is_explained_whether_or_not_the_engine_idles_and_no_more_readings_are_kept(scenario, idle):
    follower = Follower(rig_of(scenario.machine))
    engine, kept = Engine(follower.rig, tension_in=5.0, follower=follower), list[int]()
    for i, frame in enumerate(sensed(scenario, 2000)):
        assert frame.tension_in is not None
        engine.push(replace(frame, tension_in=frame.tension_in + (1.0 if i > 400 else 0.0)))
        kept.append(len(follower._moments))
        if idle:
            engine.idle()
    assert follower.alert is not None
    assert follower.alert.explanations
    assert kept[-1] < 800  # 15 s at 25 Hz, and those of the last comparison


def test_commands_come_from_the_followed_tendon_and_know_the_filters_spread(scenario):
    rig = rig_of(scenario.machine)
    follower = Follower(rig)
    engine, plain = Engine(rig, tension_in=5.0, follower=follower), Engine(rig, tension_in=5.0)
    result = alone = None
    for frame in sensed(scenario, 400):
        asked = replace(frame, displacement_target=1e-3)
        result, alone = engine.push(asked), plain.push(asked)
    assert isinstance(result, FrameResult)
    assert isinstance(alone, FrameResult)
    assert result.command is not None
    assert alone.command is not None
    assert result.command.displacement_reached == pytest.approx(1e-3, rel=1e-6)
    assert result.command.tension_out_se > alone.command.tension_out_se
    assert follower.filter is not None
    before = follower.filter.members.copy(), follower.filter.time
    refused = engine.push(replace(asked, time=asked.time + 0.1, displacement_target=-1e3))
    assert isinstance(refused, Rejected)
    assert (follower.filter.members == before[0]).all()
    assert follower.filter.time == before[1]
    assert engine.state is result.state


def test_a_command_without_a_measured_drive_counts_as_carried_out(scenario):
    rig, points = rig_of(scenario.machine), next(sensed(scenario, 1)).points
    engine = Engine(rig, tension_in=5.0, follower=Follower(rig))
    for i, target in enumerate((1e-3, 2e-3, 1.5e-3)):
        result = engine.push(Frame(points, time=0.1 * i, displacement_target=target))
        assert isinstance(result, FrameResult)
        assert result.transmission.displacement_out == pytest.approx(target, rel=0.02)
        assert result.transmission.displacement_in == pytest.approx(result.displacement_command)


def test_answers_carry_what_is_followed_and_noise_that_is_not_stated_is_said(scenario):
    rig = rig_of(scenario.machine, noise=False)
    engine = Engine(rig, tension_in=5.0, follower=Follower(rig))
    for frame in sensed(scenario, 3):
        result = engine.push(frame)
    assert isinstance(result, FrameResult)
    answer = json.loads(answers.answer(result, 7.0, 2, 1.0, 0))
    value, error = answer["followed"]["friction.coefficient"]
    assert value == pytest.approx(rig.friction.coefficient, rel=0.05)
    assert 0.0 < error < 0.2 * value
    assert "alert" not in answer
    assert "sensors.tension_in_N.noise is not stated: 0.05 N is assumed" in answer["warnings"]
    assert any("displacement_in_m.noise" in text for text in answer["warnings"])
    assert not any("tension_out" in text for text in answer["warnings"])


def test_time_that_does_not_increase_is_refused(scenario):
    rig, frame = rig_of(scenario.machine), next(sensed(scenario, 1))
    engine = Engine(rig, tension_in=5.0, follower=Follower(rig))
    engine.push(frame)
    refused = engine.push(frame)
    assert isinstance(refused, Rejected)
    assert "increasing times" in refused.reason


def _through_json(follower: Follower, rig: Rig) -> Follower:
    saved = follower.saved()
    assert saved is not None
    return Follower(rig, saved=filter_of(json.loads(json.dumps(filter_object(saved))), rig))


def test_a_filter_that_was_saved_goes_on_with_the_same_digits(scenario):
    rig, route = rig_of(scenario.machine), _route(scenario)
    kept, stopped = Follower(rig), Follower(rig)
    for i in range(600):
        if i == 300:
            stopped = _through_json(stopped, rig)
        readings = _readings(scenario, 4 * i)
        one, other = (each.take(each.carried.lies_on(route), readings, 0.04 * i) for each in (kept, stopped))
        assert one.values.tolist() == other.values.tolist()
        assert one.ends.tolist() == other.ends.tolist()


def test_an_alert_outlives_a_restart_with_the_mechanism_that_was_named(scenario):
    """T_in is unplugged: the zero that its cell has lost is named, and its readings stay unused."""
    rig, route = rig_of(scenario.machine), _route(scenario)
    follower = Follower(rig)

    def take(one: Follower, at: int) -> None:
        readings = _readings(scenario, 4 * at)._replace(tension_in=0.0)
        one.take(one.carried.lies_on(route), readings if at > 500 else _readings(scenario, 4 * at), 0.04 * at)
        for _ in range(13):
            one.work()

    for at in range(900):
        take(follower, at)
    alert = follower.alert
    assert alert is not None
    assert (alert.channel, alert.mechanism) == ("tension_in_N", "sensor")
    again = _through_json(follower, rig)
    assert again.alert == alert
    take(again, 900)
    assert again.alert == alert


def _route(scenario: Scenario) -> Arcs:
    return Arcs.exact(scenario.machine.lengths_m, scenario.machine.angles_rad)


def _readings(scenario: Scenario, at: int) -> Any:
    from tssgeom.adapt.readings import Readings

    read = scenario.readings
    return Readings(float(read["tension_in_N"][at]), float(read["displacement_in_m"][at]))


def test_a_broken_filter_or_one_of_other_numbers_is_refused(scenario):
    rig = rig_of(scenario.machine)
    follower = Follower(rig)
    engine = Engine(rig, tension_in=5.0, follower=follower)
    for frame in sensed(scenario, 5):
        engine.push(frame)
    saved = follower.saved()
    assert saved is not None
    plain = json.loads(json.dumps(filter_object(saved)))
    for key, value in (
        ("members", plain["now"]["memory"]),
        ("now", {**plain["now"], "memory": plain["members"]}),
        ("random", ["0", "zz"]),
        ("muted", ["load"]),
        ("time", 1e300),
        ("drives", {}),
        ("alert", {"channel": "a horse", "since": 1.0, "phase": "hold"}),
        ("committed", {"shape": [2], "float64": "AAAAAAAA+H8AAAAAAAD4fw=="}),
    ):
        with pytest.raises(SettingsError, match="is broken"):
            filter_of(plain | {key: value}, rig)
    with pytest.raises(SettingsError, match="version 7"):
        filter_of(plain | {"version": 7}, rig)
    with pytest.raises(SettingsError, match="the saved filter follows"):
        filter_of(plain | {"keys": ["tendon.compliance_per_N"]}, rig)


def test_a_position_that_cannot_be_leaves_the_filter_as_it_was(scenario):
    rig = rig_of(scenario.machine)
    spoilt, sound = (Engine(rig, tension_in=5.0, follower=Follower(rig)) for _ in range(2))
    given = list(sensed(scenario, 12))
    for frame in given[:11]:
        first, second = spoilt.push(frame), sound.push(frame)
    length = second.fit.arcs.total_length if isinstance(second, FrameResult) else 0.0
    bad = spoilt.push(
        replace(given[11], tension_in=None, displacement_in=1.9 * length, time=given[11].time - 1e-3)
    )
    assert isinstance(bad, Rejected)
    assert bad.reason.endswith("[strain]")
    first, second = spoilt.push(given[11]), sound.push(given[11])
    assert isinstance(first, FrameResult)
    assert isinstance(second, FrameResult)
    assert first.followed is not None
    assert second.followed is not None
    assert first.followed.values.tolist() == second.followed.values.tolist()
