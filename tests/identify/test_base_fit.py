"""The fit of friction and compliance from starts that are wrong, and what clean campaigns reach."""

from dataclasses import replace

import numpy as np
import pytest
from msgspec.structs import replace as changed

from tests.bristle import make_campaign
from tssgeom.identify.fit import base_fit
from tssgeom.identify.readings import readings
from tssgeom.identify.screening import screening, threshold, variants
from tssgeom.io.formats.campaigns import read_campaign
from tssgeom.rig import Friction


@pytest.fixture(scope="module")
def wide_route(tmp_path_factory):
    """A clean campaign whose route has an angle that the readings give better than its shape."""
    folder = tmp_path_factory.mktemp("wide") / "campaign"
    make_campaign(folder, 1108)
    campaign = read_campaign(folder)
    return campaign.rig, [run for run in readings(campaign)[0] if not run.held_out]


@pytest.mark.parametrize("factor", [0.95, 1.0, 1.1])
def test_the_base_fit_does_not_stay_near_a_wrong_start(wide_route, factor):
    rig, runs = wide_route
    wrong = changed(rig, friction=Friction(coefficient=factor * rig.friction.coefficient))
    problem, _, fit = base_fit(runs, wrong)
    assert fit.chi2 < 1.05 * problem.stack.size  # 1.2 to 17 times as much near these starts
    assert abs(fit.at.friction - 0.1705) < 0.001


def test_errors_of_the_drive_that_last_raise_what_clean_campaigns_reach(wide_route):
    rig, runs = wide_route
    problem, errors, fit = base_fit(runs, rig)
    tests = screening(problem, fit, variants(problem.stack)[0])
    column = tests.tests[0].column[: len(errors.sigma)]
    shape = (errors.sigma * column / np.sqrt(np.mean(column**2)))[:, None]
    brief = replace(errors, brief=errors.sigma, lasting=0.0 * shape)
    lasting = replace(errors, brief=0.0 * errors.sigma, lasting=shape)
    assert threshold(problem, lasting, tests, 0) > 10.0 * threshold(problem, brief, tests, 0)
