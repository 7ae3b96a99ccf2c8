"""Frames without a shape: the route is that of the rig, and its angle is followed from the readings."""

import json
import math

import numpy as np
import pytest

from tests import lumped
from tests.tendon.test_machine import rig
from tssgeom import Engine, FrameResult, Rejected
from tssgeom.adapt.follower import Follower
from tssgeom.io.formats.jsonl import frame_or_refusal
from tssgeom.mechanism import GivenRoute
from tssgeom.rig import Friction, Rig, Sensor, Tendon
from tssgeom.uncertain import Follow

TIME = np.linspace(0.0, 20.0, 401)
NOISE = {"tension_in_N": 0.02, "tension_out_N": 0.02}


def line(**keys):
    return frame_or_refusal(json.dumps({name: float(value) for name, value in keys.items()}).encode(), None)


def result_of(engine, **keys) -> FrameResult:
    result = engine.push(line(**keys))
    assert isinstance(result, FrameResult)
    return result


@pytest.mark.parametrize(
    ("length", "angle", "bends"), [(0.5, 2.5, ()), (1.2, 14.0, ()), (0.8, 3.0, (1.0, 0.0, 3.0))]
)
def test_a_frame_without_points_has_the_route_of_the_rig(length, angle, bends):
    given = GivenRoute(length_m=length, angle_rad=angle, bends=bends)
    engine = Engine(Rig(route=given), tension_in=15.0)
    for t in range(3):
        result = result_of(engine, t=t, tension_in_N=15.0)
        assert not any("repeat" in each for each in result.warnings)
        assert result.fit.arcs.total_length == pytest.approx(length, rel=1e-3)
        assert result.fit.arcs.total_angle == pytest.approx(angle, rel=2e-3)


def test_a_machine_needs_no_points_either():
    engine = Engine(rig(route=GivenRoute(length_m=0.5, angle_rad=2.0)), tension_in=5.0)
    machine = result_of(engine, t=0.0, motor_angle_rad=0.3).machine
    assert machine is not None
    assert machine.channels["joint_angle_rad"] > 0.0


def test_a_rig_that_states_no_route_rejects_such_frames():
    rejected = Engine(Rig(), tension_in=15.0).push(line(t=0.0, tension_in_N=15.0))
    assert isinstance(rejected, Rejected)
    assert "[route] length_m" in rejected.reason


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_angle_of_a_route_that_nobody_senses_is_followed(seed):
    rng = np.random.default_rng(seed)
    angle, friction = rng.uniform(2.0, 4.0), 0.13
    path = lumped.from_pieces([0.5], [angle], cells=120)
    physics = lumped.Physics(friction=friction, compliance_per_N=4e-4, pretension_N=5.0)
    drive = lumped.Drive("force", TIME, 9.0 - 4.0 * np.cos(2.0 * math.pi * TIME / 5.0))
    run = lumped.simulate(path, physics, drive, lumped.Distal("spring", 900.0), TIME, 0.05)
    read = lumped.measure(run, {name: lumped.Sensor(noise=noise) for name, noise in NOISE.items()}, seed)
    known = Rig(
        tendon=Tendon(pretension_N=5.0, compliance_per_N=4e-4),
        friction=Friction(coefficient=friction),
        route=GivenRoute(length_m=0.5, angle_rad=3.0),
        sensors={name: Sensor(noise=noise) for name, noise in NOISE.items()},
        adapt={"route.angle_gain": Follow(sd=0.3)},
    )
    engine = Engine(known, tension_in=5.0, follower=Follower(known))
    read["t"] = TIME
    every = [result_of(engine, **{name: read[name][k] for name in ("t", *NOISE)}) for k in range(len(TIME))]
    followed = every[-1].followed
    assert followed is not None
    at = followed.keys.index("route.angle_gain")
    gain, error = followed.values[at], followed.se[at]
    assert abs(3.0 * gain - angle) < 3.0 * 3.0 * error + 0.01 * angle
    assert error < 0.02


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b'{"t": 1.0, "points": null}', "got `null` - at `$.points`"),
        (b'{"points": []}', "the line has no time"),
        (b"{}", "the line has no time"),
    ],
)
def test_a_line_of_a_stream_may_lack_its_points_but_not_its_time(text, reason):
    refused = frame_or_refusal(text, None)
    assert isinstance(refused, Rejected)
    assert reason in refused.reason
