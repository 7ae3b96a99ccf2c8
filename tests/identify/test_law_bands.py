"""Bands of free laws: their priors, the spread over these, and knots enough for what bends between knots."""

from dataclasses import replace

import numpy as np
import pytest

from tests.bristle import make_campaign
from tests.bristle.bands import band_share
from tssgeom import core
from tssgeom.identify.fit import base_fit
from tssgeom.identify.law_finding import curve
from tssgeom.identify.law_fit import Term, fitted, score, with_bands, with_finest_knots, with_knots
from tssgeom.identify.law_smoothness import law_precision, straight_model
from tssgeom.identify.mechanisms import FINEST, KNOTS, mechanisms
from tssgeom.identify.readings import readings
from tssgeom.io.formats.campaigns import read_campaign


@pytest.fixture(scope="module")
def learnt(tmp_path_factory):
    """Friction with a bump over the path that it slid: its campaign, problem, and the law at few knots."""
    return learned(tmp_path_factory.mktemp("bands") / "runs", 2, "running_in")


def learned(folder, seed, cause):
    """A campaign's truth, its problem, and the law of its mechanism at few knots."""
    truth = make_campaign(folder, seed, cause)
    campaign = read_campaign(folder)
    runs = [run for run in readings(campaign)[0] if not run.held_out]
    problem, _, base = base_fit(runs, campaign.rig)
    start = fitted(problem, base.at, ())
    (law,) = (one for one in mechanisms(problem.stack, problem.rig) if one.name == truth.mechanism)
    return truth, problem, fitted(problem, base.at, (score(problem, start, law).term,))


def share_held(fit, truth):
    law = curve(fit, 0)
    columns = {"x": law.x, "value": law.value, "lo": law.low, "hi": law.high}
    return band_share(columns, truth.law, truth.mechanism)


def test_a_bump_between_knots_is_within_the_band_of_a_law_with_the_finest_knots(learnt):
    truth, problem, few = learnt
    assert share_held(few, truth) < 0.7  # seven knots: half a millimetre of the bump has no knot
    many = with_bands(problem, with_finest_knots(problem, few))
    assert share_held(many, truth) > 0.9
    assert many.log_evidence > few.log_evidence


@pytest.mark.parametrize("name", ["friction_over_travel", "friction_over_speed", "stretch_at_end:proximal"])
def test_a_law_at_finer_knots_is_the_same_curve(learnt, name):
    _, problem, _ = learnt
    few, many = (
        next(one for one in mechanisms(problem.stack, problem.rig, knots) if one.name == name)
        for knots in (KNOTS, FINEST)
    )
    u = np.linspace(0.1, 0.9, few.size) ** 2
    fine = with_knots(Term(few, u, 1.0), many)
    assert len(many.x) == FINEST.usual > len(few.x)
    curve_at = core.tabulated(core.table_of(few.warped, few.value(u)), many.warped)
    np.testing.assert_allclose(many.value(fine.u), curve_at, rtol=2e-2)


@pytest.mark.parametrize("order", [1, 2])
def test_a_prior_is_the_same_with_any_number_of_knots(learnt, order):
    _, problem, _ = learnt
    variances = []
    for knots in (KNOTS, replace(KNOTS, usual=2 * KNOTS.usual - 1)):
        one = next(each for each in mechanisms(problem.stack, problem.rig, knots) if "travel" in each.name)
        covariance = np.linalg.inv(law_precision(one, 1.0, 1e4, order))
        ends = np.zeros(one.size)  # beyond the straight line through the ends
        ends[[0, one.size // 2, -1]] = (-0.5, 1.0, -0.5)
        variances.append(ends @ covariance @ ends)
    assert variances[1] == pytest.approx(variances[0], rel=0.1)


def test_a_step_is_likelier_where_slopes_are_held_and_a_bend_where_bends_are(learnt):
    *_, few = learnt
    one = few.terms[0].mechanism
    step, bend = np.where(one.warped < 0.5, 0.0, 1.0), np.square(one.warped)

    def evidence(values, order):
        model = straight_model(np.eye(one.size) / 0.01, values / 0.01, np.zeros(0))
        return max(model.evidence(law_precision(one, tau, 3.0, order)) for tau in np.geomspace(0.1, 30.0, 30))

    assert evidence(step, 1) > evidence(step, 2)
    assert evidence(bend, 2) > evidence(bend, 1)


def test_the_covariance_over_priors_is_that_of_what_they_make_likely():
    rng = np.random.default_rng(3)
    jacobian, data = rng.normal(size=(20, 2)), rng.normal(size=20)
    model = straight_model(jacobian, data, np.zeros(2))
    priors = [np.diag([0.5, 2.0]), np.diag([20.0, 0.1])]
    assert model.covariance(priors[:1]) == pytest.approx(np.linalg.inv(jacobian.T @ jacobian + priors[0]))
    weight = np.exp([model.evidence(each) for each in priors])
    draws = []
    for share, each in zip(weight / weight.sum(), priors, strict=True):
        inverse = np.linalg.inv(jacobian.T @ jacobian + each)
        draws.append(rng.multivariate_normal(inverse @ model.slope, inverse, int(share * 400_000)))
    likeliest = np.linalg.solve(jacobian.T @ jacobian + priors[int(np.argmax(weight))], model.slope)
    off = np.concatenate(draws) - likeliest
    assert model.covariance(priors) == pytest.approx(off.T @ off / len(off), rel=0.02, abs=1e-3)


def test_a_law_of_creep_is_reported_as_strain_over_the_time_since_a_step(learnt):
    _, problem, _ = learnt
    (one,) = (each for each in mechanisms(problem.stack, problem.rig) if each.name == "strain_over_time")
    u = np.array([1.0, 0.0, 2.0])
    law = one.effect(u)
    expected = sum(
        ratio * -np.expm1(-one.x / time) for ratio, time in zip(law.ratio, law.time_s, strict=True)
    )
    np.testing.assert_allclose(one.value(u), expected, rtol=1e-12)
    assert len(one.x) == KNOTS.reported


@pytest.mark.parametrize(("cause", "seed"), [("power_creep", 304), ("two_time_creep", 303)])
def test_the_band_of_creep_holds_the_compliance_that_grows(tmp_path, cause, seed):
    """Times are not fitted: a band without other times holds little, and creep alone lacks what is fast."""
    truth, problem, few = learned(tmp_path / "runs", seed, cause)
    assert truth.law is not None
    fit = with_bands(problem, with_finest_knots(problem, few))
    law = curve(fit, 0)
    assert (law.over, law.unit) == ("time_s", "1/N")
    true = truth.compliance_per_N * (1.0 + np.interp(law.x, truth.law["x"], truth.law["value"]))
    assert np.mean((law.low <= true) & (true <= law.high)) >= 0.9
    assert np.median(law.high - law.low) < 0.05 * truth.compliance_per_N  # it grows by a fifth
