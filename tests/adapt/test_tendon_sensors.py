"""Sensors of one tendon that lag, and play of its load, in a rig that is followed."""

import json

import msgspec
import numpy as np
import pytest

from tests.adapt.test_rig_filter import ARCS, RIG, number
from tssgeom.adapt.follower import Follower
from tssgeom.adapt.readings import Moment, Readings
from tssgeom.adapt.rig_filter import RigFilter
from tssgeom.adapt.saved import filter_object, filter_of
from tssgeom.effects import Backlash, ChannelLag, LoadFriction, LoadPlay, SensorLaw
from tssgeom.errors import SettingsError
from tssgeom.rig import Sensor
from tssgeom.tendon.bars.model import predict
from tssgeom.uncertain import Follow

LAG, WIDTH = 0.4, 3e-4  # s, m
LATE = msgspec.structs.replace(RIG, effects=(ChannelLag(lag_s=LAG), LoadPlay(width_m=WIDTH)))
TIME = np.linspace(0.0, 29.95, 600, dtype=np.float64)
MOTION = 0.003 * (1.0 - np.cos(TIME * (1.0 + 0.3 * np.sin(TIME / 7.0))))


def measured(rig, friction=0.145):
    true = msgspec.structs.replace(rig, friction=msgspec.structs.replace(rig.friction, coefficient=friction))
    return predict({"time_s": TIME, "displacement_in_m": MOTION}, ARCS, true)


def moments(known, noise=0.0):
    rng = np.random.default_rng(5)
    for i, time in enumerate(TIME):
        tension = known["tension_out_N"][i] + noise * rng.standard_normal()
        readings = Readings(None, float(MOTION[i]), float(tension), float(known["elongation_m"][i]))
        yield Moment(float(time), ARCS, readings)


INSIDE = (ChannelLag(lag_s=LAG), LoadPlay(width_m=WIDTH, open_m=1e-4), Backlash(width_m=WIDTH, open_m=2e-4))


@pytest.mark.parametrize("effects", [LATE.effects, (*INSIDE, LoadFriction(force_N=0.3))])
def test_members_read_what_lagging_sensors_and_a_load_with_play_do(effects):
    late = msgspec.structs.replace(LATE, effects=effects)
    one = RigFilter(
        msgspec.structs.replace(late, sensors={}), [number("friction.coefficient", 0.145, 1e-12)], ARCS
    )
    known = measured(late)
    assert np.abs(known["tension_out_N"] - measured(RIG)["tension_out_N"]).max() > 0.3
    assert np.abs(known["elongation_m"] - measured(RIG)["elongation_m"]).max() > 0.9 * WIDTH
    for moment in moments(known):
        off = one.step(moment).off
        np.testing.assert_allclose(off[1], 0.0, atol=1e-5)
        np.testing.assert_allclose(off[2], 0.0, atol=1e-9)


def followed(rig, seed=0):
    sensors = {"tension_out_N": Sensor(noise=0.03), "displacement_in_m": Sensor(noise=1e-6)}
    adapt = {"friction.coefficient": Follow(sd=0.03)}
    return Follower(msgspec.structs.replace(rig, sensors=sensors, adapt=adapt), seed=seed)


def test_friction_is_followed_beside_a_cell_that_lags():
    known = measured(msgspec.structs.replace(LATE, effects=LATE.effects[:1]), friction=0.17)
    errors = list[tuple[float, float]]()
    for rig in (msgspec.structs.replace(LATE, effects=LATE.effects[:1]), RIG):
        follower = followed(rig)
        every = [moment.readings._replace(elongation=None) for moment in moments(known, noise=0.03)]
        known_after = [follower.take(ARCS, each, float(t)) for t, each in zip(TIME, every, strict=True)]
        last = known_after[-1]
        errors.append((abs(last.values[0] - 0.17), last.se[0]))
    assert errors[0][0] < 3.0 * errors[0][1] < 0.01
    assert errors[1][0] > 0.05  # without the lag


def test_a_filter_with_late_sensors_goes_on_after_a_restart_as_if_there_had_been_none():
    follower = followed(LATE)
    every = [moment.readings for moment in moments(measured(LATE), noise=0.03)]
    for time, readings in zip(TIME[:300], every, strict=False):
        follower.take(ARCS, readings, float(time))
    saved = follower.saved()
    assert saved is not None
    text = json.dumps(filter_object(saved))
    again = Follower(follower._first, saved=filter_of(json.loads(text), follower._first))
    for time, readings in zip(TIME[300:320], every[300:], strict=False):
        one, other = (each.take(ARCS, readings, float(time)) for each in (follower, again))
        np.testing.assert_allclose(one.values, other.values, atol=1e-9)  # rounding


def test_what_is_not_followed_is_refused():
    late_drive = msgspec.structs.replace(RIG, effects=(ChannelLag(lag_s=0.1, channel="displacement_in_m"),))
    one = RigFilter(late_drive, [number("friction.coefficient", 0.145, 0.01)], ARCS)
    with pytest.raises(SettingsError, match="is the drive"):
        one.step(Moment(0.0, ARCS, Readings(displacement_in=0.001)))
    late = msgspec.structs.replace(RIG, effects=(ChannelLag(lag_s=0.08, channel="distal"),))
    with pytest.raises(SettingsError, match=r"late distal recorder is not followed: take 0\.08 s off"):
        RigFilter(late, one.numbers, ARCS)
    law = SensorLaw(channel="tension_out_N", over="reading", x=(0.0, 10.0, 20.0), error=(0.0, 0.1, 0.4))
    with pytest.raises(SettingsError, match=r"tension_out_N over reading is not followed"):
        RigFilter(msgspec.structs.replace(RIG, effects=(law,)), one.numbers, ARCS)
