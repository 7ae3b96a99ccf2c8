"""Free laws: priors and evidence beside plain Gaussian arithmetic, their order, what one run holds out."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from tests.bristle import make_campaign as make_bristle_campaign
from tests.bristle.laws import STEP
from tssgeom.effects import ChannelLag, CreepLaw, FrictionLaw, SensorLaw, StretchLaw
from tssgeom.identify.fit import Point, base_fit
from tssgeom.identify.law_finding import curve
from tssgeom.identify.law_fit import LAW_FIT, Added, Term, fitted, score, with_terms
from tssgeom.identify.law_search import Offer, in_order
from tssgeom.identify.law_smoothness import law_precision, straight_model
from tssgeom.identify.mechanisms import mechanisms
from tssgeom.identify.prediction import of_other_directions
from tssgeom.identify.readings import readings
from tssgeom.identify.rig_errors import of_fit
from tssgeom.identify.workflow import discover
from tssgeom.io.formats.campaigns import read_campaign
from tssgeom.least_squares import SOLVER


@pytest.fixture(scope="module")
def problem(campaign):
    runs, _ = readings(campaign(1, "rough_stretch")[0])
    return base_fit([run for run in runs if not run.held_out], campaign(1, "rough_stretch")[0].rig)


def named(problem, name):
    return next(one for one in mechanisms(problem.stack, problem.rig) if one.name == name)


def test_every_mechanism_begins_at_the_base_model(problem):
    given, _, base = problem
    kinds = set()
    for one in mechanisms(given.stack, given.rig):
        at = with_terms(base.at, [Term(one, np.zeros(one.size), 1.0)])
        kinds.add(type(at.effects[-1]))
        # a curve at an end that gave nothing gives a little: 1e-9 m/N
        np.testing.assert_allclose(given.left(at), base.left, atol=2e-4)
    assert kinds == {FrictionLaw, StretchLaw, CreepLaw, SensorLaw, ChannelLag}


def test_the_prior_of_a_law_leaves_straight_lines_free(problem):
    one = named(problem[0], "friction_over_tension")
    line, wave = one.warped - 0.5, np.cos(3.0 * np.pi * one.warped)
    stiff, level = law_precision(one, 0.1, LAW_FIT.level), np.eye(one.size) / LAW_FIT.level**2
    assert line @ (stiff - level) @ line == pytest.approx(0.0, abs=1e-9)
    assert wave @ (stiff - level) @ wave > 1e3


def test_the_evidence_is_that_of_gaussian_readings():
    rng = np.random.default_rng(1)
    jacobian, precision = rng.normal(size=(30, 4)), np.diag([1.0, 4.0, 9.0, 2.0])
    data = rng.normal(size=30)
    joint = multivariate_normal(np.zeros(30), np.eye(30) + jacobian @ np.linalg.inv(precision) @ jacobian.T)
    alone = multivariate_normal(np.zeros(30), np.eye(30))
    model = straight_model(jacobian, data, np.zeros(4))
    gain = model.evidence(precision) + 0.5 * float(data @ data)
    assert gain == pytest.approx(joint.logpdf(data) - alone.logpdf(data), rel=1e-9)


def test_a_law_is_fitted_with_a_band_that_holds_the_truth(problem, campaign):
    given, _, base = problem
    truth = campaign(1, "rough_stretch")[1]
    start = fitted(given, base.at, ())
    one = named(given, "friction_over_arc_length")
    promised, term, _ = score(given, start, one)
    fit = fitted(given, base.at, (term,))
    gain = 2.0 * (fit.log_evidence - start.log_evidence)
    assert gain > 1e4
    assert promised > 0.3 * gain
    assert fit.chi2 < 1.1 * given.stack.size
    law = curve(fit, 0)
    smooth = law.x < 0.3 * truth.length_m  # before any edge of the stretch
    assert np.mean((law.low <= truth.friction) & (truth.friction <= law.high), where=smooth) > 0.9


def test_a_first_fit_of_a_law_takes_the_derivatives_that_are_known(problem):
    given, _, base = problem
    start = fitted(given, base.at, ())
    promised = score(given, start, named(given, "friction_over_arc_length"))
    runs = []

    def predict(at):
        runs.append(at)
        return given.target - given.left(at)

    counted = replace(given, predict=predict)
    before, size = start.jacobian, promised.term.mechanism.size
    added = Added(before, before.shape[1], promised.columns)
    gains, evaluations = [], []
    for shared in (None, added):
        runs.clear()
        fit = fitted(counted, base.at, (promised.term,), SOLVER.quick, shared)
        gains.append(fit.log_evidence - start.log_evidence)
        evaluations.append(len(runs))
    assert evaluations[0] - evaluations[1] >= size + 2 * before.shape[1]
    assert gains[1] == pytest.approx(gains[0], rel=0.3)  # neither has converged; it ranks candidates


def test_what_a_part_does_for_held_out_runs_counts_like_what_it_does_for_fitted_ones(problem):
    given, _, base = problem
    model = fitted(given, base.at, ())

    def offer(mechanism, gain, rise, name="", veto=""):
        return Offer(mechanism, name, model, gain, rise, veto)

    best, other, far = offer("a", 1000.0, 0.0), offer("b", 900.0, -200.0), offer("c", 500.0, 100.0)
    refused = offer("d", 2000.0, np.inf, veto="the held-out runs contradict it")
    result = in_order([best, other, far, refused])
    assert [one.mechanism for one in result] == ["b", "d", "a", "c"]
    assert not result[0].veto
    assert all(one.veto for one in result[1:])
    near = offer("e", other.evidence - 0.9 * other.separable, 0.0, "formula")
    assert in_order([other, near])[0] is near  # a law is not clearly better than this formula
    worse = offer("e", other.evidence - 1.1 * other.separable, 0.0, "formula")
    assert in_order([other, worse])[0] is other


def of_bristles(folder, cause, seed):
    """A campaign of the second generator, and what `discover` finds."""
    make_bristle_campaign(folder, seed, cause)
    return discover(read_campaign(folder))


def test_friction_that_falls_with_speed_is_a_law_with_a_memory(tmp_path):
    finding = of_bristles(tmp_path / "runs", "stribeck", 101)
    (one,) = finding.effects
    assert (finding.verdict, one.names) == ("law", ("friction_over_speed",))
    (law,) = finding.rig.effects
    assert law.memory_s == pytest.approx(STEP.memory_s, rel=0.25)


def test_contacts_that_slide_one_after_the_other_are_presliding_by_dahls_law(tmp_path):
    finding = of_bristles(tmp_path / "runs", "presliding", 100)
    (one,) = finding.effects
    assert (finding.verdict, one.names) == ("effect", ("presliding",))
    (effect,) = finding.rig.effects
    assert effect.law == "dahl"
    assert effect.distance_m == pytest.approx(0.2e-3, rel=0.05)


def test_a_single_run_holds_out_its_last_cycles(campaign):
    whole = campaign(4)[0]
    time = np.linspace(0.0, 60.0, 600)
    one = replace(whole.runs[0], held_out=False)
    pull = 2e-3 * (1.0 - np.cos(2.0 * np.pi * time / 10.0))
    columns = {"time_s": time, "displacement_in_m": pull, "tension_in_N": 5.0 + 2e3 * pull}
    single = replace(whole, runs=(replace(one, columns=columns),))
    fitting, held = readings(single)[0]
    assert (fitting.held_out, held.held_out) == (False, True)
    there = np.isfinite(fitting.measured["tension_in_N"])
    assert time[there].max() == pytest.approx(40.0, abs=0.6)  # six cycles, two of them held out
    assert np.isfinite(held.measured["tension_in_N"])[1:].sum() == np.count_nonzero(~there)
    assert "cycles 5 to 6" in readings(single)[1][-1]
    short = replace(one, columns={name: values[:150] for name, values in columns.items()})
    assert [run.held_out for run in readings(replace(whole, runs=(short,)))[0]] == [False]
    assert "nothing is held out" in readings(replace(whole, runs=(short,)))[1][-1]


def test_a_point_keeps_its_named_part(problem):
    one = named(problem[0], "friction_over_time")
    at = with_terms(Point(0.2, 1e-4), [Term(one, np.full(one.size, 0.1), 1.0)])
    assert at.friction == 0.2
    assert at.effects[-1].factor == pytest.approx(np.exp(0.1) * np.ones(one.size))


@pytest.mark.parametrize("end", ["proximal", "distal"])
def test_a_stretch_outside_the_sheath_can_begin_to_rise_at_every_knot(problem, end):
    given, _, base = problem
    one = named(given, f"stretch_at_end:{end}")
    for u in 1e-2 * np.eye(one.size):  # a fall at any tension would be refused
        assert np.all(np.diff(one.effect(u).stretch) >= 0.0)
        assert np.any(given.left(replace(base.at, effects=(one.effect(u),))) != base.left)


def test_steps_of_a_rising_law_have_the_prior_of_the_law_itself(problem):
    given, _, _ = problem
    one = named(given, "stretch_at_end:proximal")
    steps = np.random.default_rng(1).uniform(size=one.size)
    rough = law_precision(one, 0.3, np.inf)
    itself = law_precision(replace(one, rising=False), 0.3, np.inf)
    assert steps @ rough @ steps == pytest.approx(np.cumsum(steps) @ itself @ np.cumsum(steps))


def test_a_rig_has_the_errors_of_a_law_at_its_knots(problem):
    given, _, base = problem
    _, term, _ = score(given, fitted(given, base.at, ()), named(given, "friction_over_arc_length"))
    fit = fitted(given, base.at, (term,))
    errors = of_fit(given, fit, of_other_directions(given.stack, fit.point.rig(given.rig), fit.point.effects))
    factor = np.array(fit.point.effects[0].factor)
    own = {key: sd for key, sd in zip(errors.keys, errors.sd, strict=True) if key.startswith("effects")}
    assert list(own) == [f"effects[0].factor[{k}]" for k in range(len(factor))]
    # routes may be turned more or less than sensed: that only adds
    least = factor * fit.spread(0) * np.sqrt(fit.inflation)
    assert np.all(np.array([*own.values()]) >= 0.999 * least)
    assert np.median([*own.values()] / least) < 1.5
