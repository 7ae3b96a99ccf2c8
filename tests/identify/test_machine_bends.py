"""How far the numbers of a machine may go along the valley that bends leave open, and steps along it."""

import numpy as np
import pytest
from msgspec.structs import replace

from tests.identify.test_machine_even_bend import KEYS, RIG, calibrated
from tssgeom.identify.machine_bend_steps import BendSteps, Pull
from tssgeom.identify.machine_bends import BEND_FITS, TWO_95, Spot, Valley, unlike
from tssgeom.identify.machine_parameters import one_bend, parameters_of, shares_of, with_unknown_bends
from tssgeom.identify.machine_posterior import _wide
from tssgeom.identify.machine_problem import Problem, fitted_rows
from tssgeom.rig import with_values
from tssgeom.uncertain import UNKNOWNS, Prior, Uncertain

NOISE = 3.5e-4


@pytest.fixture(scope="module")
def steps():
    runs = calibrated(stated=False).runs
    uncertain = [Uncertain(key, UNKNOWNS[key], stated=False) for key in KEYS]
    blind = replace(RIG, route=replace(RIG.route, bends=()))
    about = with_values(blind, {key: UNKNOWNS[key].centre for key in KEYS})
    rig, uncertain = with_unknown_bends(runs, about, uncertain)
    given = Problem(runs, rig, tuple(parameters_of(runs, rig, uncertain)), fitted_rows(runs, None), 16)
    return BendSteps(given, np.full(sum(len(at) for _, _, at in given.rows), 1.0 / NOISE), given.steps())


def test_an_interval_reaches_as_far_as_any_point_below_the_rise_of_chi_square_lets_it():
    near = Spot(np.array([0.0]), np.array([[0.04]]), 0.0)
    along = Spot(np.array([1.0]), np.array([[0.01]]), TWO_95 - 1.0)
    beyond = Spot(np.array([9.0]), np.array([[1.0]]), TWO_95 + 0.1)
    low, high = Valley((near, along, beyond)).ends(np.ones(1), 1.959964)
    assert (low, high) == pytest.approx((-0.2 * TWO_95**0.5, 1.1), abs=1e-5)


@pytest.mark.parametrize("seed", range(10))
def test_the_numbers_that_are_followed_are_known_least_and_none_goes_with_a_wider_one(seed):
    rng = np.random.default_rng(seed)
    root, unit = rng.normal(size=(8, 8)), 10.0 ** rng.uniform(-2.0, 2.0, 8)
    covariance, among = root @ root.T, [0, 1, 2, 4, 5, 7]
    width = unit * np.sqrt(np.diag(covariance))
    correlation = np.abs(covariance) * np.outer(unit, unit) / np.outer(width, width)
    taken = unlike(covariance, sorted(among, key=lambda j: -width[j]), 3)
    assert taken == sorted(taken, key=lambda j: -width[j])
    assert np.all(correlation[np.ix_(taken, taken)][np.triu_indices(len(taken), 1)] < BEND_FITS.alike)
    for j in {*among} - {*taken}:
        wider = [k for k in taken if width[k] > width[j]]
        assert len(wider) == 3 or correlation[j, wider].max() >= BEND_FITS.alike


def test_friction_of_each_part_goes_straight_along_a_step(steps):
    given = steps.problem.parameters
    own, k = shares_of(given), [each.key for each in given].index("friction.coefficient")
    rng = np.random.default_rng(3)
    u, step = 0.3 * rng.standard_normal((2, len(given)))
    step *= 0.2

    def of_parts(u):
        weights = np.array([given[j].value(u[j]) for j in own])
        return given[k].value(u[k]) * weights / weights.sum()

    moved, little = of_parts(steps.moved(u, step)), of_parts(u + 1e-6 * step)
    assert moved == pytest.approx(of_parts(u) + 1e6 * (little - of_parts(u)), rel=1e-4)


def test_only_numbers_of_the_rig_that_are_wide_on_a_logarithmic_scale_have_their_posterior_tested(steps):
    for j, each in enumerate(steps.problem.parameters):
        sd = np.where(np.arange(len(steps.problem.parameters)) == j, 10.0, 1e-9) / each.prior.sd
        tested = each.kind == "rig" and each.prior.log
        assert _wide(steps.problem, np.diag(sd**2)) == [j] * tested


def test_a_derivative_at_the_bound_of_a_machine_is_taken_on_the_side_that_it_allows():
    runs = calibrated(stated=False).runs
    play = Uncertain("drive.play_rad", Prior(0.0, 0.01, log=False), stated=True)
    given = Problem(runs, RIG, tuple(parameters_of(runs, RIG, [play])), fitted_rows(runs, None), 16)
    k, u = [each.key for each in given.parameters].index(play.key), np.zeros(len(given.parameters))
    for step in (-0.5, 0.5):  # there is no play below zero
        way, moved, _ = given._moved(u, k, step, given.machines(u))
        assert way == moved[k] == 0.5


def test_a_fit_goes_down_and_a_pull_moves_its_number(steps):
    u = one_bend(steps.problem.parameters, np.zeros(len(steps.problem.parameters)), 0.4)
    start = steps.passed(steps.at(u))
    chi2 = [each.point.chi2 for each in steps.fit(start, start.point.chi2, passes=3)]
    assert len(chi2) > 1
    assert np.all(np.diff([start.point.chi2, *chi2]) < 0.0)
    to = Pull(0, float(u[0]) + 0.5, 1e-4)
    *_, end = steps.fit(start, start.point.chi2, passes=3, pull=to)
    assert abs(end.point.u[0] - to.to) < 0.25


def test_one_bend_has_most_of_the_angle_where_it_is(steps):
    given = steps.problem.parameters
    u = one_bend(given, np.zeros(len(given)), 0.25)
    weights = np.array([given[j].value(u[j]) for j in shares_of(given)])
    assert weights[2:6].sum() > 0.75 * weights.sum()
    assert np.all(one_bend(given, u, None)[shares_of(given)] == 0.0)
