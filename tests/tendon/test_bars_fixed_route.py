"""Bars on a fixed route: against the paper, closed forms and the corner list."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.tendon.bars import (
    HALF_CIRCLE,
    MU,
    PI,
    RHO,
    SETUP_A,
    SETUP_B,
    SOLVED,
    STRAIGHT,
    WITH_STRAIGHTS,
    arcs_of,
    driven,
    histories,
    pieces,
    rig,
    tensions,
    untimed,
)
from tests.tendon.steps import pretensioned_bars, step
from tssgeom.route.pieces import Arcs
from tssgeom.tendon import capstan as profile
from tssgeom.tendon.bars.bar_state import to_bars, to_corners
from tssgeom.tendon.capstan import transmit

# The tension at a bar's mean angle against its mean tension: (μθ)²/24 where it slides, 2e-5 for 60 bars over
# 3π; a corner of the profile inside a bar costs up to μθ/8 of that bar, 5e-5 of the whole, and there are few.
DISCRETE = 5e-4


def cornered(state, arcs):
    return to_corners(state.edge, state.tension, state.direction_index, arcs)


def by_corners(history, hardware):
    state = profile.pretensioned(hardware)
    for tension_in in history:
        state = profile.step(state, tension_in, hardware.friction.coefficient)
    return state


@pytest.mark.parametrize(
    ("arcs", "pretension", "history", "elongation_mm"),
    [
        (HALF_CIRCLE, 0.0, [15.0], 1.9036),
        (HALF_CIRCLE, 0.0, [15.0, 10.0], 1.7284),
        (HALF_CIRCLE, 0.0, [15.0, 6.031], 1.2071),
        (WITH_STRAIGHTS, 0.0, [15.0], 1.9167),
        (HALF_CIRCLE, 10.0, [11.0], 0.0163),
        (HALF_CIRCLE, 5.0, [7.0], 0.1102),
    ],
)
def test_elongation_is_that_of_the_closed_form(arcs, pretension, history, elongation_mm):
    state = driven(history, arcs, rig(pretension))
    # 5e-5 mm is the last printed digit
    assert 1e3 * state.elongation == pytest.approx(elongation_mm, abs=1e-4 + DISCRETE * elongation_mm)


def test_setups_of_figure_6_differ_in_elongation_and_not_in_tension():
    a, b = driven([15.0], SETUP_A, rig()), driven([15.0], SETUP_B, rig())
    assert a.tension_out == pytest.approx(15.0 * math.exp(-3 * PI * MU), rel=1e-12)
    assert b.tension_out == pytest.approx(a.tension_out, rel=1e-12)
    assert 1e3 * (a.elongation - b.elongation) == pytest.approx(0.34, abs=0.005)  # two digits are printed


@given(histories, pieces, st.sampled_from([0.0, 5.0]), st.floats(0.01, 0.4))
@untimed
def test_any_history_of_force_gives_the_tensions_of_the_corner_list(
    history, random_drive, pretension, friction
):
    arcs, hardware = arcs_of(random_drive), rig(pretension, friction)
    state, corners = driven(history, arcs, hardware, 25), by_corners(history, hardware)
    expected = to_bars(corners, arcs, hardware, 25)
    # the corner list treats changes of 1e-12 in ln T as rounding; bars solve to 1e-10 of 30 N
    np.testing.assert_allclose(state.tension, expected.tension, rtol=1e-9, atol=1e-8)
    width = friction * arcs.total_angle / 25
    bound = (
        RHO * arcs.total_length * max(*history, pretension) * (width**2 / 6 + 4 * len(history) * width / 25)
    )
    assert abs(state.elongation - transmit(corners, arcs, hardware).elongation) <= bound + 1e-15


@pytest.mark.parametrize("arcs", [HALF_CIRCLE, WITH_STRAIGHTS, SETUP_A, Arcs.exact([0.11, 0.2], [2.0, 0.7])])
def test_elongation_converges_with_order_two(arcs):
    truth = transmit(by_corners([15.0], rig()), arcs, rig()).elongation
    bars = np.array([12, 24, 48, 96, 192])
    errors = [abs(driven([15.0], arcs, rig(), n).elongation - truth) for n in bars]
    order = -np.polyfit(np.log(bars), np.log(errors), 1)[0]
    assert order == pytest.approx(2.0, abs=0.15)  # joints of pieces fall unevenly into bars


def test_elongation_with_inner_corners_stays_within_an_envelope_of_order_two():
    history = [15.0, 5.0, 9.0, 7.0]
    truth = transmit(by_corners(history, rig()), SETUP_A, rig()).elongation
    for n in range(10, 200, 13):
        error = abs(driven(history, SETUP_A, rig(), n).elongation / truth - 1)
        # three corners, each μθ/8 of 1/n, on the loop with 2/3 of the angle on 0.47 of the length: ×1.4
        assert error <= 3 * 1.4 * MU * 3 * PI / (8 * n) / n * 15.0 / 7.0


def test_distal_tension_and_displacement_are_exact_with_any_number_of_bars():
    for bars in (1, 2, 7, 60):
        state = driven([15.0], HALF_CIRCLE, rig(), bars)
        assert state.tension_out == pytest.approx(15.0 * math.exp(-PI * MU), rel=1e-12)
        assert state.displacement_out == pytest.approx(state.tension_out / 1000.0, rel=1e-9)
        assert state.displacement_in == pytest.approx(state.elongation + state.displacement_out, rel=1e-9)


@given(histories)
@untimed
def test_position_drive_retraces_force_drive(history):
    hardware = rig(5.0)
    by_force = by_position = pretensioned_bars(hardware, SETUP_A, 30)
    for tension_in in history:
        before, by_force = by_force, step(by_force, SETUP_A, hardware, tension_in=tension_in)
        by_position = step(by_position, SETUP_A, hardware, displacement_in=by_force.displacement_in)
        np.testing.assert_allclose(by_position.tension[1:], by_force.tension[1:], atol=SOLVED)
        if abs(by_force.displacement_in - before.displacement_in) > 1e-12:  # less does not pass a contact
            assert by_position.tension_in == pytest.approx(tension_in, abs=SOLVED)


@pytest.mark.parametrize("parts", [2, 37])
def test_many_small_steps_give_what_one_big_step_gives(parts):
    one = many = driven([15.0, 9.0], SETUP_A, rig(2.0))
    start = one.displacement_in
    one = step(one, SETUP_A, rig(2.0), displacement_in=start - 2e-3)
    for k in range(1, parts + 1):
        many = step(many, SETUP_A, rig(2.0), displacement_in=start - 2e-3 * k / parts)
    np.testing.assert_allclose(many.tension, one.tension, atol=SOLVED)


def test_an_inner_loop_of_position_is_forgotten():
    top, outer = driven([15.0], SETUP_A, rig()), driven([15.0, 5.0], SETUP_A, rig())
    position, state = outer.displacement_in, outer
    for share in (0.8, 0.3, 0.6, 0.0):
        back = position + share * (top.displacement_in - position)
        state = step(state, SETUP_A, rig(), displacement_in=back)
        assert share == 0.0 or state.tension_in > outer.tension_in + 1.0
    np.testing.assert_allclose(state.tension, outer.tension, atol=SOLVED)


def test_without_friction_the_tension_is_the_same_all_along():
    state = pretensioned_bars(rig(3.0, 0.0), SETUP_A, 20)
    for position, arcs in ((1e-3, SETUP_A), (0.5e-3, HALF_CIRCLE), (2e-3, STRAIGHT)):
        state = step(state, arcs, rig(3.0, 0.0), displacement_in=position)
        np.testing.assert_allclose(state.tension, state.tension_in, atol=SOLVED)


# --- handing over -------------------------------------------------------------------------------------------


@given(histories, tensions, pieces)
@untimed
def test_it_does_not_matter_when_corners_are_exchanged_for_bars(history, last, random_drive):
    arcs, hardware = arcs_of(random_drive), rig(5.0)
    corners = by_corners(history, hardware)
    late = to_bars(profile.step(corners, last, MU), arcs, hardware, 20)
    early = step(to_bars(corners, arcs, hardware, 20), arcs, hardware, tension_in=last)
    np.testing.assert_allclose(early.tension, late.tension, rtol=1e-9, atol=1e-8)
    assert early.displacement_in - early.displacement_out == pytest.approx(early.elongation, abs=1e-12)


@given(histories, pieces)
@untimed
def test_bars_exchanged_for_corners_and_back_keep_their_tension(history, random_drive):
    arcs, hardware = arcs_of(random_drive), rig(5.0)
    state = driven(history, arcs, hardware, 20)
    back = to_bars(cornered(state, arcs), arcs, hardware, 20)
    # corners on one line are dropped within 1e-9 in ln T; SOLVED where all is slack
    np.testing.assert_allclose(back.tension, state.tension, rtol=1e-7, atol=SOLVED)
    assert cornered(state, arcs).direction_index == state.direction_index


def test_a_full_pull_exchanged_for_corners_is_one_line():
    corners = cornered(driven([15.0], SETUP_A, rig()), SETUP_A)
    np.testing.assert_allclose(corners.angle, [0.0, 3 * PI], rtol=1e-12)
    np.testing.assert_allclose(np.exp(corners.log_tension), [15.0, 15.0 * math.exp(-3 * PI * MU)], rtol=1e-9)
