"""A rig that gives the angle of its sheaths and not where they bend: runs of the lumped machine."""

from dataclasses import replace as changed

import numpy as np
import pytest
from msgspec.structs import replace

pytest.importorskip("tests.lumped")
from tests import lumped
from tssgeom.errors import SettingsError
from tssgeom.identify.machine_calibration import calibrate_machine
from tssgeom.identify.machine_parameters import with_unknown_bends
from tssgeom.identify.machine_run import machine_run
from tssgeom.mechanism import Drive, End, GivenRoute
from tssgeom.rig import Friction, Rig, Tendon, read_rig, write_rig
from tssgeom.route.pieces import Arcs
from tssgeom.route.synthetic import STATED
from tssgeom.tendon.machine import route_of_rig, routed
from tssgeom.uncertain import Uncertain, assumed

TIMES = np.linspace(0.0, 24.0, 481)
RIG = Rig(
    friction=Friction(coefficient=0.15),
    tendon=Tendon(pretension_N=6.0, compliance_per_N=3e-4),
    drive=Drive(kind="pair", radius_m=0.01, play_rad=0.02),
    end=End(kind="joint", radius_m=0.01, stiffness_Nm_per_rad=0.2),
    route=GivenRoute(length_m=0.5, angle_rad=3.0),
)
AT_THE_BASE = np.array([0.03, 0.06, 0.21, 0.06, 0.14]), np.array([0.0, 2.0, 0.0, 1.0, 0.0])


def run_on(lengths, angles, seed=0):
    rng = np.random.default_rng(seed)
    path = lumped.from_pieces(lengths, angles, cells=120)
    physics = lumped.Physics(friction=0.15, compliance_per_N=3e-4, pretension_N=6.0)
    slow = 0.75 + 0.25 * np.sin(2.0 * np.pi * TIMES / 24.0)
    angle = 0.9 * slow * np.sin(2.0 * np.pi * TIMES / 6.0)
    joint = lumped.Joint(0.01, 0.2, load=(TIMES, 0.0 * TIMES))
    motor = lumped.Motor("angle", TIMES, angle, 0.01, play_rad=0.02)
    run = lumped.simulate_machine([(path, physics)] * 2, motor, joint, TIMES, 0.05)
    sensors = {
        "joint_angle_rad": lumped.Sensor(noise=2e-3),
        "motor_torque_Nm": lumped.Sensor(noise=2e-3),
    }
    columns = lumped.measure_machine(run, sensors, int(rng.integers(1 << 30)))
    return columns | {"motor_angle_rad": angle, "joint_torque_Nm": 0.0 * TIMES}


def fitted(rig, columns):
    uncertain = [
        Uncertain("friction.coefficient", assumed("", 0.15, 0.015), stated=True),
        Uncertain("route.angle_rad", assumed("", 3.0, 1.5), stated=True),
        Uncertain("tendon.pretension_N", assumed("", 6.0, 3.0), stated=True),
        Uncertain("end.stiffness_Nm_per_rad", assumed("", 0.2, 0.1), stated=True),
        Uncertain("drive.play_rad", assumed("", 0.02, 0.01), stated=True),
    ]
    return calibrate_machine([machine_run("run", columns, [route_of_rig(rig)], rig)], rig, uncertain)


def errors(made):
    """Return how many standard errors each number of the rig is off."""
    truth = {"tendon.compliance_per_N": 3e-4, "tendon.pretension_N": 6.0}
    truth |= {"end.stiffness_Nm_per_rad": 0.2, "drive.play_rad": 0.02}
    return {
        each.key: (each.value - truth[each.key]) / ((each.high - each.low) / 3.92)
        for each in made.estimates
        if each.key in truth
    }


def test_bends_at_the_base_are_no_play_and_no_softness():
    columns = run_on(*AT_THE_BASE)
    known = errors(fitted(replace(RIG, route=replace(RIG.route, bends=(1.0,))), columns))
    assert max(abs(z) for z in known.values()) > 10.0  # an even bend that the rig states, and that is wrong
    made = fitted(RIG, columns)
    assert max(abs(z) for z in errors(made).values()) < 4.0
    shares = np.array([each.value for each in made.bends])
    assert shares.sum() == pytest.approx(1.0)
    assert shares[:3].sum() == pytest.approx(2.0 / 3.0, abs=0.15)
    assert made.rig.route.bends == pytest.approx(tuple(shares))


def test_bends_are_unknown_only_where_neither_rig_nor_shape_says_them():
    one = machine_run("run", run_on(*AT_THE_BASE), [route_of_rig(RIG)], RIG)
    rig, uncertain = with_unknown_bends([one], RIG, ())
    assert rig.route.bends == (1.0,) * STATED.parts
    assert [each.key for each in uncertain] == [f"route.bends[{k}]" for k in range(STATED.parts)]
    stated = replace(RIG, route=replace(RIG.route, bends=(1.0,)))
    assert with_unknown_bends([one], stated, ()) == (stated, ())
    sensed = Arcs.exact(np.array([0.2, 0.3]), np.array([2.0, 1.0]))
    assert with_unknown_bends([changed(one, routes=(sensed,))], RIG, ()) == (RIG, ())


def test_a_rig_states_where_its_sheaths_bend(tmp_path):
    rig = replace(RIG, route=replace(RIG.route, bends=(3.0, 0.0, 1.0)))
    route = route_of_rig(rig)
    assert route.length == pytest.approx([0.5 / 3.0] * 3)
    assert route.angle == pytest.approx([2.25, 0.0, 0.75])
    other = Arcs.exact(np.array([0.1, 0.3]), np.array([1.0, 1.0]))
    assert routed(other, rig).angle == pytest.approx(route.angle)
    write_rig(tmp_path / "rig.toml", rig)
    assert read_rig(tmp_path / "rig.toml").route == rig.route


@pytest.mark.parametrize("bends", [(0.0, 0.0), (1.0, -1.0), (float("nan"),)])
def test_shares_that_are_none_are_refused(bends):
    with pytest.raises(SettingsError, match="bends"):
        GivenRoute(length_m=0.5, angle_rad=3.0, bends=bends)


def test_bends_without_an_angle_are_refused():
    with pytest.raises(SettingsError, match="angle_rad"):
        GivenRoute(length_m=0.5, bends=(1.0,))
