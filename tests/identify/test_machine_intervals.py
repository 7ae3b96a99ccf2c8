"""Intervals of a machine's numbers, and whether they count as identified."""

import numpy as np

from tssgeom.identify.fit_quality import is_identified
from tssgeom.identify.machine_drive_errors import DriveErrors
from tssgeom.identify.machine_posterior import Posterior, Profile
from tssgeom.statistics import NORMAL_95


def test_a_number_whose_interval_is_wider_than_half_of_what_was_assumed_is_not_identified():
    at = np.arange(-25, 3) / 10.0
    chi2 = np.where(at < -2.0, 7.2, np.where(at < -0.1, 40.0, 0.0))  # 4 % of it lies far away
    one, none = np.eye(1), np.zeros((1, 1))
    posterior = Posterior(
        np.zeros(1),
        0.01 * one,
        DriveErrors(none, 0.01 * one),
        NORMAL_95,
        (Profile(0, at[:, None], chi2),),
    )
    sd, low, high = posterior.of(np.ones(1))
    assert high - low > 0.5 * 2.0 * NORMAL_95
    assert not is_identified(sd)
