"""A rig that is followed, beside the independent simulator: drifts, faults, and sound running."""

import json

import numpy as np
import pytest

from tests.adapt.rigs import errors, followed, rig_of
from tests.twins import scenarios
from tssgeom.adapt.followed_tendon import FollowedTendon
from tssgeom.adapt.follower import Follower
from tssgeom.adapt.saved import filter_object, filter_of
from tssgeom.mechanism import GivenRoute
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs


@pytest.mark.parametrize("seed", [0, 1])
def test_friction_and_zero_are_followed_within_their_bars(seed):
    scenario = scenarios.drifting(seed, 0.06)
    off, se = errors(scenario, Follower(rig_of(scenario)), 200.0)
    assert np.sqrt(np.mean(off[:, 0] ** 2)) < 0.03 * scenario.machine.friction
    assert np.sqrt(np.mean(off[:, 1] ** 2)) < 0.03
    assert np.mean((off / se) ** 2) < 2.0


def test_wrong_friction_is_right_within_twenty_seconds():
    scenario = scenarios.sound(1, 0.02)
    rig = rig_of(scenario)
    import msgspec

    wrong = msgspec.structs.replace(
        rig, friction=msgspec.structs.replace(rig.friction, coefficient=0.85 * scenario.machine.friction)
    )
    known = [known for _, known in followed(scenario, Follower(wrong), 20.0)]
    assert known[-1].values[0] == pytest.approx(scenario.machine.friction, rel=0.03)


@pytest.mark.parametrize(
    ("kind", "mechanism", "where"),
    [
        ("frayed_tendon", "strain_over_time", "along the tendon"),
        ("wet_sheath", "friction_over_time", "route"),
        ("kinked_sheath", "route_angle", "m from the proximal end"),
        ("unplugged_tension_in_N", "sensor", "tension_in_N"),
        ("unplugged_displacement_in_m", "sensor", "displacement_in_m"),
        ("unplugged_tension_out_N", "sensor", "tension_out_N"),
        ("wrong_shape", "sensed_angle", "shape"),
    ],
)
def test_a_fault_is_detected_in_time_and_named(kind, mechanism, where):
    scenario = scenarios.FAULTS[kind](1, 0.04)
    channels = ("tension_in_N", "displacement_in_m", *([where] if where == "tension_out_N" else []))
    follower, first, acts = Follower(rig_of(scenario)), None, scenarios.acts_s(scenario, channels)
    assert acts is not None
    for i, _ in followed(scenario, follower, acts + 14.0, tension_out=len(channels) > 2):
        if first is None and follower.alert is not None:
            first = float(scenario.times[i])
    assert first is not None
    assert scenario.begins_s is not None
    assert scenario.begins_s <= first < acts + 10.0  # it may show before it acts by five noises
    alert = follower.alert
    assert alert is not None
    assert alert.explanations[0].mechanism == mechanism
    assert where in alert.explanations[0].where
    assert sum(one.probability for one in alert.explanations) == pytest.approx(1.0)


def test_a_kink_is_measured_and_saved_with_the_filter():
    scenario = scenarios.kinked_sheath(0, 0.04)
    follower = Follower(rig_of(scenario))
    for _ in followed(scenario, follower, scenario.begins_s + 14.0):
        pass
    assert follower.alert is not None
    words = follower.alert.explanations[0].sentence
    assert float(words.split()[3]) == pytest.approx(0.8, abs=0.2)
    assert follower.filter is not None
    assert "hidden_bend.angle_rad" in follower.filter.keys
    saved = json.loads(json.dumps(filter_object(follower.saved()), allow_nan=False))
    again = Follower(rig_of(scenario), saved=filter_of(saved, rig_of(scenario))).filter
    assert again is not None
    assert again.keys == follower.filter.keys
    assert (again.members == follower.filter.members).all()


def test_the_rig_goes_on_without_a_sensor_that_is_unplugged():
    scenario = scenarios.unplugged(1, 0.04, "tension_in_N", "zero")
    follower = Follower(rig_of(scenario))
    known = [known for _, known in followed(scenario, follower, scenario.begins_s + 14.0)]
    assert follower.filter is not None
    assert "tension_in_N" in follower.filter.muted
    assert known[-1].values[0] == pytest.approx(scenario.machine.friction, rel=0.05)


def test_an_angle_gain_scales_the_errors_of_the_sensed_angles():
    sensed = Arcs(np.array([0.2, 0.3]), np.array([1.0, 0.5]), np.diag([1e-6, 1e-6, 4e-4, 9e-4]), "spline")
    route = FollowedTendon(Rig(route=GivenRoute(angle_gain=0.5))).felt(sensed)
    assert route.angle == pytest.approx([0.5, 0.25])
    assert np.sqrt(np.diag(route.covariance)) == pytest.approx([1e-3, 1e-3, 0.01, 0.015])


def test_a_sound_machine_raises_no_alarm():
    scenario = scenarios.sound(2, 0.05)
    follower = Follower(rig_of(scenario))
    for _ in followed(scenario, follower, 180.0):
        assert follower.alert is None


def _with_leap(channel: str, size: float, at: int = 4000):
    scenario = scenarios.sound(1, 0.02)
    read = scenario.readings[channel].copy()
    read[at:] += size
    return scenario._replace(readings={**scenario.readings, channel: read})


@pytest.mark.parametrize("channel", ["tension_in_N", "tension_out_N"])
def test_a_zero_that_leaps_is_named_and_followed(channel):
    scenario = _with_leap(channel, 0.8)
    follower = Follower(rig_of(scenario))
    known = [known for _, known in followed(scenario, follower, 55.0, tension_out=True)]
    assert follower.alert is not None
    first = follower.alert.explanations[0]
    assert (first.mechanism, first.where) == ("sensor", channel)
    assert follower.filter is not None
    at = follower.filter.keys.index(channel.removesuffix("_N") + "_offset.offset_N")
    assert known[-1].values[at] == pytest.approx(0.8, abs=0.05)
    assert not follower.filter.muted


@pytest.mark.parametrize(
    ("channel", "size"), [("tension_in_N", 1e12), ("tension_in_N", 60.0), ("displacement_in_m", 0.5)]
)
def test_a_reading_that_makes_no_sense_is_the_sensors_fault_and_is_left_out(channel, size):
    scenario = _with_leap(channel, size)
    follower = Follower(rig_of(scenario))
    known = [known for _, known in followed(scenario, follower, 55.0, tension_out=True)]
    assert follower.alert is not None
    assert (follower.alert.explanations[0].mechanism, follower.alert.explanations[0].where) == (
        "sensor",
        channel,
    )
    assert follower.filter is not None
    assert follower.filter.muted == {channel}
    assert known[-1].values[0] == pytest.approx(scenario.machine.friction, rel=0.05)


def test_a_zero_that_drifts_is_followed_whether_the_rig_names_it_or_not():
    scenario = scenarios.drifting_zeros(2, 0.08)
    follower = Follower(rig_of(scenario))  # its [adapt] names friction and the zero of T_in
    for _ in followed(scenario, follower, 250.0, tension_out=True):
        assert follower.alert is None
    assert follower.filter is not None
    at = follower.filter.keys.index("tension_out_offset.offset_N")
    assert follower.filter.values[at] == pytest.approx(scenario.truth["zero_tension_out_N"][24999], abs=0.03)


@pytest.mark.parametrize("begin", [1733, 2511, 4120])
def test_a_stream_may_begin_with_a_tendon_that_was_pulled_and_released(begin):
    scenario = scenarios.sound(2, 0.02)
    follower, known = Follower(rig_of(scenario)), None
    for _, now in followed(scenario, follower, 10.0, begin=begin):
        assert follower.alert is None
        known = now
    assert known is not None
    off = known.values[0] - scenario.machine.friction
    assert abs(off) < min(4.0 * known.se[0], 0.1 * scenario.machine.friction)  # as if pulled once, a third
