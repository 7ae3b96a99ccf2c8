"""Estimates of a machine, their intervals, and their warnings."""

from dataclasses import replace

import numpy as np

from tssgeom.identify.machine_estimates import MachineCalibration, MachineEstimate
from tssgeom.identify.machine_held_out import NOTHING_HELD_OUT
from tssgeom.rig import Rig

FRICTION = MachineEstimate(
    "friction.coefficient", "1", 0.1, 0.09, 0.11, True, (0.01, 1.0), "friction.coefficient"
)


def calibration(*others, fitted=1.0):
    channels = {"joint_angle_rad": np.full(3, fitted), "motor_torque_Nm": np.ones(3)}
    return MachineCalibration(
        (FRICTION, *others), FRICTION, (), (), (), NOTHING_HELD_OUT, Rig(), ({},), (), (channels,), ()
    )


def test_a_number_that_is_not_identified_has_a_bound_where_its_interval_leaves_out_what_was_assumed():
    vague = replace(FRICTION, identified=False, middle=0.1)
    assert replace(vague, low=0.12, high=4.0).bounds == (0.12, None)
    assert replace(vague, low=0.001, high=0.05).bounds == (None, 0.05)
    assert replace(vague, low=0.05, high=4.0).bounds == (None, None)
    assert replace(FRICTION, low=0.12, high=0.2, middle=0.1).bounds == (None, None)  # it is identified


def test_a_number_at_its_bound_and_a_channel_that_is_not_finite_fail_the_test_of_a_fit():
    bound = MachineEstimate(
        "end.radius_m", "m", 1.0, 0.9, 1.1, True, (0.0, 1.0), "end.radius_m", at_bound=True
    )
    assert calibration().failures == ()
    assert calibration(bound).failures == ("end.radius_m is at its bound",)
    assert calibration(fitted=np.nan).failures == ("the fitted model is not finite",)


def test_runs_that_identify_no_number_of_the_rig_fail_the_test_of_a_fit():
    unknown = replace(FRICTION, identified=False)
    none = replace(calibration(), estimates=(unknown,), friction_angle=unknown)
    (failure,) = none.failures
    assert "identify no number" in failure
    assert replace(none, tied=("friction and angle show only as a product",)).failures == ()
