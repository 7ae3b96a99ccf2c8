"""Motors between their readings: straight, as a controller that goes from set point to set point, or not."""

import numpy as np
import pytest

from tests import lumped
from tests.identify.test_machine_discovery import (
    ANGLE,
    ARM,
    LENGTH,
    MU,
    NOISE,
    PRETENSION,
    RHO,
    STIFF,
    UNKNOWN,
    rig,
)
from tssgeom.identify.machine_calibration import calibrate_machine
from tssgeom.identify.machine_run import machine_run
from tssgeom.identify.machine_straight import STRAIGHT
from tssgeom.tendon.machine import route_of_rig
from tssgeom.uncertain import UNKNOWNS, Uncertain

EVERY = 3
"""Steps of the motor from one reading to the next: no cycle turns at a reading."""


def readings(*, straight):
    """What is read of a pair whose motor turns between its readings, or goes straight between them."""
    time = np.arange(0.0, 40.0, 0.1)
    motor = 0.9 * np.sin(2.0 * np.pi * time / 5.0) * (0.7 + 0.3 * np.cos(0.3 * time))
    at = np.arange(0, len(time), EVERY)
    if straight:
        motor = np.interp(time, time[at], motor[at])
    physics = lumped.Physics(pretension_N=PRETENSION, friction=MU, compliance_per_N=RHO)
    path = lumped.from_pieces([LENGTH], [ANGLE], cells=40)
    drive = lumped.Motor("angle", time, motor, ARM)
    run = lumped.simulate_machine([(path, physics)] * 2, drive, lumped.Joint(ARM, STIFF), time, 0.1)
    rng = np.random.default_rng(7)
    true = {
        "motor_angle_rad": motor,
        "motor_torque_Nm": np.asarray(run.motor_torque),
        "joint_angle_rad": np.asarray(run.joint_angle),
    }
    noise = NOISE | {"motor_angle_rad": 3e-4}
    read = {name: values[at] + rng.normal(0.0, noise[name], len(at)) for name, values in true.items()}
    return {"time_s": time[at]} | read


@pytest.mark.parametrize("straight", [True, False], ids=["straight", "curved"])
def test_a_calibration_lets_a_motor_go_as_its_runs_are_likelier(straight):
    hardware = rig(2)
    run = machine_run("run", readings(straight=straight), [route_of_rig(hardware)], hardware)
    uncertain = [Uncertain(key, UNKNOWNS[key], stated=False) for key in UNKNOWN]
    made = calibrate_machine([run], hardware, uncertain)
    assert (STRAIGHT in made.warnings) == straight
    for channel in made.channels if straight else ():
        assert channel.rms < 1.5 * NOISE[channel.name]
