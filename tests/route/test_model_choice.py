"""Evidence and variance over models: of spline and chain, and of the models of a fibre."""

import math

import numpy as np
import pytest

from tssgeom.route.geometry import measure
from tssgeom.route.model_choice import (
    evidence_scale,
    log_sum,
    mixture_variance,
    model_probabilities,
)
from tssgeom.route.observations import clean
from tssgeom.route.pieces import spread_over
from tssgeom.route.synthetic import chain, positions


@pytest.fixture(scope="module")
def fits():
    """A spline and a chain through the same noisy points of three pieces."""
    course = chain(np.array([0.15, 0.2, 0.15]), np.array([2.0, 9.0, 3.0]))
    points = positions(course, np.linspace(0.0, course.total_length, 60))
    shape = clean(points + 1e-3 * np.random.default_rng(0).standard_normal(points.shape))
    return measure(shape, 1e-3, "spline"), measure(shape, 1e-3, "arcs")


def test_evidence_of_one_and_the_same_points_compares_the_fits(fits):
    smooth, arcs = fits
    assert smooth.log_evidence == -0.5 * smooth.spline.deviance
    assert math.isfinite(arcs.log_evidence)
    assert arcs.strip().log_evidence == arcs.log_evidence


def test_the_variance_over_models_is_within_plus_between():
    """Against draws from the mixture; 4e5 of them leave 0.5 % of error."""
    rng = np.random.default_rng(1)
    log_evidence = np.array([-700.0, -701.0, -705.0])
    mean, variance = np.array([1.0, 1.5, 4.0]), np.array([0.1, 0.2, 0.3])
    probability = model_probabilities(log_evidence)
    which = rng.choice(3, 400_000, p=probability)
    draws = mean[which] + np.sqrt(variance[which]) * rng.standard_normal(len(which))
    about = float(probability @ mean)
    assert mixture_variance(probability, mean, variance, about) == pytest.approx(draws.var(), rel=0.02)
    assert mixture_variance(probability, mean, variance, 1.0) == pytest.approx(
        np.mean((draws - 1.0) ** 2), rel=0.02
    )
    assert log_sum(log_evidence) == pytest.approx(np.logaddexp.reduce(log_evidence), rel=1e-14)


def test_a_variance_of_the_whole_angle_is_spread_over_the_pieces():
    spread = spread_over(np.array([1.0, 0.0, 3.0]), 0.04)
    assert spread.sum() == pytest.approx(0.04, rel=1e-15)
    assert not spread[1].any()


@pytest.mark.parametrize("parameters", [0, 1, 9, 40])
def test_the_error_of_the_criterion_adds_its_variance_to_that_of_the_odds(parameters):
    """A logistic density of scale x has the variance (pi x)^2 / 3; the error is of half of each parameter."""
    variance = (math.pi * evidence_scale(parameters)) ** 2 / 3.0
    assert variance == pytest.approx(math.pi**2 / 3.0 + (0.5 * parameters) ** 2)
