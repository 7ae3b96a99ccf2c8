"""Members of an ensemble: their deviations, what they expect, and how readings shift them."""

import numpy as np
import pytest

from tests.core.twins import ensemble as twin
from tssgeom import core

FREE = np.full(3, np.inf)  # bounds of numbers that have none


def test_deviations_are_those_of_the_twin_and_uncorrelated_with_what_is_known():
    rng = np.random.default_rng(3)
    random, known = rng.standard_normal((40, 3)), rng.standard_normal((40, 4)) + 2.0
    given = core.deviations(random, known)
    np.testing.assert_allclose(given, twin.deviations(random, known), rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(np.cov(given, rowvar=False), np.eye(3), atol=1e-13)
    np.testing.assert_allclose(given.mean(axis=0), 0.0, atol=1e-14)
    np.testing.assert_allclose(given.T @ known, 0.0, atol=1e-12)
    assert np.all(np.sum(given * random, axis=0) > 0.0)  # no member goes one way from step to step


def test_deviations_do_not_see_what_is_the_same_in_all_members():
    rng = np.random.default_rng(4)
    random, known = rng.standard_normal((20, 2)), rng.standard_normal((20, 2))
    more = np.column_stack((known, np.full(20, 7.0), known[:, 0] - 2.0 * known[:, 1]))
    np.testing.assert_allclose(core.deviations(random, more), core.deviations(random, known), atol=1e-12)
    assert not core.deviations(np.ones((20, 1)), known).any()


@pytest.mark.parametrize("drives", [1, 3])
def test_readings_are_compared_as_by_the_twin(drives):
    rng, n, c = np.random.default_rng(drives), 12, 5
    predicted = rng.standard_normal((n + 2 * drives, c))
    predicted[n:] = predicted[0] + 0.1 * rng.standard_normal((2 * drives, c))
    predicted[n + 1] = 2.0 * predicted[0] - predicted[n] + 1e-6  # straight over the first drive
    predicted[n:, 3] = predicted[0, 3]  # no drive moves it
    others, noise = rng.standard_normal((n + 2 * drives, 4)), rng.uniform(0.01, 0.2, c)
    given, drive = rng.standard_normal(c), rng.standard_normal((drives, 3))
    given[1], drive[:, 2] = np.nan, np.sign(drive[:, 2])
    result = core.compare_readings(n, predicted, others, given, noise, drive, 0.01, 0.3)
    expected = twin.compare_readings(n, predicted, others, given, noise, drive, 0.01, 0.3)
    for one, other in zip(result, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-14)


def test_readings_shift_an_ensemble_as_a_kalman_filter_does():
    """Two readings that are linear in three numbers: mean and covariance by the textbook."""
    rng, n, k = np.random.default_rng(4), 40, 3
    numbers = rng.standard_normal((n, 3)) @ np.array([[1.0, 0.3, 0.0], [0.0, 0.5, 0.2], [0.0, 0.0, 2.0]])
    kept = np.ascontiguousarray(np.tile(np.linspace(1.0, 2.0, 9 * (k + 1) + 7), (n, 1)))
    now = kept.copy()
    now[:, 1] += 0.1 * numbers[:, 0]
    rows = np.array([[1.0, -0.5, 0.2], [0.0, 1.0, 0.4]])
    predicted, others = np.ascontiguousarray(numbers @ rows.T), 2.0 * numbers[:, :1]
    reading, variance = np.array([0.4, -0.3]), np.array([0.2, 0.05])
    mean, before = numbers.mean(axis=0), np.cov(numbers, rowvar=False)
    gain = before @ rows.T @ np.linalg.inv(rows @ before @ rows.T + np.diag(variance))
    at, spread = mean + gain @ (reading - rows @ mean), (np.eye(3) - gain @ rows) @ before
    used, innovation, values, covariance, expected, moments = core.assimilate(
        1, k, numbers, kept, now, predicted, others, reading, variance, 6.0, -FREE, FREE
    )
    assert used == 2
    np.testing.assert_allclose(numbers.mean(axis=0), at, rtol=1e-10)
    np.testing.assert_allclose(values, at, rtol=1e-10)
    np.testing.assert_allclose(np.cov(numbers, rowvar=False), spread, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(covariance, spread, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(predicted, numbers @ rows.T, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(others, 2.0 * numbers[:, :1], rtol=1e-10)
    np.testing.assert_allclose(kept, kept[:1].repeat(n, axis=0), rtol=1e-12)
    np.testing.assert_allclose(now[:, 1] - kept[:, 1], 0.1 * numbers[:, 0], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(
        expected, np.column_stack((predicted.mean(axis=0), predicted.var(axis=0, ddof=1)))
    )
    np.testing.assert_allclose(moments[0], [2.0 * at[0], 4.0 * spread[0, 0]], rtol=1e-9)
    assert innovation[0, 1] == pytest.approx(rows[0] @ before @ rows[0] + variance[0])


def test_an_outlier_and_a_missing_reading_are_not_used_and_numbers_stay_within_their_bounds():
    numbers, memory = np.array([[1.0], [2.0], [3.0]]), np.ones((3, 43))
    predicted, others = np.hstack((numbers, numbers)), np.empty((3, 0))
    reading = np.array([np.nan, 90.0])
    used, *_ = core.assimilate(
        1, 3, numbers, memory, memory.copy(), predicted, others, reading, np.ones(2), 6.0,
        np.array([1.5]), np.array([2.5]),
    )  # fmt: skip
    assert used == 0
    np.testing.assert_array_equal(numbers[:, 0], [1.5, 2.0, 2.5])


SHARE, FIRST = np.array([0.0, 0.1, 1.0, 10.0]), np.array([0.5, 0.2, 0.2, 0.1])
SETTING = (1e-3, 1e-2, 1.0)  # changes in a second, least and greatest share


def test_drifts_are_compared_as_by_the_twin():
    rng, d = np.random.default_rng(6), 3
    stated, members = np.array([1e-4, 1e-2, 0.0]), 0.1 * rng.standard_normal((30, d))
    kept = [
        np.tile(FIRST, (d, 1)),
        np.zeros((d, 4)),
        np.zeros((d, 4)),
        np.tile([0.0, np.nan, 0.0, 0.3], (d, 1)),
    ]
    core.compare_drifts(members, np.zeros(d), stated, SHARE, FIRST, *SETTING, *kept)
    for _ in range(20):
        members = members.mean(axis=0) + rng.uniform(0.8, 1.1, d) * (members - members.mean(axis=0))
        members += 0.05 * rng.standard_normal(d)
        span, values, variances = (
            rng.choice([0.0, 0.05, 3.0], d),
            members.mean(axis=0),
            members.var(axis=0, ddof=1),
        )
        expected = twin.compare_drifts(values, variances, span, stated, SHARE, FIRST, SETTING, *kept)
        sd = core.compare_drifts(members, span, stated, SHARE, FIRST, *SETTING, *kept)
        for one, another in zip((sd, *kept), expected, strict=True):
            np.testing.assert_allclose(one, another, rtol=1e-9, atol=1e-13)


def test_readings_add_the_same_information_to_what_is_known_as_to_the_members():
    rng, d = np.random.default_rng(7), 3
    of_members, of_known, by = (one @ one.T + 0.1 * np.eye(d) for one in rng.standard_normal((3, d, d)))
    values, known, reading = rng.standard_normal((3, d))
    last = np.column_stack((values, of_members.diagonal(), np.zeros(d), np.ones(d)))
    beyond = core.known_beyond(values, of_members, known, of_known, last)
    for one, another in zip(
        core.known_numbers(values, of_members, last, beyond), (known, of_known), strict=True
    ):
        np.testing.assert_allclose(one, another, rtol=1e-9)

    def read(value, covariance):
        gain = covariance @ np.linalg.inv(covariance + by)
        return value + gain @ (reading - value), covariance - gain @ covariance

    after = core.known_numbers(*read(values, of_members), last, beyond)
    slow = twin.known_numbers(*read(values, of_members), last, beyond)
    for one, another, third in zip(after, read(known, of_known), slow, strict=True):
        np.testing.assert_allclose(one, another, rtol=1e-8)
        np.testing.assert_allclose(one, third, rtol=1e-8)
    last[1, 1] = np.nan  # nothing is known beyond the members
    np.testing.assert_array_equal(core.known_numbers(values, of_members, last, beyond)[1], of_members)
