"""Numbers of a machine that show nearly as a product: runs of the lumped machine."""

from functools import partial

import numpy as np
import pytest

pytest.importorskip("tests.lumped")
from tests import lumped
from tssgeom.identify.machine_calibration import calibrate_machine
from tssgeom.identify.machine_run import machine_run, route_of_rig
from tssgeom.mechanism import Drive, End
from tssgeom.rig import Friction, GivenRoute, Rig, Tendon, with_values
from tssgeom.uncertain import UNKNOWNS, Uncertain

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
    route=GivenRoute(length_m=0.5, angle_rad=3.0),
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
