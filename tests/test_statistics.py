"""Statistics that several parts use, against their definitions and against scipy."""

import math

import numpy as np
import pytest
from scipy import optimize, stats

from tssgeom import core
from tssgeom.core.constants import MEDIANS
from tssgeom.statistics import information_price, monotone, robust_sd


def test_medians_of_normal_numbers_are_those_of_their_distributions():
    # given to four digits
    assert MEDIANS.sd_per_absolute == pytest.approx(1.0 / stats.norm.ppf(0.75), rel=1e-4)
    assert MEDIANS.length_2 == pytest.approx(stats.rayleigh.median(), rel=1e-3)
    assert MEDIANS.square_2 == pytest.approx(stats.chi2.median(2), rel=1e-3)
    assert MEDIANS.square_3 == pytest.approx(stats.chi2.median(3), rel=1e-3)


def test_the_robust_standard_deviation_is_that_of_most_values():
    values = 0.3 * np.random.default_rng(0).standard_normal(4000)
    values[:400] = 1e6
    # one value in ten is far off: the median moves by 0.13 standard deviations; 4000 values give 2 %
    assert robust_sd(values) == pytest.approx(0.3, rel=0.2)


def test_the_median_is_that_of_numpy():
    values = np.random.default_rng(1).standard_normal(31)
    assert core.median(values) == np.median(values)


def test_isotonic_regression_agrees_with_scipy():
    rng = np.random.default_rng(2)
    x, weight = np.arange(50) / 10 + rng.standard_normal(50), rng.uniform(0.1, 3.0, 50)
    expected = optimize.isotonic_regression(x, weights=weight).x
    np.testing.assert_allclose(core.isotonic_regression(x, weight), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("rising", [True, False])
def test_monotone_values_agree_with_scipy(rising):
    values = np.random.default_rng(3).standard_normal(50)
    expected = optimize.isotonic_regression(values, increasing=rising).x
    np.testing.assert_allclose(monotone(values, rising=rising), expected, rtol=1e-12, atol=1e-12)


def test_each_parameter_costs_the_logarithm_of_the_number_of_values():
    assert information_price(3, 100) == 3 * math.log(100)
