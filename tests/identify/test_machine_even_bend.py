"""A pair by the angles of motor and joint alone, where neither rig nor shape says where its sheaths bend."""

import functools

import numpy as np
import pytest
from msgspec.structs import replace

from tssgeom.identify.machine_calibration import calibrate_machine
from tssgeom.identify.machine_run import machine_run
from tssgeom.mechanism import Drive, End, GivenRoute
from tssgeom.rig import Friction, Rig, Tendon
from tssgeom.tendon.machine import machine_of, route_of_rig
from tssgeom.tendon.machine_simulation import simulate_machine
from tssgeom.uncertain import UNKNOWNS, Uncertain

TIME = np.linspace(0.0, 24.0, 200)
KEYS = ("end.radius_m", "tendon.pretension_N", "friction.coefficient")
BENDS = (1.0, 1.0, 3.0, 3.0, 2.0, 1.0, 0.0, 0.0, 1.0, 2.0, 4.0, 4.0, 2.0, 1.0, 1.0, 1.0)
RIG = Rig(
    friction=Friction(coefficient=0.14),
    tendon=Tendon(pretension_N=11.0, compliance_per_N=4e-4),
    drive=Drive(kind="pair", radius_m=0.009),
    end=End(kind="joint", radius_m=0.005, stiffness_Nm_per_rad=0.06),
    route=GivenRoute(length_m=0.8, angle_rad=4.2, bends=BENDS),
)
TRUTH = {
    "end.radius_m": 0.005,
    "tendon.pretension_N": 11.0,
    "tendon.compliance_per_N": 4e-4,
    "friction.coefficient": 0.14,
}


@functools.cache
def calibrated(stated, seed=1):
    rig = RIG if stated else replace(RIG, route=replace(RIG.route, bends=()))
    motor = np.sin(2 * np.pi * TIME / 8.0) * np.minimum(1.0, 0.4 + TIME / 30.0)
    drive = {"time_s": TIME, "motor_angle_rad": motor}
    out = simulate_machine(machine_of(RIG, [route_of_rig(RIG)], 80), drive)
    noise = 3.5e-4 * np.random.default_rng(seed).standard_normal(len(TIME))
    columns = drive | {"joint_angle_rad": out["joint_angle_rad"] + noise}
    uncertain = [Uncertain(key, UNKNOWNS[key], stated=False) for key in KEYS]
    run = machine_run("run", columns, [route_of_rig(rig)], rig)
    return calibrate_machine([run], rig, uncertain)


def warnings(stated):
    return [each for each in calibrated(stated).warnings if "route.bends" in each]


def test_numbers_that_hang_on_bends_that_nobody_knows_are_named():
    (warning,) = warnings(stated=False)
    assert any(key in warning for key in TRUTH)
    assert "state route.bends" in warning


def test_numbers_of_a_sheath_whose_bends_are_stated_hang_on_nothing():
    assert warnings(stated=True) == []


@pytest.mark.parametrize("key", TRUTH)
def test_intervals_along_a_valley_of_bends_hold_the_truth(key):
    (each,) = (each for each in calibrated(stated=False).estimates if each.key == key)
    assert each.low <= TRUTH[key] <= each.high
    (known,) = (each for each in calibrated(stated=True).estimates if each.key == key)
    assert each.high - each.low > known.high - known.low  # what nobody knows is not known better
