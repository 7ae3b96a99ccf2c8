"""The Cramér–Rao bound: closed forms, limits, and a fit that attains it."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from benchmarks.estimators import RIG, TENSION_IN, cramer_rao, first_pull
from tests.known_routes import truth
from tssgeom.route.pieces import Arcs
from tssgeom.route.synthetic import chain, half_circle, setup_a
from tssgeom.tendon.capstan import pretensioned, step, transmit

SEVEN = truth("7 pieces", np.random.default_rng(0)).course


def _bound(course, n, noise, *, known=True):
    return cramer_rao(course, np.linspace(0.0, course.total_length, n), noise, stations_known=known)


def test_the_bound_of_the_half_circle_and_of_setup_a_is_the_published_one():
    """200 points, 0.5 mm: 0.05 and 0.03 per cent of Φ."""
    assert _bound(half_circle(), 200, 5e-4).angle / np.pi == pytest.approx(5e-4, abs=0.5e-4)  # printed digits
    assert _bound(setup_a(), 200, 5e-4).angle / (3 * np.pi) == pytest.approx(3e-4, abs=0.5e-4)


@pytest.mark.parametrize("known", [True, False])
def test_the_bound_is_proportional_to_the_noise(known):
    one, ten = (_bound(SEVEN, 100, noise, known=known) for noise in (1e-4, 1e-3))
    assert ten.angle == pytest.approx(10 * one.angle)
    assert ten.elongation == pytest.approx(10 * one.elongation)


@pytest.mark.parametrize("course", [half_circle(), setup_a(), SEVEN])
def test_not_knowing_the_stations_never_helps(course):
    assert _bound(course, 60, 5e-4, known=False).angle >= _bound(course, 60, 5e-4).angle


def test_with_many_points_of_unknown_station_only_the_ends_are_left():
    course, noise = setup_a(), 5e-4
    kappa = np.hypot(*course.bend.T)
    ends = noise * np.hypot(kappa[0], kappa[-1])
    assert _bound(course, 20_000, noise, known=False).angle == pytest.approx(ends, rel=0.01)


def test_a_line_has_no_angle_to_be_wrong_about():
    assert _bound(chain(np.array([0.5]), np.array([0.0])), 50, 5e-4).angle == 0.0


def test_too_few_points_have_no_bound():
    assert _bound(SEVEN, 8, 5e-4, known=False).angle == np.inf


def test_a_least_squares_circle_attains_the_bound():
    """The fit is written out here on its own; 200 trials give its rms error to 5 %."""
    n, noise, length = 20, 5e-4, 0.5
    s, rng = np.linspace(0.0, length, n), np.random.default_rng(1)

    def arc(kappa):
        return np.column_stack((np.sin(kappa * s), 1.0 - np.cos(kappa * s), 0.0 * s)) / kappa

    errors = []
    for _ in range(200):
        observed = arc(np.pi / length) + noise * rng.standard_normal((n, 3))

        def residual(x, observed=observed):
            return (Rotation.from_rotvec(x[3:6]).apply(arc(x[6])) + x[:3] - observed).ravel()

        start = np.array([0.0] * 6 + [np.pi / length])
        errors.append(least_squares(residual, start).x[6] * length - np.pi)
    rms = np.sqrt(np.mean(np.square(errors)))
    assert rms == pytest.approx(_bound(half_circle(), n, noise).angle, rel=0.2)  # four standard deviations


def test_elongation_from_a_profile_is_that_of_the_tendon_model():
    length, angle = np.array([0.1, 0.2, 0.05]), np.array([0.0, 1.5, 2.0])
    pulled = step(pretensioned(RIG), TENSION_IN, RIG.friction.coefficient)
    expected = transmit(pulled, Arcs.exact(length, angle), RIG).elongation
    assert first_pull(length, angle) == pytest.approx(expected, rel=1e-12)
