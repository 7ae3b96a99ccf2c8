"""Pairs whose contacts give way before they slide, from bristles that share no code with the model."""

from functools import cache

import numpy as np
import pytest

from tests.bristle.machine import run_pair
from tests.pairs_of_bristles import arcs_of, pair_that_gives, rig_of
from tssgeom.effects import Presliding
from tssgeom.identify.machine_calibration import calibrate_machine
from tssgeom.identify.machine_discovery import discover_machine
from tssgeom.identify.machine_finding import MachineCampaign
from tssgeom.identify.machine_run import machine_run
from tssgeom.uncertain import UNKNOWNS, Uncertain

PRETENSION, FRICTION = "tendon.pretension_N", "friction.coefficient"
TIME = np.arange(1, 201) / 20.0
NOISE = {"joint_angle_rad": 3e-4, "motor_torque_Nm": 1e-3}


@cache
def bench(distance):
    """The rig with all that is true of it, and three runs; `distance` is what contacts give [m]."""
    rng = np.random.default_rng([1, 77])
    pair = pair_that_gives(distance, rng)
    rig, sheath, runs = rig_of(pair), pair.sheaths[0], []
    for k, reach in enumerate((0.6, 0.8, 0.7)):
        motor = reach * np.sin((1.0 + 0.2 * k) * TIME) * (0.7 + 0.3 * np.cos(0.31 * TIME))
        true = run_pair(pair, sheath, TIME, motor)
        read = {
            name: true[name.rpartition("_")[0]] + rng.normal(0.0, noise, len(TIME))
            for name, noise in NOISE.items()
        }
        run = {"time_s": TIME, "motor_angle_rad": motor} | read
        runs.append(machine_run(f"run {k}", run, [arcs_of(sheath)], rig))
    return (
        rig,
        tuple(runs),
        tuple(Uncertain(key, UNKNOWNS[key], stated=False) for key in (PRETENSION, FRICTION)),
    )


def test_what_contacts_give_is_not_taken_for_pretension_and_friction():
    rig, runs, uncertain = bench(2e-5)
    fitted = calibrate_machine(runs, rig, uncertain)
    assert any("fitted as presliding" in each for each in fitted.warnings)
    estimates = {each.key: each for each in fitted.estimates}
    truth = {
        PRETENSION: rig.tendon.pretension_N,
        FRICTION: rig.friction.coefficient,
        "effects[0].distance_m": 2e-5,
    }
    for key, value in truth.items():
        each = estimates[key]
        assert each.low < value < each.high, each
    assert fitted.failures == ()


def test_contacts_that_give_nothing_leave_a_calibration_as_it_was():
    rig, runs, uncertain = bench(5e-8)
    fitted = calibrate_machine(runs, rig, uncertain)
    assert fitted.rig.effects == ()
    assert fitted.warnings == ()


def test_presliding_of_a_pair_is_named_though_its_pretension_is_unknown():
    rig, runs, uncertain = bench(2e-5)
    finding = discover_machine(MachineCampaign("bench", rig, uncertain[:1], runs[:2], ()))
    (effect,) = finding.effects
    assert effect.names == ("presliding",)
    assert effect.parameters[0]["distance_m"].value == pytest.approx(2e-5, rel=0.3)
    assert isinstance(finding.rig.effects[0], Presliding)
    before, after = (
        each["held_out"]["joint_angle_rad"] for each in (finding.misfit.before, finding.misfit.after)
    )
    assert after < 1.2 * NOISE["joint_angle_rad"] < 0.6 * before
