"""A tendon on a route that stands and is known better by now, and the error that its distal tension keeps."""

import math

import numpy as np
import pytest

from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.saved import state_object, state_of
from tssgeom.tendon.state import pretensioned, step, transmit, transmit_after

RIG, MU = Rig(), Rig().friction.coefficient
LENGTH, ANGLE = np.array([0.2, 0.3]), np.array([1.0, 2.5])
PULLS = (6.0, 15.0, 9.0, 11.0)


def sensed(scale=1.0, se=0.05):
    """The route, with its angles scaled and a standard error of each [rad]."""
    return Arcs(LENGTH, scale * ANGLE, np.diag([1e-6, 1e-6, se**2, se**2]), "spline")


def after(route, pulls=PULLS):
    """The tendon after some proximal tensions [N] on a route."""
    state = pretensioned(RIG)
    for pull in pulls:
        state = step(state, route, RIG, tension_in=pull)
    return state


def test_all_of_its_history_is_as_if_on_the_better_route():
    better = step(after(sensed()), sensed(1.03, 0.01), RIG, tension_in=PULLS[-1], stands=True)
    anew = transmit(after(sensed(1.03, 0.01)), RIG)
    assert transmit(better, RIG) == pytest.approx(tuple(anew), rel=1e-12)


@pytest.mark.parametrize("scale", [0.97, 1.03])
@pytest.mark.parametrize("pulls", [(6.0, 15.0), (6.0, 15.0, 12.0)])
def test_bars_agree_with_the_same_history_on_the_better_route(scale, pulls):
    elsewhere = Arcs.exact(LENGTH, 1.2 * ANGLE)
    states = []
    for route in (sensed(), sensed(scale)):
        state = step(pretensioned(RIG), elsewhere, RIG, tension_in=5.0)
        state = step(state, route, RIG, tension_in=5.0)  # it moved under load: bars from here on
        for pull in pulls:
            state = step(state, route, RIG, tension_in=pull)
        states.append(state)
    better = step(states[0], sensed(scale), RIG, tension_in=pulls[-1], stands=True)
    ours, direct = transmit(better, RIG), transmit(states[1], RIG)
    assert ours.tension_out == pytest.approx(direct.tension_out, rel=2e-3)
    assert ours.elongation == pytest.approx(direct.elongation, rel=5e-3)


def test_without_knowing_that_it_stands_the_first_route_stays_the_measure():
    state = step(after(sensed()), sensed(1.03), RIG, tension_in=PULLS[-1])
    assert transmit(state, RIG).tension_out == transmit(after(sensed()), RIG).tension_out


def test_a_distal_tension_that_friction_holds_owes_nothing_to_a_better_route():
    state = after(Arcs.exact(LENGTH, ANGLE), (10.0,))
    state = step(state, Arcs.exact(LENGTH, 1.3 * ANGLE), RIG, tension_in=10.0)  # more friction holds it
    held = transmit(state, RIG).tension_out
    assert held == pytest.approx(10.0 * math.exp(-MU * ANGLE.sum()), rel=1e-4)
    better = step(state, sensed(1.33), RIG, tension_in=10.0, stands=True)
    assert transmit(better, RIG).tension_out == pytest.approx(held, rel=1e-6)


def test_a_distal_tension_keeps_the_error_with_which_it_was_reached():
    before = pretensioned(RIG)
    pulled = step(before, sensed(1.0, 0.05), RIG, tension_in=10.0)
    state, first = transmit_after(before, pulled, RIG, stands=False)
    expected = first.tension_out * MU * math.hypot(0.05, 0.05)
    assert first.tension_out_se == pytest.approx(expected, rel=1e-6)
    moved = step(state, sensed(1.5, 0.01), RIG, tension_in=10.0)
    state, later = transmit_after(state, moved, RIG, stands=False)
    assert later.tension_out == pytest.approx(first.tension_out, rel=1e-4)
    assert later.tension_out_se == pytest.approx(expected, rel=1e-6)
    assert later.elongation_se > transmit(moved, RIG).elongation_se
    revived = state_of(state_object(state))
    assert revived.tension_out_se == state.tension_out_se
    pulled = step(state, sensed(1.5, 0.01), RIG, tension_in=30.0)
    _, last = transmit_after(state, pulled, RIG, stands=False)
    assert last.tension_out_se == pytest.approx(last.tension_out * MU * math.hypot(0.01, 0.01), rel=1e-2)


def test_a_distal_tension_that_no_drive_reaches_keeps_its_error_where_bends_along_the_tendon_push_it():
    before = pretensioned(RIG)
    state, first = transmit_after(before, step(before, sensed(1.0, 0.05), RIG, tension_in=10.0), RIG, False)
    errors = np.diag([1e-6, 1e-6, 1e-4, 1e-4])
    pushed = Arcs(LENGTH, ANGLE + np.array([0.8, -0.3]), errors, "spline")  # more in all, less at the end
    _, later = transmit_after(state, step(state, pushed, RIG, tension_in=10.0), RIG, stands=False)
    assert later.tension_out > 1.002 * first.tension_out
    assert later.dead_zone
    assert later.tension_out_se >= first.tension_out_se
