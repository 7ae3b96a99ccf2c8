"""How fast numbers drift, beside walks that are filtered with what a rig states."""

import numpy as np
import pytest

from tssgeom.adapt.drift_rate import DRIFT, DriftRate

STATED = np.array([1e-4])  # per second
NOISE = 0.05  # of a reading, one each second
ALL = np.ones(1, dtype=bool)


def walk(share, seed, steps=8000):
    """A number whose drift has a share of the stated variance."""
    return np.cumsum(np.sqrt(share * STATED) * np.random.default_rng(seed).standard_normal(steps))


def members(mean, variance):
    """Members with such means and variances, uncorrelated."""
    off = np.sqrt(np.diag(0.5 * (2 * len(mean) - 1) * np.asarray(variance)))
    return np.concatenate((mean - off, mean + off))


def followed(true, seed):
    """Yield error, variance and drift of a number that goes so, and the drift of the filter it is read by."""
    rng, rate = np.random.default_rng((seed, 1)), DriftRate(STATED)
    mean, variance = np.zeros(1), np.full(1, 0.01)
    for number, reading in zip(true, true + NOISE * rng.standard_normal(len(true)), strict=True):
        rate.wait(1.0)
        sd = rate.take(ALL, members(mean, variance))
        variance = variance + sd**2
        gain = variance / (variance + NOISE**2)
        mean, variance = mean + gain * (reading - mean), (1.0 - gain) * variance
        known, covariance = rate.estimate(mean, np.diag(variance))
        yield float(known[0]) - number, float(covariance[0, 0]), float(rate.variance[0]), float(sd[0] ** 2)


@pytest.mark.parametrize("share", [3.0, 1.0, 0.3, 0.03])
def test_a_drift_that_is_not_the_stated_one_is_estimated_and_bars_are_right(share):
    off, variance, rate, of_members = np.array(
        [one for seed in range(3) for one in list(followed(walk(share, seed), seed))[2000:]]
    ).T
    assert np.median(rate) == pytest.approx(share * STATED[0], rel=0.5)
    assert np.median(of_members) == pytest.approx(min(share, 1.0) * STATED[0], rel=0.5)
    assert 0.8 < np.mean(off**2 / variance) < 1.3


def test_a_number_that_does_not_drift_is_known_better_than_by_members_that_remain_ready_for_drift():
    off, variance, _, of_members = np.array(
        [one for seed in range(3) for one in list(followed(np.zeros(8000), seed))[2000:]]
    ).T
    assert np.median(of_members) == pytest.approx(DRIFT.least * STATED[0])
    steady = NOISE * np.sqrt(DRIFT.least * STATED[0])  # variance of the members
    assert np.mean(off**2) < 0.25 * steady
    assert np.mean(variance) < 0.5 * steady
    assert 0.3 < np.mean(off**2 / variance) < 1.25  # it might begin to drift


def test_bars_hold_within_a_minute_a_number_that_suddenly_goes_faster_than_is_stated():
    holds = list[float]()
    for seed in range(10):
        true = np.maximum(np.arange(720.0) - 600.0, 0.0) * 4.0 * np.sqrt(STATED[0])
        off, variance, *_ = np.array(list(followed(true, seed))).T
        holds.append(float(np.mean(np.abs(off[660:]) < 1.96 * np.sqrt(variance[660:]))))
    assert np.mean(holds) > 0.9


def test_bars_at_the_stated_drift_are_at_most_a_tenth_wider_than_where_it_is_known():
    _, variance, *_ = np.array([one for seed in range(3) for one in followed(walk(1.0, seed), seed)]).T
    known = 0.5 * STATED[0] * (np.sqrt(1.0 + 4.0 * NOISE**2 / STATED[0]) - 1.0)  # steady
    assert np.mean(np.sqrt(variance)) < 1.1 * np.sqrt(known)


def test_drift_that_waits_is_in_the_bars_and_comes_when_it_is_added():
    rate, given = DriftRate(np.tile(STATED, 2)), members(np.zeros(2), np.full(2, 1e-3))
    rate.take(np.ones(2, dtype=bool), given)
    rate.wait(100.0)
    sd = rate.take(np.array([True, False]), given)
    assert sd[0] >= np.sqrt(100.0 * rate.variance[0])
    assert sd[1] == 0.0
    known, covariance = rate.estimate(np.zeros(2), np.diag(1e-3 + sd**2))
    assert known == pytest.approx(np.zeros(2))
    assert covariance == pytest.approx(np.diag(1e-3 + 100.0 * rate.variance))
    assert rate.take(np.ones(2, dtype=bool), given)[1] == pytest.approx(sd[0], rel=0.01)


def test_numbers_that_are_set_say_nothing_of_their_drift():
    rate = DriftRate(STATED)
    rate.wait(1e6)
    rate.take(ALL, members(np.zeros(1), np.full(1, 1e-3)))
    before = rate.variance
    rate.restart()
    rate.wait(1.0)
    rate.take(ALL, members(np.full(1, 5.0), np.full(1, 1e-3)))
    assert rate.variance == pytest.approx(before)
    assert len(rate.with_more(np.array([1e-6, 0.0])).variance) == 3


def test_a_number_that_all_members_agree_in_says_nothing_of_its_drift():
    rate = DriftRate(STATED)
    before = rate.variance
    for _ in range(100):
        rate.wait(1.0)
        rate.take(ALL, members(np.ones(1), np.zeros(1)))
    assert rate.variance == pytest.approx(before)


def test_rows_are_all_of_a_rate():
    one, other = DriftRate(STATED), DriftRate(STATED)
    _steps(one, 300)
    other.set_rows(one.rows)
    assert _steps(other, 50, 7) == _steps(one, 50, 7)


def _steps(rate, count, seed=0):
    rng, added = np.random.default_rng(seed), list[float]()
    for _ in range(count):
        rate.wait(1.0)
        added.append(float(rate.take(ALL, members(0.1 * rng.standard_normal(1), np.full(1, 1e-3)))[0]))
    return added
