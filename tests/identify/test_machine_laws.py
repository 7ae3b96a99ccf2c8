"""Free laws of machines: what is fitted of a curve, and friction that no formula of the library has."""

import numpy as np
import pytest

from tests.identify.test_machine_discovery import ARM, MU, NOISE, UNKNOWN, columns, held, rig
from tssgeom.effects import FrictionLaw
from tssgeom.identify.machine_discovery import machine_work
from tssgeom.identify.machine_finding import MachineCampaign
from tssgeom.identify.machine_law_search import laws_for_formulae
from tssgeom.identify.machine_laws import free_laws
from tssgeom.identify.machine_parts import parts_of
from tssgeom.identify.machine_run import machine_run
from tssgeom.identify.machine_selection import part_step
from tssgeom.tendon.machine import machine_of, route_of_rig
from tssgeom.tendon.machine_simulation import simulate_machine
from tssgeom.uncertain import UNKNOWNS, Uncertain

OF_SPEED = {"velocity_dependent_friction", "viscous_drag"}
PEAK, DECAY, LAG_S = 0.4, 2e-3, 1.0


def laws_of(*runs):
    hardware = rig(2)
    made = [machine_run(f"run {k}", each, [route_of_rig(hardware)], hardware) for k, each in enumerate(runs)]
    machine = machine_of(hardware, [route_of_rig(hardware)])
    every = free_laws(made, [simulate_machine(machine, dict(run.given)) for run in made], hardware)
    return {law.name: law for law in every}


def of_sensors(kind):
    return {f"sensor_{kind}:{channel}" for channel in ("joint_angle_rad", "motor_torque_Nm")}


@pytest.fixture(scope="module")
def laws():
    return laws_of(columns(2), columns(2, seed=2))


def test_laws_are_over_what_the_runs_reach(laws):
    over = ("tension", "speed", "arc_length", "travel", "time", "position")
    beside = {"strain_over_tension", "load_over_position", *of_sensors("curve"), *of_sensors("drift")}
    assert set(laws) == beside | {f"friction_over_{each}" for each in over}
    time, speed = (laws[f"friction_over_{each}"].mechanism.x for each in ("time", "speed"))
    assert time[[0, -1]] == pytest.approx([0.0, 48.0])
    assert 0.5 < speed[-1] / (ARM * 0.9 * 2.0 * np.pi * 3.0 / 12.0) < 1.1


def test_one_run_has_no_law_over_time_and_travel(laws):
    of_many = {"friction_over_time", "friction_over_travel", *of_sensors("drift")}
    assert set(laws) - set(laws_of(columns(2))) == of_many


def test_no_law_does_what_the_base_model_has_a_number_for(laws):
    for law in laws.values():
        for each in law.as_rough():
            assert each.size >= 1
            curve = each.waves[: each.mechanism.size - each.mechanism.more]
            straight, level = law.mechanism.x[-len(curve) :], np.ones(len(curve))
            for of_base in [level] * (not law.mechanism.pinned) + [straight] * (
                law.mechanism.pinned or law.mechanism.has_slope
            ):
                np.testing.assert_allclose(of_base @ curve, 0.0, atol=1e-9 * np.abs(of_base).sum())


def test_other_knots_leave_a_law_as_it_is(laws):
    rng = np.random.default_rng(3)
    for law in laws.values():
        numbers = 0.1 * rng.standard_normal(law.size)
        fine = law.with_knots(12)
        there = fine.waves @ fine.numbers_of(law, numbers)
        curve = fine.mechanism.value(there)
        own = np.interp(fine.mechanism.x, law.mechanism.x, law.mechanism.value(law.waves @ numbers))
        assert np.ptp(curve - own) < 0.25 * np.ptp(own)  # up to the constant that the base model has


@pytest.fixture(scope="module")
def falling():
    """What the workflow leaves of a pair whose friction falls with speed."""
    falls = columns(2, stribeck_gain=PEAK, stribeck_speed_m_per_s=DECAY, speed_lag_s=LAG_S)
    run = machine_run("run", falls, [route_of_rig(rig(2))], rig(2))
    uncertain = tuple(Uncertain(key, UNKNOWNS[key], stated=False) for key in UNKNOWN)
    return machine_work(MachineCampaign("bench", rig(2), uncertain, (run,)))[0]


def test_no_formula_is_tried_beside_the_law_of_its_mechanism(falling):
    parts = [part for part in parts_of(rig(2), (), falling.fitted) if part.name in OF_SPEED]
    assert {part.name for part in parts} == OF_SPEED
    model = falling.chosen.model
    tried = part_step(falling.base, model, parts, falling.kept).tried
    assert not tried
    assert not list(laws_for_formulae(falling.base, model, falling.kept))


def test_friction_that_falls_with_speed_is_a_law_within_its_band(falling):
    finding = falling.finding(())
    assert finding.verdict == "law"
    (effect,) = finding.effects
    assert effect.names == ("friction_over_speed",)
    law = effect.law
    assert law is not None
    true = MU * (1.0 + PEAK * np.exp(-law.x / DECAY))
    slid = (law.x > 0.02 * law.x[-1]) & (law.x < 0.9 * law.x[-1])
    np.testing.assert_allclose(law.value[slid], true[slid], rtol=0.03)
    assert np.mean((law.low <= true) & (true <= law.high)) > 0.5
    before, after = held(finding, "joint_angle_rad")
    assert before > 4.0 * NOISE["joint_angle_rad"]
    assert after < 1.2 * NOISE["joint_angle_rad"]
    (own,) = finding.rig.effects
    assert isinstance(own, FrictionLaw)
    assert own.memory_s == pytest.approx(LAG_S, rel=0.1)
    assert "speed of sliding" in finding.sentence
