"""The solver of iterated fits: exact where lines suffice, and at bounds, outliers and missing equilibria."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from tssgeom.least_squares import SOLVER, Problem, derivatives, search, solve

RNG = np.random.default_rng(7)
SLOPE, DATA = RNG.normal(size=(40, 3)), RNG.normal(size=40)
FREE = np.full(3, np.inf)


def line(u):
    return DATA - SLOPE @ u, "line"


def decay(u):
    time = np.linspace(0.0, 3.0, 40)
    return np.exp(-1.3 * time) * 2.0 - u[0] * np.exp(-u[1] * time), None


def test_a_line_with_a_prior_is_fitted_exactly():
    precision = np.diag([1.0, 4.0, 9.0])
    fit = solve(Problem(line, precision, -FREE, FREE, centre=0.5), np.zeros(3))
    normal = SLOPE.T @ SLOPE + precision
    exact = np.linalg.solve(normal, SLOPE.T @ DATA + precision @ np.full(3, 0.5))
    assert fit.u == pytest.approx(exact, abs=1e-4)  # the fall of χ² ends it, not the step
    assert fit.covariance == pytest.approx(np.linalg.inv(normal), rel=1e-6)
    assert fit.converged
    assert fit.detail == "line"


def test_a_bound_holds_one_number_and_the_others_are_those_of_scipy():
    upper = np.array([np.inf, 0.01, np.inf])
    fit = solve(Problem(line, np.zeros((3, 3)), -FREE, upper), np.zeros(3))
    reference = least_squares(lambda u: line(u)[0], np.zeros(3), bounds=(-FREE, upper))
    assert fit.at_bound.tolist() == [False, bool(reference.active_mask[1]), False]
    assert fit.u == pytest.approx(reference.x, abs=2e-3)
    assert fit.chi2 == pytest.approx(2.0 * reference.cost, abs=1e-4)


def test_a_curve_takes_fewer_derivatives_than_scipy():
    start, free = np.array([0.5, 0.2]), np.full(2, np.inf)
    given = Problem(lambda u: (1e3 * decay(u)[0], None), np.zeros((2, 2)), -free, free)
    fit = solve(given, start)
    reference = least_squares(lambda u: 1e3 * decay(u)[0], start, ftol=SOLVER.converged)
    assert fit.u == pytest.approx([2.0, 1.3], abs=1e-3)
    assert fit.passes < reference.njev


def test_outliers_count_as_in_the_loss_of_huber():
    data = DATA.copy()
    data[:4] += 30.0
    fit = solve(
        Problem(lambda u: (data - SLOPE @ u, None), np.zeros((3, 3)), -FREE, FREE, huber=1.5), np.zeros(3)
    )
    reference = least_squares(lambda u: data - SLOPE @ u, np.zeros(3), loss="huber", f_scale=1.5)
    assert fit.chi2 == pytest.approx(2.0 * reference.cost, abs=SOLVER.converged)


def test_a_step_to_where_there_is_no_equilibrium_is_shortened():
    exact = np.linalg.lstsq(SLOPE, DATA, rcond=None)[0]
    given = Problem(lambda u: line(u) if u @ u < 1.1 * exact @ exact else None, np.zeros((3, 3)), -FREE, FREE)
    assert solve(given, -0.9 * exact).u == pytest.approx(exact, abs=2e-2)
    assert solve(given, 2.0 * exact) is None


def test_derivatives_go_backwards_at_a_bound_and_vanish_without_equilibria():
    positions = []

    def model(u):
        positions.append(u.copy())
        return None if u[1] != 0.0 else line(u)

    slope = derivatives(Problem(model, np.eye(3), -FREE, np.zeros(3)), np.zeros(3), DATA)
    assert slope[:, [0, 2]] == pytest.approx(-SLOPE[:, [0, 2]], abs=1e-9)
    assert np.all(slope[:, 1] == 0.0)
    assert positions[0][0] < 0.0


def test_a_search_yields_before_each_evaluation():
    count = []

    def model(u):
        count.append(1)
        return line(u)

    work, yields = search(Problem(model, np.eye(3), -FREE, FREE), np.zeros(3)), 0
    for _ in work:
        assert len(count) == yields
        yields += 1
    assert len(count) == yields


def test_without_passes_nothing_moves():
    fit = solve(Problem(line, np.eye(3), -FREE, FREE), np.ones(3), passes=0)
    assert fit.u.tolist() == [1.0, 1.0, 1.0]
    assert fit.jacobian == pytest.approx(-SLOPE, abs=1e-9)


def test_a_bent_ridge_is_followed_to_its_lowest_point():
    def bent(u):  # a valley along u[1] = u[0]², 1000 times as steep across as along, lowest at 1
        return np.array([1e3 * (u[1] - u[0] ** 2), 1.0 * (u[0] - 1.0)]), None

    start, free = np.array([-2.0, 4.0]), np.full(2, np.inf)
    given = Problem(bent, np.zeros((2, 2)), -free, free, step=1e-6)
    assert solve(replace(given, along_ridges=True), start).u == pytest.approx([1.0, 1.0], abs=0.3)
    assert np.abs(solve(given, start).u - 1.0).max() > 1.0  # damped steps end where they become short


def test_along_a_ridge_a_fit_begins_with_the_share_before_the_last_one_that_helped():
    free = np.full(1, np.inf)
    flat_beyond = Problem(lambda u: (np.arctan(u), None), np.zeros((1, 1)), -free, free, step=1e-6)
    fit = solve(replace(flat_beyond, along_ridges=True), np.array([8.0]))  # a whole step goes to −86
    assert fit.u == pytest.approx([0.0], abs=0.01)
    assert fit.evaluations <= 15  # 21 where each pass begins with the whole step
