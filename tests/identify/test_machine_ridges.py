"""Numbers of a machine that show nearly as a product, and noise of what acts: runs of the lumped machine."""

from functools import partial

import numpy as np
import pytest
from msgspec.structs import replace

pytest.importorskip("tests.lumped")
from tests import lumped
from tssgeom.identify.machine_calibration import calibrate_machine
from tssgeom.identify.machine_run import machine_run
from tssgeom.mechanism import Drive, End, GivenRoute
from tssgeom.rig import Friction, Rig, Tendon, with_values
from tssgeom.tendon.machine import route_of_rig
from tssgeom.uncertain import UNKNOWNS, Uncertain, assumed

TIMES = np.arange(0.0, 20.0, 0.04)
FRICTION, PRETENSION, COMPLIANCE = (
    "friction.coefficient",
    "tendon.pretension_N",
    "tendon.compliance_per_N",
)
LOOP = Rig(
    friction=Friction(coefficient=0.12),
    tendon=Tendon(pretension_N=8.0, compliance_per_N=4e-4),
    drive=Drive(kind="loop", radius_m=0.01),
    end=End(kind="joint", radius_m=0.006),
    route=GivenRoute(length_m=0.5, angle_rad=3.0, bends=(1.0,)),
)


def columns_of(rig, load, torque_noise, rng):
    angle = 0.5 * np.sin(2 * np.pi * TIMES / 5.0) * np.minimum(1.0, TIMES / 4.0)
    route = route_of_rig(rig)
    path = lumped.from_pieces(route.length, route.angle, cells=120)
    physics = lumped.Physics(
        friction=rig.friction.coefficient,
        compliance_per_N=rig.tendon.compliance_per_N,
        pretension_N=rig.tendon.pretension_N,
    )
    joint = lumped.Joint(rig.end.radius_m, rig.end.stiffness_Nm_per_rad, load=(TIMES, load))
    motor = lumped.Motor("angle", TIMES, angle, rig.drive.radius_m)
    run = lumped.simulate_machine([(path, physics)] * 2, motor, joint, TIMES, 0.05)
    sensors = {
        "joint_angle_rad": lumped.Sensor(noise=2e-4),
        "motor_torque_Nm": lumped.Sensor(noise=1e-3),
    }
    columns = lumped.measure_machine(run, sensors, int(rng.integers(1 << 30)))
    read = load + torque_noise * rng.standard_normal(len(TIMES))
    return columns | {"motor_angle_rad": angle, "joint_torque_Nm": read}


def fitted(rig, columns, uncertain):
    nominal = with_values(rig, {each.key: each.prior.centre for each in uncertain})
    runs = [machine_run(f"run {k}", each, [route_of_rig(nominal)], nominal) for k, each in enumerate(columns)]
    return {each.key: each for each in calibrate_machine(runs, nominal, uncertain).estimates if each.key}


def test_pretension_and_friction_of_a_loop_are_held_though_they_show_nearly_as_a_product():
    unknown = partial(Uncertain, stated=False)
    uncertain = [unknown(key, UNKNOWNS[key]) for key in (FRICTION, PRETENSION, "end.radius_m")]
    for seed in range(2):
        rng = np.random.default_rng(seed)
        columns = [columns_of(LOOP, np.full(len(TIMES), load), 0.0, rng) for load in (0.005, 0.02)]
        estimates = fitted(LOOP, columns, uncertain)
        for key, truth in ((FRICTION, 0.12), (PRETENSION, 8.0)):
            each = estimates[key]
            assert each.low < truth < each.high, (seed, each)
            assert each.value == pytest.approx(truth, rel=0.25)  # a fit that stops on the ridge: 5.9, 15 N
            assert each.high < 2.5 * each.low


def test_noise_of_the_load_is_not_taken_for_softness():
    end = End(kind="joint", radius_m=0.01, stiffness_Nm_per_rad=0.1)
    rig = replace(LOOP, end=end)
    uncertain = [
        Uncertain(PRETENSION, assumed("", 8.0, 3.0), stated=True),
        Uncertain(FRICTION, UNKNOWNS[FRICTION], stated=False),
        Uncertain(COMPLIANCE, assumed("", 3e-4, 3e-4), stated=True),
    ]
    load = 0.04 * np.clip(TIMES / 2.0, 0.0, 1.0)
    estimates = fitted(rig, [columns_of(rig, load, 2e-3, np.random.default_rng(0))], uncertain)
    # With the readings as they are the compliance is 1.1 % too large, 4.6 standard errors.
    assert estimates[COMPLIANCE].value == pytest.approx(4e-4, rel=4e-3)
    assert estimates[COMPLIANCE].low < 4e-4 < estimates[COMPLIANCE].high


def test_a_load_that_swings_less_than_it_is_noisy_stays_as_it_was_read():
    rng = np.random.default_rng(1)
    small = 2e-3 * np.sin(2 * np.pi * TIMES / 5.0) + 1e-3 * rng.standard_normal(len(TIMES))
    large = 0.02 * np.sin(2 * np.pi * TIMES / 5.0) + 1e-3 * rng.standard_normal(len(TIMES))
    motor = 0.5 * np.sin(2 * np.pi * TIMES / 5.0)
    for load, kept in ((small, True), (large, False)):
        columns = {"time_s": TIMES, "motor_angle_rad": motor, "joint_torque_Nm": load}
        run = machine_run("run", columns | {"joint_angle_rad": motor}, [route_of_rig(LOOP)], LOOP)
        assert np.array_equal(run.given["joint_torque_Nm"], load) == kept
