"""Held-out runs against a part that the fitted runs want."""

from dataclasses import replace

import numpy as np
import pytest

from tssgeom.effects import Backlash, LoadDependentFriction
from tssgeom.identify.fit import base_fit
from tssgeom.identify.machine_evidence import contradicted
from tssgeom.identify.misfit import held_out
from tssgeom.identify.readings import readings


@pytest.fixture(scope="module")
def clean(campaign):
    """The held-out runs of a clean campaign, and the model that is fitted to the others."""
    measured = campaign(4)[0]
    runs, _ = readings(measured)
    _, _, fit = base_fit([run for run in runs if not run.held_out], measured.rig)
    return held_out(runs, measured.rig, fit.at), fit.at


def with_part(at, effect):
    return replace(at, effects=(effect,))


def test_held_out_runs_contradict_a_play_that_is_not_there(clean):
    held, at = clean
    assert held.rise(at, with_part(at, Backlash(width_m=1e-4))) == np.inf


def test_a_part_that_lowers_what_held_out_runs_leave_counts_for_it(clean):
    held, at = clean
    assert held.rise(with_part(at, Backlash(width_m=1e-4)), at) < -10.0


def test_one_channel_that_grows_contradicts_a_part_of_a_machine():
    assert contradicted({"tension_in_N": -50.0, "motor_torque_Nm": 5.4}) == "motor_torque_Nm"
    assert contradicted({"tension_in_N": -1.0, "motor_torque_Nm": 3.8}) == ""


def test_a_part_too_small_to_be_measured_is_not_contradicted(clean):
    held, at = clean
    rises = [held.rise(at, with_part(at, LoadDependentFriction(exponent=size))) for size in (-1e-3, 1e-3)]
    assert max(rises) < 1.96**2  # no contradiction
    assert min(rises) < 0.0  # one of both signs is nearer to the readings
