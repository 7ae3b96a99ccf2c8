"""Several routes in one calibration of a machine: the angle of each has an error of its own."""

import math

import numpy as np
import pytest
from msgspec.structs import replace as changed

from tssgeom.identify.machine_calibration import calibrate_machine
from tssgeom.identify.machine_run import machine_run
from tssgeom.mechanism import Drive, End
from tssgeom.rig import Friction, Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.machine import machine_of
from tssgeom.tendon.machine_simulation import simulate_machine
from tssgeom.uncertain import Uncertain, assumed

PAIR = Rig(
    tendon=Tendon(pretension_N=4.0, compliance_per_N=4e-4),
    friction=Friction(coefficient=0.12),
    drive=Drive(kind="pair", radius_m=0.01),
    end=End(kind="joint", radius_m=0.006, stiffness_Nm_per_rad=0.05),
)
TIME = np.arange(0.0, 20.0, 0.1)
MOTOR = 0.6 * np.sin(2.0 * np.pi * TIME / 5.0) * np.minimum(1.0, TIME / 4.0)
ERROR = 0.03
UNKNOWN = (Uncertain("friction.coefficient", assumed("friction.coefficient", 0.15, 0.15), True),)


def run(true_angle, sensed, name, rng):
    exact = Arcs.exact(np.array([0.5]), np.array([true_angle]))
    out = simulate_machine(machine_of(PAIR, [exact], 40), {"time_s": TIME, "motor_angle_rad": MOTOR})
    columns = {
        "time_s": TIME,
        "motor_angle_rad": MOTOR,
        "joint_angle_rad": out["joint_angle_rad"] + rng.normal(0.0, 3e-4, TIME.size),
        "motor_torque_Nm": out["motor_torque_Nm"] + rng.normal(0.0, 1e-3, TIME.size),
    }
    covariance = np.diag([0.0, (ERROR * sensed) ** 2])
    return machine_run(name, columns, [Arcs(np.array([0.5]), np.array([sensed]), covariance, "spline")], PAIR)


def calibration(*sensed):
    rng = np.random.default_rng(1)
    runs = [run(true, sensor, f"run{k}", rng) for k, (true, sensor) in enumerate(sensed)]
    return calibrate_machine(runs, changed(PAIR, friction=Friction(coefficient=0.15)), UNKNOWN)


def calibrated(*sensed):
    return {each.name: each for each in calibration(*sensed).estimates}


def sd(estimate):
    return math.log(estimate.high / estimate.low) / (2.0 * 1.96)


def test_two_routes_that_err_apart_know_friction_better_than_one_by_the_root_of_two():
    estimates = calibrated((2.0, 2.0 * 1.03), (5.0, 5.0 / 1.03))
    friction = estimates["friction.coefficient"]
    assert sd(friction) == pytest.approx(ERROR / math.sqrt(2.0), rel=0.05)
    assert friction.value == pytest.approx(0.12, rel=0.005)  # the errors are opposite
    assert "true over sensed angle of run1" in estimates
    assert "route.angle_gain" not in estimates


def test_friction_times_angle_of_the_first_route_has_its_own_error_taken_out():
    product = calibration((2.0, 2.0 * 1.08), (5.0, 5.0)).friction_angle
    assert product.low < 0.12 * 2.0 < product.high
    assert sd(product) < 0.2 * ERROR


def test_runs_on_one_route_share_its_error():
    estimates = calibrated((4.0, 4.1), (4.0, 4.1))
    assert sd(estimates["friction.coefficient"]) == pytest.approx(ERROR, rel=0.05)
    assert not any(name.startswith("true over sensed angle of") for name in estimates)
