"""Both ends of a tendon of bars, slack, the friction cone, and drives that are refused."""

import math

import numpy as np
import pytest

from tests.tendon.bars import (
    HALF_CIRCLE,
    MU,
    PI,
    SETUP_A,
    SOLVED,
    driven,
    plant_on,
    rig,
)
from tests.tendon.steps import pretensioned_bars, step
from tssgeom.core.constants_tendon_rows import LAW
from tssgeom.effects.kinds import Curve
from tssgeom.errors import SettingsError
from tssgeom.rig import Rig, Tendon


def test_a_dead_weight_keeps_its_tension_and_is_lifted_once_friction_is_overcome():
    state = pretensioned_bars(rig(5.0), HALF_CIRCLE, 30)
    weight = rig(5.0, stiffness=0.0)
    lifted = step(state, HALF_CIRCLE, weight, displacement_in=10e-3)
    assert lifted.tension_out == 5.0
    assert lifted.tension_in == pytest.approx(5.0 * math.exp(PI * MU), rel=1e-9)
    assert lifted.displacement_out == pytest.approx(10e-3 - lifted.elongation, rel=1e-9)
    lowered = step(lifted, HALF_CIRCLE, weight, displacement_in=-10e-3)
    assert lowered.tension_in == pytest.approx(5.0 * math.exp(-PI * MU), rel=1e-9)


@pytest.mark.parametrize("tension_in", [8.0, 3.0])
def test_a_force_that_no_dead_weight_balances_is_refused(tension_in):
    state = pretensioned_bars(rig(5.0), HALF_CIRCLE, 10)
    with pytest.raises(SettingsError, match=r"dead weight of 5 N .* 3\.171 to 7\.885 N; drive by position"):
        step(state, HALF_CIRCLE, rig(5.0, MU, 0.0), tension_in=tension_in)


def test_slack_is_taken_up_before_tension_rises():
    pulled = driven([15.0], HALF_CIRCLE, rig())
    loose = step(pulled, HALF_CIRCLE, rig(), displacement_in=-5e-3)
    assert not loose.tension.any()
    assert loose.slack.sum() == pytest.approx(5e-3, rel=1e-9)
    assert loose.displacement_in == -5e-3
    nearly = step(loose, HALF_CIRCLE, rig(), displacement_in=-1e-6)
    assert not nearly.tension.any()
    assert nearly.slack.sum() == pytest.approx(1e-6, rel=1e-6)
    again = step(nearly, HALF_CIRCLE, rig(), displacement_in=pulled.displacement_in)
    np.testing.assert_allclose(again.tension, pulled.tension, rtol=1e-8)
    assert not again.slack.any()


def test_letting_go_by_force_slackens_the_whole_tendon():
    state = driven([15.0, 0.0], SETUP_A, rig(5.0))
    np.testing.assert_allclose(state.tension, 0.0, atol=SOLVED)
    assert step(state, SETUP_A, rig(5.0), tension_in=4.0).tension_out == pytest.approx(
        4.0 * math.exp(-3 * PI * MU), rel=1e-9
    )


# --- the boundary -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("drive", "message"),
    [
        ({}, "give tension_in .* or displacement_in .*, not both"),
        ({"tension_in": 1.0, "displacement_in": 0.0}, "not both"),
        ({"tension_in": -1.0}, "tension_in is -1 N: .*>= 0 N"),
        ({"tension_in": math.nan}, "tension_in is nan N"),
        ({"displacement_in": math.inf}, "displacement_in is inf m: give a finite position"),
    ],
)
def test_a_step_without_one_possible_drive_is_refused(drive, message):
    with pytest.raises(SettingsError, match=message):
        step(pretensioned_bars(rig(), HALF_CIRCLE), HALF_CIRCLE, rig(), **drive)


def test_a_tendon_that_does_not_stretch_is_refused():
    stiff = Rig(tendon=Tendon(compliance_per_N=0.0))
    with pytest.raises(SettingsError, match=r"tendon\.compliance_per_N is 0 1/N: .* at least 1e-09 1/N"):
        step(pretensioned_bars(stiff, HALF_CIRCLE), HALF_CIRCLE, stiff, tension_in=1.0)


def test_a_step_leaves_the_old_state_as_it_was():
    state = driven([15.0, 10.0], SETUP_A, rig())
    arrays = (state.edge, state.rest, *state.memory)
    before = [array.copy() for array in arrays]
    step(state, HALF_CIRCLE, rig(), tension_in=3.0)
    for array, old in zip(arrays, before, strict=True):
        np.testing.assert_array_equal(array, old)
        assert not array.flags.writeable


@pytest.mark.parametrize(
    ("history", "sign"), [([], 1), ([15.0], 1), ([15.0, 9.0], -1), ([15.0, 9.0, 9.0], -1)]
)
def test_the_direction_index_is_that_of_the_last_movement(history, sign):
    assert driven(history, HALF_CIRCLE, rig()).direction_index == sign


@pytest.mark.parametrize(
    ("table", "bars"),
    [
        ("strain", slice(1, -1)),
        ("stretch_in", slice(1)),
        ("stretch_out", slice(-1, None)),
        ("load_path", slice(-1, None)),
    ],
)
def test_stretch_by_points_lengthens_its_own_part_alone(table, bars):
    state = pretensioned_bars(rig(5.0), HALF_CIRCLE, 6)
    made = plant_on(state, HALF_CIRCLE, curves=(Curve(table, (0.0, 10.0, 30.0), (0.0, 2e-3, 6e-3)),))
    soft, extra = made.rows[LAW.soft], np.zeros(len(state.tension))
    extra[bars] = 3e-3 * (soft[bars] if table == "strain" else 1.0)
    np.testing.assert_allclose(made.stretch(15.0), 15.0 * soft + extra, rtol=1e-12)
