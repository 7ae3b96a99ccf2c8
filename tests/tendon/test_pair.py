"""Two tendons on one joint: against closed forms, with and without friction."""

import math

import pytest
from msgspec.structs import replace as changed

from tssgeom.effects import HiddenBend
from tssgeom.errors import SettingsError
from tssgeom.rig import Friction, Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.pair import HALVINGS, Both, Joint, Routes, pretensioned_pair, step

PI, MU, RHO = math.pi, 0.145, 3.16e-4
JOINT = Joint(radius=0.01, stiffness=0.2)
HALF_CIRCLE, BENT = Arcs.exact([0.5], [PI]), Arcs.exact([0.3, 0.3], [1.0, 0.5])
ROUTES = Routes(HALF_CIRCLE, BENT)
SOFT = 1.0 / (RHO * 0.5)  # stiffness of 0.5 m of tendon [N/m]
# Equilibria are solved to 1e-10 of the tension, and the joint to 1e-12 m of some millimetres.
SOLVED = 1e-8


def rig(pretension=5.0, friction=MU):
    return Rig(tendon=Tendon(pretension_N=pretension), friction=Friction(coefficient=friction))


def balance(pair, joint=JOINT):
    """Torque that is left over [N·m]."""
    pull = joint.radius * (pair.agonist.tension_out - pair.antagonist.tension_out)
    return pull - joint.stiffness * pair.angle - pair.torque


@pytest.mark.parametrize("torque", [0.0, 0.02, -0.03])
def test_without_friction_the_joint_turns_as_two_springs_say(torque):
    """r·2(q − rθ)/(ρL) = Kθ + τ where the drives move by q and −q."""
    hardware, drive = rig(friction=0.0), 2e-3
    routes = Routes(HALF_CIRCLE, HALF_CIRCLE)
    pair = pretensioned_pair(hardware, routes, 20)
    pair = step(pair, routes, hardware, JOINT, displacement_in=Both(drive, -drive), torque=torque)
    r = JOINT.radius
    expected = (2 * r * SOFT * drive - torque) / (JOINT.stiffness + 2 * r * r * SOFT)
    assert pair.angle == pytest.approx(expected, rel=SOLVED)
    assert pair.agonist.tension_out == pytest.approx(5.0 + SOFT * (drive - r * expected), rel=SOLVED)
    assert balance(pair) == pytest.approx(0.0, abs=1e-9)


def test_a_tendon_that_goes_slack_leaves_the_joint_to_the_other():
    hardware, drive = rig(0.5, 0.0), 3e-3
    routes = Routes(HALF_CIRCLE, HALF_CIRCLE)
    pair = step(
        pretensioned_pair(hardware, routes, 20), routes, hardware, JOINT, displacement_in=Both(drive, -drive)
    )
    r = JOINT.radius
    expected = r * (0.5 + SOFT * drive) / (JOINT.stiffness + r * r * SOFT)
    assert pair.antagonist.tension_out == 0.0
    assert pair.angle == pytest.approx(expected, rel=SOLVED)
    back = step(pair, routes, hardware, JOINT, displacement_in=Both(0.0, 0.0))
    assert back.angle == pytest.approx(0.0, abs=1e-9)
    assert back.antagonist.tension_out == pytest.approx(0.5, rel=1e-6)  # a difference of springs of 6 kN/m


def test_with_friction_the_pulled_tendon_loses_and_the_drawn_one_gains_tension():
    """The agonist slides towards its drive, the antagonist away from one that holds its tension."""
    pair = pretensioned_pair(rig(), ROUTES)
    pair = step(pair, ROUTES, rig(), JOINT, tension_in=Both(30.0, 5.0))
    pulled, plotted = 30.0 * math.exp(-MU * PI), 5.0 * math.exp(MU * 1.5)
    assert pair.agonist.tension_out == pytest.approx(pulled, rel=SOLVED)
    assert pair.antagonist.tension_out == pytest.approx(plotted, rel=SOLVED)
    assert pair.angle == pytest.approx(JOINT.radius * (pulled - plotted) / JOINT.stiffness, rel=SOLVED)


def test_a_small_reversal_is_lost_in_both_sheaths():
    pair = step(pretensioned_pair(rig(), ROUTES), ROUTES, rig(), JOINT, tension_in=Both(30.0, 5.0))
    eased = step(pair, ROUTES, rig(), JOINT, tension_in=Both(26.0, 5.5))
    assert eased.angle == pytest.approx(pair.angle, rel=SOLVED)
    reversed_ = step(pair, ROUTES, rig(), JOINT, tension_in=Both(5.0, 30.0))
    assert reversed_.angle < 0.0
    assert balance(reversed_) == pytest.approx(0.0, abs=1e-9)


def test_pulling_both_alike_on_like_routes_does_not_turn_the_joint():
    routes = Routes(HALF_CIRCLE, HALF_CIRCLE)
    pair = step(pretensioned_pair(rig(), routes), routes, rig(), JOINT, tension_in=Both(20.0, 20.0))
    assert pair.angle == pytest.approx(0.0, abs=1e-12)
    last_bar = MU * PI / 60 / 2**HALVINGS / 2  # the distal ends stand still, so friction may hold that much
    assert pair.agonist.tension_out == pytest.approx(20.0 * math.exp(-MU * PI), rel=last_bar)


def test_with_held_drives_a_load_turns_the_joint_against_stiffer_tendons_than_the_joint_alone():
    held = pretensioned_pair(rig(), ROUTES)
    pair = step(held, ROUTES, rig(), JOINT, displacement_in=Both(0.0, 0.0), torque=0.05)
    assert -0.05 / JOINT.stiffness < pair.angle < 0.0
    assert pair.agonist.tension_out > 5.0 > pair.antagonist.tension_out
    assert balance(pair) == pytest.approx(0.0, abs=1e-9)


def test_routes_that_move_keep_the_balance():
    pair = step(pretensioned_pair(rig(), ROUTES), ROUTES, rig(), JOINT, displacement_in=Both(4e-3, -4e-3))
    for angle in (2.0, 1.0, 3.0):
        moved = Routes(Arcs.exact([0.5], [angle]), Arcs.exact([0.3, 0.3], [angle, 0.2]))
        pair = step(pair, moved, rig(), JOINT, displacement_in=Both(4e-3, -4e-3))
        assert balance(pair) == pytest.approx(0.0, abs=1e-9)
        assert pair.agonist.displacement_out == pytest.approx(JOINT.radius * pair.angle, abs=1e-11)
        assert pair.antagonist.displacement_out == pytest.approx(-JOINT.radius * pair.angle, abs=1e-11)


def test_impossible_joints_and_loads_are_refused():
    for radius, stiffness in ((0.0, 1.0), (0.01, 0.0), (math.inf, 1.0), (0.01, -1.0)):
        with pytest.raises(SettingsError, match="joint"):
            Joint(radius, stiffness)
    with pytest.raises(SettingsError, match="torque"):
        step(
            pretensioned_pair(rig(), ROUTES),
            ROUTES,
            rig(),
            JOINT,
            tension_in=Both(5.0, 5.0),
            torque=math.nan,
        )


def test_a_pair_refuses_effects_that_it_does_not_know():
    bent = changed(rig(), effects=(HiddenBend(at_m=0.2, angle_rad=0.5),))
    with pytest.raises(SettingsError, match="the rig has hidden_bend"):
        pretensioned_pair(bent, ROUTES)
