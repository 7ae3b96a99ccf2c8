"""Contacts that give way before they slide, beside finite elements with bristles that share no code."""

import msgspec
import numpy as np
import pytest

from tests.bristle.chain import Bristles
from tests.bristle.laws import Acts, dahl
from tests.bristle.machine import run_pair
from tests.bristle.rig import Rig as BristleRig
from tests.bristle.rig import run
from tests.bristle.sheath import random_sheath
from tests.pairs_of_bristles import arcs_of, pair_that_gives, rig_of
from tssgeom.effects import Presliding
from tssgeom.rig import Friction, Load, Rig, Tendon
from tssgeom.tendon.bars.model import predict
from tssgeom.tendon.machine import machine_of
from tssgeom.tendon.machine_simulation import simulate_machine

TIME = np.linspace(0.0, 20.0, 401)
STROKE = 0.0036 * (1.0 - np.cos(2.0 * np.pi * TIME / 8.0)) * (1.0 + 0.3 * np.sin(TIME))

GIVEN = {"time_s": TIME, "displacement_in_m": STROKE}
RIG = Rig(
    tendon=Tendon(pretension_N=5.0, compliance_per_N=3e-4),
    friction=Friction(coefficient=0.15),
    load=Load(stiffness_N_per_m=2000.0),
)


def pulled(bristles):
    """Return a sheath, and what elements with these bristles give for the rig in it under the stroke."""
    sheath = random_sheath(np.random.default_rng(3), 0.6, 3.0, 0)
    elements = BristleRig(0.15, 3e-4, 5.0, 2000.0, [sheath], bristles=bristles)
    return sheath, run(elements, sheath, TIME, STROKE, Acts())


def off(channel, read, true):
    return float(np.sqrt(np.mean((read[channel] - true) ** 2)))


@pytest.mark.parametrize(("distance", "without"), [(1e-5, 0.11), (5e-5, 0.34), (2e-4, 0.87), (1e-3, 2.4)])
def test_a_tendon_is_that_of_bristles(distance, without):
    sheath, true = pulled(Bristles(breakaway_m=(distance,)))
    base, full = (
        predict(GIVEN, arcs_of(sheath), RIG, effects) for effects in ((), (Presliding(distance_m=distance),))
    )
    assert off("tension_in_N", base, true["tension_in"]) > without  # what the effect is for [N]
    assert off("tension_in_N", full, true["tension_in"]) < 1e-3  # of 30 bars; a tenth of it with 120
    assert off("tension_out_N", full, true["tension_out"]) < 2e-4


@pytest.mark.parametrize(("distance", "alike"), [(1e-5, 0.02), (5e-5, 0.08), (2e-4, 0.25), (1e-3, 0.8)])
def test_a_tendon_whose_contacts_differ_is_that_of_many_bristles_a_contact(distance, alike):
    """By Dahl's law each contact has one bristle of those that each contact of the elements has; (323)."""
    at, share = dahl(distance, 40)
    sheath, true = pulled(Bristles(breakaway_m=at, share=share))
    by_prandtl, by_dahl = (
        predict(GIVEN, arcs_of(sheath), RIG, (effect,))
        for effect in (Presliding(distance_m=2.0 * distance), Presliding(distance_m=distance, law="dahl"))
    )
    assert off("tension_in_N", by_prandtl, true["tension_in"]) > alike  # with the mean path for all [N]
    assert off("tension_in_N", by_dahl, true["tension_in"]) < 0.065  # of 30 bars; changes are 0.16 to 2.7
    assert off("tension_out_N", by_dahl, true["tension_out"]) < 0.022


def test_a_pair_on_a_joint_is_that_of_bristles():
    distance = 5e-5
    pair = pair_that_gives(distance, np.random.default_rng([0, 77]))
    sheath, time = pair.sheaths[0], np.arange(1, 201) / 20.0
    motor = 0.5 * np.sin(time) * (1.0 - np.exp(-time))
    true, rig = run_pair(pair, sheath, time, motor), rig_of(pair)
    given = {"time_s": time, "motor_angle_rad": motor}
    base, full = (
        simulate_machine(machine_of(msgspec.structs.replace(rig, effects=effects), [arcs_of(sheath)]), given)
        for effects in ((), (Presliding(distance_m=distance),))
    )
    assert off("joint_angle_rad", base, true["joint_angle"]) > 1e-3
    assert off("joint_angle_rad", full, true["joint_angle"]) < 3e-5
    assert off("motor_torque_Nm", full, true["motor_torque"]) < 3e-4
    assert off("motor_torque_Nm", base, true["motor_torque"]) > 3e-3
