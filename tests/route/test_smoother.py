"""The state-space smoother against the same statistics written as dense linear algebra."""

from math import factorial

import numpy as np
import pytest

from tssgeom import core
from tssgeom.core import transitions
from tssgeom.route.spline.problem import FilterModel

_X, _W = np.polynomial.legendre.leggauss(5)  # exact for the polynomials of sixth degree below
_BEND, _RATE = 0.05, 0.01  # variances of a and b at both ends over that of the noise
_FREE = 1e7  # variance of position and direction over that of the noise: as good as unknown


def _wander(s: float, a: int, t: float, b: int) -> float:
    """Covariance of derivative a at s and derivative b at t of white noise integrated four times from 0."""
    top = min(s, t)
    x = 0.5 * top * (_X + 1.0)
    power = (s - x) ** (3 - a) * (t - x) ** (3 - b)
    return 0.5 * top * float(_W @ power) / factorial(3 - a) / factorial(3 - b)


def _power(t: float, k: int, order: int) -> float:
    """Derivative of t^k / k!."""
    return t ** (k - order) / factorial(k - order) if k >= order else 0.0


def _prior(s: float, a: int, t: float, b: int, ratio: float) -> float:
    known = _BEND * _power(s, 2, a) * _power(t, 2, b) + _RATE * _power(s, 3, a) * _power(t, 3, b)
    return _wander(s, a, t, b) + ratio * known


def _dense(u, y, noise, ratio, order):
    """Universal kriging: mean [n, 3] and variance [n] of a derivative, and -2 ln restricted likelihood."""
    observed = [(t, 0) for t in u] + [(u[-1], 2), (u[-1], 3)]
    values = np.vstack((y, np.zeros((2, 3))))
    own = np.concatenate((noise, [ratio * _BEND, ratio * _RATE]))
    prior = np.array([[_prior(s, a, t, b, ratio) for t, b in observed] for s, a in observed])
    k = prior + np.diag(own)
    h = np.array([[_power(t, 0, a), _power(t, 1, a)] for t, a in observed])
    k_inv = np.linalg.inv(k)
    grams = h.T @ k_inv @ h
    beta = np.linalg.solve(grams, h.T @ k_inv @ values)
    mean, variance = np.empty((len(u), 3)), np.empty(len(u))
    for i, t in enumerate(u):
        c = np.array([_prior(t, order, s, a, ratio) for s, a in observed])
        basis = np.array([_power(t, 0, order), _power(t, 1, order)])
        rest = basis - h.T @ k_inv @ c
        mean[i] = basis @ beta + c @ k_inv @ (values - h @ beta)
        variance[i] = _prior(t, order, t, order, ratio) - c @ k_inv @ c + rest @ np.linalg.solve(grams, rest)
    r = values - h @ beta
    ties = np.linalg.slogdet(k[-2:, -2:])[1]  # what they would be worth on their own
    fit = np.einsum("ic,ij,jc->", r, k_inv, r)
    return mean, variance, 3 * (np.linalg.slogdet(k)[1] + np.linalg.slogdet(grams)[1] - ties), fit


def _given(u, y):
    """Transitions of a straight prior, a first guess and the variances of the prior."""
    start = np.zeros((3, 4))
    start[:, 0], start[:, 1] = y[0], (y[-1] - y[0]) / (u[-1] - u[0])
    return transitions(u, np.zeros((len(u), 3))), start, np.array([_FREE, _FREE, _BEND, _RATE])


def _model(u, y, weight, prior):
    """Points with transitions, a first guess and variances at the ends, all three coordinates counted."""
    return FilterModel(u, y, weight, *prior, np.zeros((len(u), 3)), across_only=False)


@pytest.fixture
def uneven():
    rng = np.random.default_rng(3)
    u = np.cumsum(rng.uniform(0.4, 1.8, 14)) - 1.0
    return u - u[0], rng.normal(size=(14, 3)) + np.outer(u - u[0], [1.0, 0.2, -0.3])


def _full(p):
    return np.array([[p[[0, 1, 2, 3]], p[[1, 4, 5, 6]], p[[2, 5, 7, 8]], p[[3, 6, 8, 9]]]])[0]


@pytest.mark.parametrize("ratio", [1e-2, 1.0, 1e3])
@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_posterior_is_that_of_universal_kriging(uneven, ratio, order):
    u, y = uneven
    weight = np.ones(14)
    weight[5] = 0.5
    mean, covariance, _ = core.smooth(*_model(u, y, weight, _given(u, y)), None, None, ratio, 0.0)
    expected, variance, _, _ = _dense(u, y, ratio / weight, ratio, order)
    # the dense way subtracts prior variances 1e8 times the noise; the filter's vague start is worth 1e-7
    rounding = 1e-4 if ratio >= 1.0 else 2e-2
    np.testing.assert_allclose(mean[:, :, order], expected, rtol=2e-5, atol=2e-5 * np.abs(expected).max())
    np.testing.assert_allclose(covariance[:, [0, 4, 7, 9][order]], variance, rtol=rounding)


def test_likelihood_is_the_restricted_one_up_to_a_constant(uneven):
    u, y = uneven
    constant = []
    for ratio in (1e-2, 1.0, 1e2):
        model = _model(u, y, np.ones(14), _given(u, y))
        log_s, squares, n = core.innovations(*model, None, None, ratio, 0.0)[1:]
        _, _, log_k, fit = _dense(u, y, np.full(14, ratio), ratio, 0)
        assert n == 12  # three coordinates' worth of position and direction are unknown
        assert squares == pytest.approx(fit, rel=2e-3)
        constant.append(log_k - 3 * log_s)
    assert np.ptp(constant) < 0.02  # of values near 50


def test_unobserved_stations_change_nothing_elsewhere(uneven):
    u, y = uneven
    with_hole = np.insert(u, 7, 0.5 * (u[6] + u[7]))
    outlier = np.insert(y, 7, 1e3, axis=0)
    weight = np.insert(np.ones(14), 7, 0.0)
    mean, covariance, _ = core.smooth(*_model(u, y, np.ones(14), _given(u, y)), None, None, 1.0, 0.0)
    more, wider, _ = core.smooth(
        *_model(with_hole, outlier, weight, _given(with_hole, outlier)), None, None, 1.0, 0.0
    )
    keep = np.arange(15) != 7
    # the first guess of the direction counts for a part in 1e7
    np.testing.assert_allclose(more[keep], mean, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(wider[keep], covariance, rtol=1e-6, atol=1e-9)


def test_gain_gives_the_covariance_of_neighbours(uneven):
    """Pushing one observation shifts neighbours by their covariance."""
    u, y = uneven
    given = _given(u, y)
    base, covariance, gain = core.smooth(*_model(u, y, np.ones(14), given), None, None, 1.0, 0.0)
    i, push = 6, 1e-4
    shifted = y.copy()
    shifted[i + 1] += push
    moved, _, _ = core.smooth(*_model(u, shifted, np.ones(14), given), None, None, 1.0, 0.0)
    cross = gain[i] @ _full(covariance[i + 1])
    # pushing an observation of unit noise variance moves state i by its covariance with that position
    np.testing.assert_allclose((moved - base)[i, 0] / push, cross[:, 0], rtol=1e-5, atol=1e-8)


def _bending(u, y, kappa2, growth, omega2):
    """Prior of known κ², κκ' and ω², with unknown curvature at the ends."""
    _, start, _ = _given(u, y)
    start[:, 1] = (y[1] - y[0]) / (u[1] - u[0])
    coupling = np.column_stack((kappa2, growth, np.full(len(u), omega2)))
    return transitions(u, coupling), start, np.array([_FREE, _FREE, _FREE, _FREE])


def test_a_circle_costs_nothing_once_the_prior_bends_with_it():
    u, k = np.arange(40.0), 0.1
    y = np.column_stack((np.sin(k * u), 1 - np.cos(k * u), 0 * u)) / k
    bending = _bending(u, y, np.full(40, k * k), np.zeros(40), 0.0)
    mean, _, _ = core.smooth(*_model(u, y, np.ones(40), bending), None, None, 1e14, 0.0)
    np.testing.assert_allclose(mean[:, :, 0], y, atol=1e-6)


def test_a_helix_costs_nothing_once_the_prior_turns_with_its_torsion():
    u, k, torsion = np.arange(60.0), 0.1, 0.07
    turn = np.hypot(k, torsion)
    radius, climb = k / turn**2, torsion / turn
    y = np.column_stack((radius * np.cos(turn * u), radius * np.sin(turn * u), climb * u))
    y -= y[0]
    bending = _bending(u, y, np.full(60, k * k), np.zeros(60), torsion**2)
    mean, _, _ = core.smooth(*_model(u, y, np.ones(60), bending), None, None, 1e16, 0.0)
    np.testing.assert_allclose(mean[:, :, 0], y, atol=1e-6)
    without = _bending(u, y, np.full(60, k * k), np.zeros(60), 0.0)
    straight, _, _ = core.smooth(*_model(u, y, np.ones(60), without), None, None, 1e16, 0.0)
    assert np.abs(straight[:, :, 0] - y).max() > 1e-3  # what ω² is for


def test_transitions_solve_their_equation():
    """A chain of two steps is one of twice the length, and a step undoes one backwards."""
    coupling = np.tile([0.3, 0.05, 0.1], (3, 1))
    twice = transitions(np.array([0.0, 0.7, 1.4]), coupling)
    once = transitions(np.array([0.0, 1.4]), coupling[:2])

    def full(f):
        return np.column_stack(([1.0, 0.0, 0.0, 0.0], f.reshape(4, 3)))

    np.testing.assert_allclose(full(twice[2]) @ full(twice[1]), full(once[1]), rtol=1e-12, atol=1e-14)


def test_covariance_stays_positive_on_long_smooth_routes():
    """A window of a thousand points is 20 decades of variance; no difference of large numbers may enter."""
    n = 3000
    u = np.arange(float(n))
    y = np.column_stack((u, 0 * u, 0 * u))
    step, start, _ = _given(u, y)
    prior = (step, start, np.array([1e4, 1e4, 1e-9, 1e-15]))
    _, covariance, _ = core.smooth(*_model(u, y, np.ones(n), prior), None, None, 1e22, 0.0)
    assert (covariance[:, [0, 4, 7, 9]] > 0).all()
    assert covariance[0, 7] == pytest.approx(covariance[-1, 7], rel=1e-2)  # the same from either end


@pytest.mark.parametrize("known", [False, True])
def test_noise_is_estimated_where_the_prior_holds(known):
    rng = np.random.default_rng(0)
    n = 600
    u = np.arange(float(n))
    y = rng.normal(size=(n, 3)) * 0.0003
    for _ in range(4):
        y = np.cumsum(y, axis=0)
    y += 0.7 * rng.normal(size=(n, 3))
    step, start, ends = transitions(u, np.zeros((n, 3))), np.zeros((3, 4)), np.array([1e4, 1e4, 20.0, 1e-3])
    model = _model(u, y, np.ones(n), (step, start, ends))
    ratio, q = core.best_ratio(*model, None, None, 0.49 if known else 0.0, 0.0)[:2]
    assert np.sqrt(ratio * q) == pytest.approx(0.7, rel=1e-12 if known else 0.06)  # 3 sd of 1800 values: 5 %
    assert np.sqrt(q) == pytest.approx(0.0003, rel=0.3)  # a few smoothing windows a decade of the spectrum
