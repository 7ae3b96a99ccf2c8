"""The state-space smoother against the same statistics written as dense linear algebra."""

import numpy as np
import pytest

from tssgeom.shape.smoother import best_ratio, innovations, smooth

_X, _W = np.polynomial.legendre.leggauss(5)  # exact for the quartics below


def _wander(s: float, a: int, t: float, b: int) -> float:
    """Covariance of derivative a at s and derivative b at t of thrice integrated white noise from 0."""
    top = min(s, t)
    x = 0.5 * top * (_X + 1.0)
    power = (s - x) ** (2 - a) * (t - x) ** (2 - b)
    return 0.5 * top * float(_W @ power) / [2, 1, 1][a] / [2, 1, 1][b]


def _parabola(t: float, order: int) -> list[float]:
    return [[1.0, t, 0.5 * t * t], [0.0, 1.0, t], [0.0, 0.0, 1.0]][order]


def _dense(u, y, noise, order):
    """Universal kriging: mean [n, 3] and variance [n] of a derivative, and -2 ln restricted likelihood."""
    n = len(u)
    k = np.array([[_wander(s, 0, t, 0) for t in u] for s in u]) + np.diag(noise)
    h = np.array([_parabola(t, 0) for t in u])
    k_inv = np.linalg.inv(k)
    grams = h.T @ k_inv @ h
    beta = np.linalg.solve(grams, h.T @ k_inv @ y)
    mean, variance = np.empty((n, 3)), np.empty(n)
    for i, t in enumerate(u):
        c = np.array([_wander(t, order, s, 0) for s in u])
        rest = np.array(_parabola(t, order)) - h.T @ k_inv @ c
        mean[i] = np.array(_parabola(t, order)) @ beta + c @ k_inv @ (y - h @ beta)
        variance[i] = _wander(t, order, t, order) - c @ k_inv @ c + rest @ np.linalg.solve(grams, rest)
    r = y - h @ beta
    fit = np.einsum("ic,ij,jc->", r, k_inv, r)
    return mean, variance, 3 * (np.linalg.slogdet(k)[1] + np.linalg.slogdet(grams)[1]), fit


@pytest.fixture
def uneven():
    rng = np.random.default_rng(3)
    u = np.cumsum(rng.uniform(0.4, 1.8, 14)) - 1.0
    return u - u[0], rng.normal(size=(14, 3)) + np.outer(u, [1.0, 0.2, -0.3])


@pytest.mark.parametrize("ratio", [1e-2, 1.0, 1e3])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_posterior_is_that_of_universal_kriging(uneven, ratio, order):
    u, y = uneven
    weight = np.ones(14)
    weight[5] = 0.5
    mean, covariance, _ = smooth(u, y, weight, np.zeros(14), ratio)
    expected, variance, _, _ = _dense(u, y, ratio / weight, order)
    # the vague prior of the filter is 1e4 times wider than three points' own error: a part in 1e4 at most
    np.testing.assert_allclose(mean[:, :, order], expected, rtol=2e-4, atol=2e-4 * np.abs(expected).max())
    np.testing.assert_allclose(covariance[:, [0, 3, 5][order]], variance, rtol=1e-3)


def test_likelihood_is_the_restricted_one_up_to_a_constant(uneven):
    u, y = uneven
    constant = []
    for ratio in (1e-2, 1.0, 1e2):
        log_s, squares, n = innovations(
            u, y, np.ones(14), np.zeros(14), np.zeros((14, 3)), False, ratio, np.empty((0, 3))
        )
        _, _, log_k, fit = _dense(u, y, np.full(14, ratio), 0)
        assert n == 11  # three coordinates' worth of position, direction and curvature are unknown
        assert squares == pytest.approx(fit, rel=2e-3)
        constant.append(log_k - 3 * log_s)
    assert np.ptp(constant) < 0.02  # of values near 50


def test_unseen_stations_change_nothing_elsewhere(uneven):
    u, y = uneven
    with_hole = np.insert(u, 7, 0.5 * (u[6] + u[7]))
    stray = np.insert(y, 7, 1e3, axis=0)
    weight = np.insert(np.ones(14), 7, 0.0)
    mean, covariance, _ = smooth(u, y, np.ones(14), np.zeros(14), 1.0)
    more, wider, _ = smooth(with_hole, stray, weight, np.zeros(15), 1.0)
    keep = np.arange(15) != 7
    np.testing.assert_allclose(more[keep], mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(wider[keep], covariance, rtol=1e-9)


def test_gain_gives_the_covariance_of_neighbours(uneven):
    """Smoothing one noiseless observation more shifts neighbours as their covariance says."""
    u, y = uneven
    _, covariance, gain = smooth(u, y, np.ones(14), np.zeros(14), 1.0)
    i, push = 6, 1e-4
    shifted = y.copy()
    shifted[i + 1] += push
    base, _, _ = smooth(u, y, np.ones(14), np.zeros(14), 1.0)
    moved, _, _ = smooth(u, shifted, np.ones(14), np.zeros(14), 1.0)
    c = covariance[i + 1]
    cross = gain[i] @ np.array([[c[0], c[1], c[2]], [c[1], c[3], c[4]], [c[2], c[4], c[5]]])
    # pushing an observation of unit noise variance moves state i by its covariance with that position
    np.testing.assert_allclose((moved - base)[i, 0] / push, cross[:, 0], rtol=1e-5, atol=1e-8)


def test_a_circle_costs_nothing_once_the_prior_bends_with_it():
    u = np.arange(40.0)
    k = 0.1
    y = np.column_stack((np.sin(k * u), 1 - np.cos(k * u), 0 * u)) / k
    mean, _, _ = smooth(u, y, np.ones(40), np.full(40, k * k), 1e12)
    np.testing.assert_allclose(mean[:, :, 0], y, atol=1e-6)


def test_covariance_stays_positive_on_long_smooth_routes():
    """A window of a thousand points is 15 decades of variance; no difference of large numbers may show."""
    n = 3000
    u = np.arange(float(n))
    _, covariance, _ = smooth(u, np.column_stack((u, 0 * u, 0 * u)), np.ones(n), np.zeros(n), 1e18)
    assert (covariance[:, [0, 3, 5]] > 0).all()
    assert covariance[0, 5] == pytest.approx(covariance[-1, 5], rel=1e-3)  # the same seen from either end


@pytest.mark.parametrize("known", [False, True])
def test_noise_is_found_where_the_prior_holds(known):
    rng = np.random.default_rng(0)
    u = np.arange(600.0)
    steps = rng.normal(size=(600, 3)) * 0.003
    y = np.cumsum(np.cumsum(np.cumsum(steps, axis=0), axis=0), axis=0) + 0.7 * rng.normal(size=(600, 3))
    variance = 0.49 if known else 0.0
    ratio, q = best_ratio(u, y, np.ones(600), np.zeros(600), np.zeros((600, 3)), False, variance)
    assert np.sqrt(ratio * q) == pytest.approx(0.7, rel=1e-12 if known else 0.06)  # 3 sd of 1800 values: 5 %
    assert np.sqrt(q) == pytest.approx(0.003, rel=0.25)  # seven smoothing windows a decade of the spectrum
