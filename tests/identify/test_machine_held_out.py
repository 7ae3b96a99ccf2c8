"""Runs that are held out one after the other: those of one machine agree, those of two do not."""

import numpy as np
import pytest

from tests.tendon.test_machine import rig
from tssgeom.identify.machine_calibration import calibrate_machine
from tssgeom.identify.machine_held_out import HeldOut, HeldOutMisfit, contradictions
from tssgeom.identify.machine_run import machine_run
from tssgeom.rig import with_values
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.machine import machine_of
from tssgeom.tendon.machine_simulation import simulate_machine
from tssgeom.uncertain import UNKNOWNS, Uncertain

ROUTE = [Arcs.exact(np.array([0.5]), np.array([3.0]))]
TIME = np.linspace(0.0, 6.0, 80)
UNKNOWN = [Uncertain("end.radius_m", UNKNOWNS["end.radius_m"], stated=False)]


def one_cycle(name, gain, seed):
    """A pull and a release, too short to hold out a cycle; the joint turns `gain` times as far."""
    true = with_values(rig(), {"end.radius_m": 0.008})
    angle = 0.5 * (1.0 - np.cos(TIME)) * (-1.0) ** seed
    out = simulate_machine(machine_of(true, ROUTE), {"time_s": TIME, "motor_angle_rad": angle})
    noise = 5e-4 * np.random.default_rng(seed).standard_normal(len(TIME))
    joint = gain * out["joint_angle_rad"] + noise
    columns = {"time_s": TIME, "motor_angle_rad": angle, "joint_angle_rad": joint}
    return machine_run(name, columns, ROUTE, rig())


def fitted(*gains):
    runs = [one_cycle(f"run {k}", gain, k) for k, gain in enumerate(gains)]
    assert not any(run.held_out.any() for run in runs)
    return calibrate_machine(runs, rig(), UNKNOWN)


def test_runs_of_one_machine_predict_each_other_within_their_noise():
    of_one = fitted(1.0, 1.0, 1.0)
    assert of_one.failures == ()
    assert of_one.held.of == "runs"
    assert of_one.held_out["joint_angle_rad"][0] == pytest.approx(5e-4, rel=0.2)
    assert len(of_one.held.misfits) == 3


def test_runs_of_two_machines_contradict_each_other_and_no_rig_is_to_be_used():
    of_two = fitted(1.0, 1.7, 1.0, 1.7)
    assert any("held out, is predicted within" in each for each in of_two.failures)


@pytest.mark.parametrize(
    ("rms", "noise", "predicted_sd", "passes"),
    [
        (0.09, 0.001, 0.0, True),
        (0.11, 0.001, 0.0, False),
        (0.11, 0.03, 0.0, True),  # beside noise of the same size
        (0.11, 0.001, 0.1, True),  # the other runs do not determine it
        (0.11, 0.0, 0.01, False),
    ],
)
def test_a_prediction_fails_beside_the_range_the_noise_and_its_own_error(rms, noise, predicted_sd, passes):
    misfit = HeldOutMisfit("joint_angle_rad", rms, 1.0, noise, predicted_sd)
    assert misfit.passes is passes
    assert bool(list(contradictions(HeldOut("runs", {}, (misfit,))))) is not passes


def test_last_cycles_without_readings_hold_nothing_out():
    time = np.linspace(0.0, 36.0, 360)
    angle = 0.5 * (1.0 - np.cos(time))
    true = machine_of(with_values(rig(), {"end.radius_m": 0.008}), ROUTE)
    out = simulate_machine(true, {"time_s": time, "motor_angle_rad": angle})
    joint = out["joint_angle_rad"] + 5e-4 * np.random.default_rng(0).standard_normal(len(time))
    read = np.where(time < 20.0, joint, np.nan)
    run = machine_run(
        "run", {"time_s": time, "motor_angle_rad": angle, "joint_angle_rad": read}, ROUTE, rig()
    )
    assert run.held_out.any()
    assert calibrate_machine([run], rig(), UNKNOWN).held.of == ""
