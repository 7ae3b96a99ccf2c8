"""Turns of a motor between two readings: a pair of the lumped chain, thirty readings a cycle."""

import numpy as np
import pytest

pytest.importorskip("tests.lumped")
from tests import lumped
from tssgeom.identify.machine_calibration import calibrate_machine
from tssgeom.identify.machine_prediction import Machines
from tssgeom.identify.machine_run import machine_run, thinned
from tssgeom.identify.turning import legs
from tssgeom.mechanism import Drive, End, GivenRoute
from tssgeom.rig import Friction, Rig, Tendon
from tssgeom.tendon.machine import route_of_rig
from tssgeom.uncertain import Uncertain, assumed

FRICTION, COMPLIANCE, PRETENSION = 0.19, 3.6e-4, 4.0
RIG = Rig(
    friction=Friction(coefficient=0.15),
    tendon=Tendon(compliance_per_N=3e-4, pretension_N=6.0),
    drive=Drive(kind="pair", radius_m=0.01),
    end=End(kind="joint", radius_m=0.01, stiffness_Nm_per_rad=0.1),
    route=GivenRoute(length_m=0.5, angle_rad=3.4),
)
UNCERTAIN = [
    Uncertain("friction.coefficient", assumed("", 0.15, 0.1), stated=True),
    Uncertain("tendon.compliance_per_N", assumed("", 3e-4, 1.5e-4), stated=True),
    Uncertain("tendon.pretension_N", assumed("", 6.0, 4.0), stated=True),
]
TIMES = np.linspace(0.0, 3.6, 181)
CORNERS = np.concatenate([[0.0], np.arange(0.165, 3.6, 0.31), [3.6]])
ANGLES = 0.8 * np.concatenate([[0.0], np.tile([1.0, -1.0], 6)[: len(CORNERS) - 2], [0.0]])


@pytest.fixture(scope="module")
def columns():
    physics = lumped.Physics(friction=FRICTION, compliance_per_N=COMPLIANCE, pretension_N=PRETENSION)
    tendon = (lumped.from_pieces([0.5], [3.4], cells=120), physics)
    motor = lumped.Motor("angle", CORNERS, ANGLES, RIG.drive.radius_m)
    joint = lumped.Joint(RIG.end.radius_m, RIG.end.stiffness_Nm_per_rad)
    run = lumped.simulate_machine([tendon] * 2, motor, joint, TIMES, 0.05)
    sensors = {
        "motor_angle_rad": lumped.Sensor(noise=1.6e-3),
        "motor_torque_Nm": lumped.Sensor(noise=2e-3),
        "joint_angle_rad": lumped.Sensor(noise=2e-3),
    }
    return lumped.measure_machine(run, sensors, 4)


def run_of(columns):
    return machine_run("run", columns, [route_of_rig(RIG)], RIG)


def test_a_pair_has_levels_of_the_turns_of_its_motor_where_the_torque_shows_them(columns):
    made = run_of(columns)
    assert made.legs is not None
    turns = len(CORNERS) - 2
    assert np.abs(made.legs.turn_values)[:-1] == pytest.approx(np.full(turns - 1, 0.8), abs=0.01)
    fitted = calibrate_machine([made], RIG, UNCERTAIN)
    of_turns = [each for each in fitted.estimates if each.name.startswith("turn ")]
    assert len(of_turns) == turns
    assert {each.unit for each in of_turns} == {"rad"}
    values = {each.key: each.value for each in fitted.estimates if each.key}
    # Calmed, without turns between readings, friction was 13 % too small, pretension 17 % too large.
    assert values["friction.coefficient"] == pytest.approx(FRICTION, rel=0.06)
    assert values["tendon.compliance_per_N"] == pytest.approx(COMPLIANCE, rel=0.03)
    assert values["tendon.pretension_N"] == pytest.approx(PRETENSION, rel=0.06)


def test_the_motor_of_a_pair_has_no_levels_where_no_force_is_measured(columns):
    angles = {name: values for name, values in columns.items() if name != "motor_torque_Nm"}
    assert run_of(angles).legs is None


def test_a_turn_lies_on_the_side_of_the_last_reading_before_it_where_the_next_one_is_nearer():
    time = np.arange(41.0)
    for corner, turn in ((19.7, 20), (20.3, 21)):
        drive = 30.0 - np.abs(time - corner) + 1e-3 * np.random.default_rng(0).standard_normal(41)
        made = legs(drive, time, of_position=True)
        assert made.turns.tolist() == [turn]  # the reading behind it


def test_a_thinned_run_keeps_the_turns_of_its_motor_and_its_draws(columns):
    whole = run_of(columns)
    few = thinned(whole, 60)
    assert whole.legs is not None
    assert few.legs is not None
    assert len(few.given["time_s"]) < 100
    assert few.legs.turn_values.tolist() == whole.legs.turn_values.tolist()
    assert np.all(np.diff(few.given["time_s"]) > 0.0)
    assert np.isin(few.at_readings(few.given["time_s"]), columns["time_s"]).all()
    (draw,) = few.inputs.draws(1, few.legs.turns)
    off = draw["motor_angle_rad"] - few.given["motor_angle_rad"]
    assert np.std(off) < 0.02


def test_the_zero_of_the_motor_moves_its_turns_too(columns):
    made = run_of(columns)
    machines = Machines(RIG, 6)
    here = machines.predicted(made, {})
    moved = machines.predicted(made, {("given zero", "motor_angle_rad"): 0.1})
    off = moved["joint_angle_rad"] - here["joint_angle_rad"]
    assert np.median(off) == pytest.approx(-0.1, abs=0.02)


def test_a_motor_whose_turns_are_round_beside_its_noise_has_no_levels():
    time = np.linspace(0.0, 30.0, 601)
    rng = np.random.default_rng(2)
    angle = 0.8 * np.sin(2.0 * np.pi * time / 10.0) + 1.6e-3 * rng.standard_normal(601)
    torque = 0.1 * np.sin(2.0 * np.pi * time / 10.0) + 2e-3 * rng.standard_normal(601)
    channels = {"time_s": time, "motor_angle_rad": angle, "motor_torque_Nm": torque, "joint_angle_rad": angle}
    assert run_of(channels).legs is None
