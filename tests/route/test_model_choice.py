"""One average over models: that of spline and chain, and that of the models of a fibre."""

import math

import numpy as np
import pytest

from tssgeom.route.geometry import measure
from tssgeom.route.model_choice import (
    log_sum,
    mixture_variance,
    model_choice_variance,
    model_probabilities,
    selected,
    undecided,
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


@pytest.mark.parametrize("difference", [-14.0, -3.0, 0.0, 1e-3, 5.0, 14.0])
def test_the_less_likely_model_counts_with_its_probability(fits, difference):
    """The closed form of two models: what the other one has over the estimate that is selected; (226)."""
    smooth, arcs = fits
    parameters = len(arcs.chain.matrix)
    scale = math.sqrt(1.0 + 3.0 * (parameters / (2.0 * math.pi)) ** 2)
    apart = smooth.profile.total_angle - arcs.profile.total_angle
    own = arcs.arcs.total_angle_se**2 - smooth.arcs.total_angle_se**2
    square = apart**2 + (own if difference <= 0.0 else -own)
    expected = max(square, 0.0) / (1.0 + math.exp(0.5 * abs(difference) / scale))
    assert undecided(difference, parameters)
    assert model_choice_variance(smooth, arcs, difference) == pytest.approx(expected, rel=1e-9)


def test_a_clear_call_adds_no_variance(fits):
    assert model_choice_variance(*fits, 1e3) == 0.0
    assert model_choice_variance(*fits, -math.inf) == 0.0


def test_the_variance_of_the_choice_is_that_of_the_selected_angle(fits):
    smooth, arcs = fits
    variance = model_choice_variance(smooth, arcs, 2.0)
    result = selected(smooth, arcs, 2.0)
    assert result.chain is arcs.chain
    assert result.spline is smooth.spline
    assert result.arcs.total_angle_se**2 == pytest.approx(arcs.arcs.total_angle_se**2 + variance, rel=1e-12)
    assert result.profile.total_angle_se**2 == pytest.approx(
        arcs.profile.total_angle_se**2 + variance, rel=1e-9
    )


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
