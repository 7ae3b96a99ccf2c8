"""Designed experiments of machines: what runs leave open is decided by the run that is proposed."""

from dataclasses import replace

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
from tssgeom.errors import SettingsError
from tssgeom.identify.machine_candidates import candidates_of
from tssgeom.identify.machine_design import proposed_of_machine
from tssgeom.identify.machine_discovery import machine_work
from tssgeom.identify.machine_finding import MachineCampaign
from tssgeom.identify.machine_run import machine_run
from tssgeom.identify.proposal import Asked
from tssgeom.tendon.machine import route_of_rig
from tssgeom.uncertain import UNKNOWNS, Uncertain

DRAG = 100.0  # N·s/m²: at the one rate of the campaign friction that depends on speed does nearly the same


def measured(time, motor, drag, seed):
    """What a laboratory would read of a pair with viscous drag whose motor goes so."""
    path = lumped.from_pieces([LENGTH], [ANGLE], cells=60)
    physics = lumped.Physics(
        pretension_N=PRETENSION, friction=MU, compliance_per_N=RHO, viscous_drag_Ns_per_m2=drag
    )
    ends = [(path, physics)] * 2
    run = lumped.simulate_machine(
        ends, lumped.Motor("angle", time, motor, ARM), lumped.Joint(ARM, STIFF), time
    )
    rng = np.random.default_rng(seed)
    read = {"joint_angle_rad": run.joint_angle, "motor_torque_Nm": run.motor_torque}
    noisy = {name: values + NOISE[name] * rng.standard_normal(len(time)) for name, values in read.items()}
    return {"time_s": time, "motor_angle_rad": motor, **noisy}


def made(*columns):
    runs = [machine_run(f"run {k}", each, [route_of_rig(rig(2))], rig(2)) for k, each in enumerate(columns)]
    uncertain = tuple(Uncertain(key, UNKNOWNS[key], stated=False) for key in UNKNOWN)
    return MachineCampaign("bench", rig(2), uncertain, tuple(runs))


def campaign_of(drag):
    """A campaign of a pair at one low rate, and what the steps leave of it."""
    time = np.linspace(0.0, 48.0, 241)
    motor = 0.9 * 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * time / 24.0))
    columns = measured(time, motor, drag, 1)
    return columns, machine_work(made(columns))[0]


@pytest.fixture(scope="module")
def dragged():
    return campaign_of(DRAG)


@pytest.fixture(scope="module")
def sound():
    return campaign_of(0.0)[1]


def difference_of(work):
    """ΔBIC by which drag exceeds friction that depends on speed, on top of the base model."""
    tried = {one.part.label: one.delta_bic for one in work.chosen.steps[0].tried}
    return tried["viscous_drag"] - tried["velocity_dependent_friction"]


def test_the_proposed_run_separates_what_one_rate_leaves_alike(dragged):
    columns, work = dragged
    candidates = [candidate.name for candidate in candidates_of(work)]
    assert candidates == ["viscous_drag", "velocity_dependent_friction"]
    proposal = proposed_of_machine(work, Asked(1, {"speed_mm_per_s": 12.0}), 0)
    (run,) = proposal.runs
    moved = 1e3 * ARM * run.values[:, 0]
    assert np.abs(np.diff(moved) / np.diff(run.time)).max() <= 12.0 * 1.02
    assert np.abs(moved).max() <= proposal.limits["travel_mm"] * 1.02
    assert len(run.outcomes) == 1
    expected = min(each.delta_bic for each in run.expected)
    held = measured(columns["time_s"], columns["motor_angle_rad"], DRAG, 3)
    new = measured(run.time, run.values[:, 0], DRAG, 2)
    after = machine_work(replace(made(columns, new, held), held_out=("run 2",)))[0]
    names = [effect.names for effect in after.finding(()).effects]
    assert ("viscous_drag",) in names
    assert ("velocity_dependent_friction",) not in names
    assert difference_of(work) < 30.0  # both are left
    assert min(expected, difference_of(after)) > 100.0


def test_what_may_hide_is_held_against_a_sound_model(sound):
    candidates = candidates_of(sound)
    assert [candidate.may_be_true for candidate in candidates] == [False, True, True, True]
    assert candidates[0].name == "base"
    assert np.abs(candidates[1].u).max() > 0.0


def test_the_same_seed_proposes_the_same_runs_and_a_later_one_counts_those_before(sound):
    one, two = (proposed_of_machine(sound, Asked(count, {}), 3) for count in (1, 2))
    np.testing.assert_array_equal(one.runs[0].values, two.runs[0].values)
    first, second = ([each.delta_bic for each in run.expected] for run in two.runs)
    assert np.all(np.array(second) >= np.array(first) - 1e-6)


def test_limits_that_forbid_every_run_are_refused(sound):
    with pytest.raises(SettingsError, match=r"least_tension_N=5\.9"):
        proposed_of_machine(sound, Asked(1, {"least_tension_N": 5.9}), 0)
    with pytest.raises(SettingsError, match="give 1 or more"):
        proposed_of_machine(sound, Asked(0, {}), 0)
