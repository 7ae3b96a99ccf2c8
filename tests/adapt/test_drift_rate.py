"""How fast numbers drift, beside walks that are filtered with what a rig states."""

import numpy as np
import pytest

from tssgeom.adapt.drift_rate import DRIFT, DriftRate

STATED = np.array([1e-4])  # per second
NOISE = 0.05  # of a reading, one each second


def followed(drift, seed, steps=20000):
    """Yield error and variance of a Kalman filter of a walk with a `drift` per second, and its rate."""
    rng, rate = np.random.default_rng(seed), DriftRate(STATED)
    true = np.cumsum(np.sqrt(drift) * rng.standard_normal(steps))
    mean, variance = 0.0, 0.01
    for i, reading in enumerate(true + NOISE * rng.standard_normal(steps)):
        rate.take(float(i), np.array([mean]), np.array([variance]))
        variance += float(rate.variance[0])
        gain = variance / (variance + NOISE**2)
        mean, variance = mean + gain * (reading - mean), (1.0 - gain) * variance
        yield mean - true[i], variance, float(rate.variance[0])


@pytest.mark.parametrize("share", [1.0, 0.3, 0.03])
def test_a_drift_that_is_less_than_stated_is_estimated_and_bars_are_right(share):
    off, variance, rate = np.array(
        [one for seed in range(3) for one in list(followed(share * STATED[0], seed))[4000:]]
    ).T
    assert np.median(rate) == pytest.approx(share * STATED[0], rel=0.5)
    assert 0.8 < np.mean(off**2 / variance) < 1.3


def test_a_number_that_does_not_drift_keeps_the_least_drift_and_half_its_variance_is_error():
    off, variance, rate = np.array(list(followed(0.0, 1, 60000))[20000:]).T
    assert np.median(rate) < 3.0 * DRIFT.least * STATED[0]
    assert 0.2 < np.mean(off**2 / variance) < 0.9


def test_numbers_that_are_set_begin_a_new_interval():
    rate = DriftRate(STATED)
    rate.take(0.0, np.zeros(1), np.full(1, 1e-3))
    rate.restart()
    rate.take(1e6, np.full(1, 5.0), np.full(1, 1e-3))
    assert rate.variance == pytest.approx(STATED)
    assert len(rate.with_more(np.array([1e-6, 0.0])).variance) == 3


def test_a_number_that_all_members_agree_in_says_nothing_of_its_drift():
    rate = DriftRate(np.array([1e-4]))
    for time in range(100):
        rate.take(float(time), np.array([1.0]), np.array([0.0]))
    assert rate.variance == pytest.approx([1e-4])
