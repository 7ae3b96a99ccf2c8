"""The fit of friction and compliance from starts that are wrong, and what clean campaigns reach."""

from dataclasses import replace

import numpy as np
import pytest
from msgspec.structs import replace as changed

from tests.bristle import make_campaign
from tssgeom.identify.assembly import base_estimates
from tssgeom.identify.drive_noise import sampled_drives
from tssgeom.identify.fit import base_fit
from tssgeom.identify.prediction import of_other_directions
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


def test_what_no_point_shows_of_the_form_of_a_route_is_in_the_interval_of_friction(wide_route):
    """A form is 2 % of the angle of the only route, by which friction is off as much the other way."""
    rig, runs = wide_route
    own, with_form = (_spread(form, rig, runs) for form in (0.0, 0.02))
    assert with_form**2 - own**2 == pytest.approx(0.02**2, rel=0.1)


def estimated(problem, fit):
    others = of_other_directions(problem.stack, fit.at.rig(problem.rig), fit.at.effects)
    return base_estimates(problem, fit, others)


def test_intervals_grow_with_what_a_fit_leaves_beyond_noise(wide_route):
    rig, runs = wide_route
    problem, _, fit = base_fit(runs, rig)
    loud = replace(fit, chi2=9.0 * fit.chi2)

    def variance(fit):
        each = estimated(problem, fit)["compliance_per_N"]
        return (np.log(each.high / each.low) / (2.0 * 1.959964)) ** 2

    more = (loud.inflation - fit.inflation) * fit.covariance[1, 1]
    assert loud.inflation > 5.0
    assert variance(loud) - variance(fit) == pytest.approx(more, rel=1e-5)


def _spread(form, rig, runs):
    """Standard deviation of ln μ with a form of so much of the angle of each route."""
    arcs = runs[0].route.arcs
    variance = (form * arcs.total_angle) ** 2
    wider = replace(arcs.with_variances(0.0, variance), form_variance=variance)
    problem, _, fit = base_fit([replace(run, route=replace(run.route, arcs=wider)) for run in runs], rig)
    friction = estimated(problem, fit)["friction"]
    return np.log(friction.high / friction.low) / (2.0 * 1.959964)


def test_a_drive_may_leave_a_hold_on_a_way_that_its_noise_hides():
    noise = 2e-6
    drive = np.maximum(np.arange(40) - 19.0, 0.0) * 1e-5
    ((sample, way),) = sampled_drives(drive, noise, np.arange(40.0)).leaving
    assert sample == 0
    assert np.all(way[:10] == 0.0)
    assert np.all(np.diff(way[10:20]) > 0.0)
    assert noise < way[19] < 3.0 * noise
    assert np.all(way[20:] == 0.0)  # the leg is farther at once


def test_a_slow_way_out_of_a_hold_is_no_misfit(tmp_path):
    make_campaign(tmp_path / "slow", 2004)
    campaign = read_campaign(tmp_path / "slow")
    runs = [run for run in readings(campaign)[0] if not run.held_out]
    problem, _, fit = base_fit(runs, campaign.rig)
    assert fit.chi2 < 1.05 * problem.stack.size  # 1.9 times as much without those ways
