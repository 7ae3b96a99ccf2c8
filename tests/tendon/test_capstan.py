"""Tension along the tendon after any history on a fixed route."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tssgeom.errors import SettingsError
from tssgeom.rig import Rig, Tendon
from tssgeom.tendon.capstan import MAX_CORNERS, pretensioned, step, tension

MU = 0.145  # the paper's tendon and sheath, section III-B
PHI = np.linspace(0.0, 12.0, 241)  # almost two turns, past the longest route of the paper (3π)

# ln T carries a rounding of 1e-15 for each step; a corner that a front passes closer than 1e-12 is taken as
# met. A history of 30 steps therefore stays well below 1e-10 in ln T, which is the relative error of T.
RELATIVE = 1e-10

tensions = st.one_of(st.just(0.0), st.floats(0.01, 30.0))
histories = st.lists(tensions, max_size=30)
frictions = st.one_of(st.just(0.0), st.floats(0.001, 1.0))
untimed = settings(deadline=None)  # the first example compiles the kernel


def rig(pretension=0.0):
    return Rig(tendon=Tendon(pretension_N=pretension))


def driven(history, pretension=0.0, friction=MU):
    state = pretensioned(rig(pretension))
    for tension_in in history:
        state = step(state, tension_in, friction)
    return state


def log(value):
    return math.log(value) if value > 0 else -math.inf


def clipped_on_grid(history, pretension, friction):
    """The slow twin: clip the whole profile on a grid of φ (docs/model.md, eq. 3)."""
    u = np.full_like(PHI, log(pretension))
    for tension_in in history:
        u = np.clip(u, log(tension_in) - friction * PHI, log(tension_in) + friction * PHI)
    return np.exp(u)


def same_tension(state, expected):
    np.testing.assert_allclose(tension(state, PHI), expected, rtol=RELATIVE, atol=1e-300)


def test_before_the_first_pull_the_pretension_stands_all_along():
    same_tension(driven([], pretension=5.0), np.full_like(PHI, 5.0))


def test_first_pull_falls_by_the_capstan_law_down_to_the_pretension():
    """Paper eqs. (6) and (7), which hold on the first pull."""
    same_tension(driven([15.0], pretension=5.0), np.maximum(15.0 * np.exp(-MU * PHI), 5.0))


def test_without_pretension_the_first_pull_reaches_any_angle():
    far = np.array([0.0, 1.0, 100.0, 1000.0])
    np.testing.assert_allclose(tension(driven([15.0]), far), 15.0 * np.exp(-MU * far), rtol=RELATIVE)


def test_release_after_a_pull_turns_the_profile_up_to_half_the_log_ratio_over_friction():
    meeting = math.log(15.0 / 10.0) / (2 * MU)
    expected = np.where(meeting > PHI, 10.0 * np.exp(MU * PHI), 15.0 * np.exp(-MU * PHI))
    same_tension(driven([15.0, 10.0]), expected)


def test_tension_below_the_pretension_rises_back_to_it():
    same_tension(driven([2.0], pretension=5.0), np.minimum(2.0 * np.exp(MU * PHI), 5.0))


@pytest.mark.parametrize("history", [[0.0], [15.0, 0.0], [15.0, 3.0, 8.0, 0.0]])
def test_letting_go_slackens_the_whole_tendon(history):
    assert not tension(driven(history, pretension=5.0), PHI).any()


def test_a_slack_tendon_forgets_its_history():
    state = driven([15.0, 3.0, 8.0, 0.0, 4.0], pretension=5.0)
    same_tension(state, 4.0 * np.exp(-MU * PHI))
    assert len(state.angle) == len(driven([4.0]).angle)


@given(histories.filter(len))
@untimed
def test_without_friction_the_tension_is_the_same_all_along(history):
    same_tension(driven(history, pretension=5.0, friction=0.0), np.full_like(PHI, history[-1]))


@pytest.mark.parametrize(("history", "direction"), [([15.0], 1), ([15.0, 10.0], -1), ([], 1)])
def test_equal_tension_holds_state_and_direction(history, direction):
    state = driven(history, pretension=5.0)
    held = step(state, history[-1] if history else 5.0, MU)
    assert held is state
    assert held.direction_index == direction


@pytest.mark.parametrize("tension_in", [0.1, 5.0, 10.0, 29.7])
def test_tension_read_back_from_the_state_holds_it(tension_in):
    """The logarithm and its inverse round; that is no motion."""
    state = driven([15.0, tension_in], pretension=5.0)
    assert step(state, float(tension(state, np.zeros(1))[0]), MU) is state


@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_impossible_tension_is_refused_with_value_unit_and_hint(value):
    with pytest.raises(SettingsError, match=rf"{value:g} N: .*give a finite total tension >= 0 N"):
        step(driven([]), value, MU)


def test_a_step_leaves_the_old_state_as_it_was():
    state = driven([15.0, 10.0])
    before = tension(state, PHI)
    step(state, 20.0, MU)
    np.testing.assert_array_equal(tension(state, PHI), before)
    assert not state.angle.flags.writeable
    assert not state.log_tension.flags.writeable


@given(histories, tensions, frictions)
@untimed
def test_corner_list_equals_clipping_the_whole_profile(history, pretension, friction):
    """docs/model.md (3): the corner list is the exact play operator, not an approximation of it."""
    same_tension(driven(history, pretension, friction), clipped_on_grid(history, pretension, friction))


@given(histories, tensions, st.floats(0.001, 1.0))
@untimed
def test_friction_bounds_the_slope_of_log_tension(history, pretension, friction):
    state = driven(history, pretension, friction)
    rise, run = np.diff(state.log_tension), np.diff(state.angle)
    # A corner that was met within 1e-12 in ln T may stand that much off its line.
    assert np.all(np.abs(rise) <= friction * run * (1 + 1e-12) + 1e-12)
    assert np.all(run >= 0)


@example([0.0, 0.625], [0.0], 1.0)
@given(histories, st.lists(st.floats(0.0, 1.0), min_size=1, max_size=12), st.floats(0.01, 30.0))
@untimed
def test_a_closed_inner_loop_is_forgotten(history, excursion, rise):
    """Return-point memory: the loop stays between the last turning point and the tension it returns to."""
    low = [*history, 1.0]
    top = low[-1] + rise
    inside = [1.0 + share * rise for share in excursion]
    once = driven([*low, top], pretension=5.0)
    again = driven([*low, top, *inside, top], pretension=5.0)
    np.testing.assert_allclose(tension(again, PHI), tension(once, PHI), rtol=RELATIVE)
    # the return may end a rounding short of the corner, which then stays on a straight line: one at most
    assert len(again.angle) <= len(once.angle) + 1
    for _ in range(3):
        again = step(step(again, 1.0, MU), top, MU)
    assert len(again.angle) <= len(once.angle) + 1


@given(histories, st.floats(0.0, 30.0), st.integers(2, 40))
@untimed
def test_subdividing_a_monotone_drive_changes_nothing(history, target, parts):
    """Rate independence: only where the tension turns matters."""
    start = history[-1] if history else 5.0
    path = [*(start + (target - start) * np.arange(1, parts) / parts), target]
    at_once = driven([*history, target], pretension=5.0)
    in_parts = driven([*history, *path], pretension=5.0)
    same_tension(in_parts, tension(at_once, PHI))
    assert len(in_parts.angle) == len(at_once.angle)


@given(histories.filter(len), st.floats(0.1, 10.0))
@untimed
def test_scaling_every_tension_scales_the_profile(history, factor):
    scaled = driven([factor * value for value in history], pretension=factor * 5.0)
    same_tension(scaled, factor * tension(driven(history, pretension=5.0), PHI))


def test_many_cycles_leave_the_rest_of_the_tendon_bit_for_bit():
    far = np.array([100.0])
    cycled = driven([15.0, 2.0] * 500, pretension=5.0)
    assert tension(cycled, far)[0] == tension(driven([], pretension=5.0), far)[0]


def test_a_larger_pull_wipes_out_all_inner_loops():
    state = driven([15.0, 5.0, 12.0, 7.0, 10.0, 8.0, 20.0])
    assert len(state.angle) == len(driven([20.0]).angle)
    same_tension(state, 20.0 * np.exp(-MU * PHI))


def test_noise_on_a_held_tension_keeps_the_corner_list_short():
    noise = np.random.default_rng(1).normal(0.0, 0.02, 20_000)
    # The loops left open by n random values are their nested records: about 2 ln n = 20 on average.
    assert len(driven(10.0 + noise).angle) < 60


def test_a_ringing_that_never_closes_a_loop_keeps_the_corner_list_bounded():
    ring = 10.0 + 5.0 * np.linspace(1.0, 0.0, 4000) * (-1.0) ** np.arange(4000)
    state = driven(ring)
    assert len(state.angle) <= MAX_CORNERS
    # Half the log ratio, ln(15/5)/2 = 0.55, is spread over 512 corners, 0.0011 between two of them. Thinning
    # goes where corners stand closest; up to four such spacings remain between two, hence errors up to half.
    error = np.log(tension(state, PHI) / clipped_on_grid(ring, 0.0, MU))
    assert np.max(np.abs(error)) < 0.0022
