"""Smoothing of a random walk against the dense Gaussian solution, which shares no line with it."""

import numpy as np
import pytest

from tssgeom.adapt.smoothing import NumberHistory

HOURLY = np.array([60.0, 30.0, 0.0])  # the last one is constant
DRIFT = HOURLY**2 / 3600.0


def problem(seed, steps):
    """Irregular times, a walk of three numbers, and one scalar reading of it at each time."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.2, 3.0, steps))
    spans = np.diff(times, prepend=times[0])
    walk = np.cumsum(HOURLY / 60.0 * np.sqrt(spans)[:, None] * rng.standard_normal((steps, 3)), axis=0)
    rows = rng.standard_normal((steps, 3))
    return times, spans, rows, np.sum(rows * walk, axis=1) + 0.5 * rng.standard_normal(steps)


def kalman(times, spans, rows, readings):
    """Yield time, mean and covariance after each reading."""
    mean, covariance = np.zeros(3), np.diag([4.0, 1.0, 9.0])
    for time, span, row, reading in zip(times, spans, rows, readings, strict=True):
        covariance = covariance + np.diag(HOURLY**2 / 3600.0 * span)
        gain = covariance @ row / (row @ covariance @ row + 0.25)
        mean = mean + gain * (reading - row @ mean)
        covariance = covariance - np.outer(gain, row @ covariance)
        yield time, mean, covariance


def dense(times, rows, readings):
    """Mean [n, 3] and covariance [n, 3, 3] of the walk at all times, as one Gaussian."""
    n, since = len(times), times - times[0]
    shared = np.minimum(since[:, None], since)
    prior = np.zeros((n, 3, n, 3))
    for i, (start, hourly) in enumerate(zip([4.0, 1.0, 9.0], HOURLY, strict=True)):
        prior[:, i, :, i] = start + hourly**2 / 3600.0 * shared
    prior = prior.reshape(3 * n, 3 * n)
    design = np.zeros((n, n, 3))
    design[np.arange(n), np.arange(n)] = rows
    design = design.reshape(n, 3 * n)
    gain = np.linalg.solve(design @ prior @ design.T + 0.25 * np.eye(n), design @ prior).T
    covariance = (prior - gain @ design @ prior).reshape(n, 3, n, 3)
    return (gain @ readings).reshape(n, 3), covariance[np.arange(n), :, np.arange(n)]


@pytest.mark.parametrize("most", [1000, 7, 1])
@pytest.mark.parametrize("steps", [1, 2, 60, 123])
def test_the_smoothed_walk_is_the_dense_gaussian_solution_however_few_moments_are_kept(most, steps):
    times, spans, rows, readings = problem(steps, steps)
    history = NumberHistory(3, most)
    for known in kalman(times, spans, rows, readings):
        history.take(*known, DRIFT)
    result, (mean, covariance) = history.smoothed(), dense(times, rows, readings)
    kept = np.searchsorted(times, result.time)
    assert np.array_equal(times[kept], result.time)
    assert min(steps, most) <= len(kept) <= max(2 * most + 1, 3)
    assert kept[-1] == steps - 1
    assert result.values == pytest.approx(mean[kept], abs=1e-8)
    assert result.covariance == pytest.approx(covariance[kept], abs=1e-8)
    assert np.all(result.se <= result.filtered_se + 1e-9)


def test_what_comes_after_a_cut_does_not_count():
    times, spans, rows, readings = problem(1, 50)
    history, alone = NumberHistory(3), NumberHistory(3)
    for i, known in enumerate(kalman(times, spans, rows, readings)):
        history.take(*known, DRIFT)
        if i < 30:
            alone.take(*known, DRIFT)
    history.cut(times[30])
    assert np.array_equal(history.smoothed().values, alone.smoothed().values)
    assert np.array_equal(history.smoothed().time, times[:30])
    history.cut(times[0])
    assert len(history.smoothed().time) == 0


def test_a_history_that_was_cut_goes_on():
    times, spans, rows, readings = problem(2, 50)
    known = list(kalman(times, spans, rows, readings))
    history, plain = NumberHistory(3), NumberHistory(3)
    for one in known[:40]:
        history.take(*one, DRIFT)
    history.cut(times[30])
    for one in known[30:]:
        history.take(*one, DRIFT)
    for one in known:
        plain.take(*one, DRIFT)
    assert history.smoothed().values == pytest.approx(plain.smoothed().values, abs=1e-12)


def test_a_number_without_spread_stays():
    history = NumberHistory(2)
    for time in range(5):
        history.take(
            float(time), np.array([2.0, float(time)]), np.diag([0.0, 1.0]), np.array([0.0, 1.0]) / 3600.0
        )
    result = history.smoothed()
    assert np.all(result.values[:, 0] == 2.0)
    assert np.all(result.se[:, 0] == 0.0)
    assert np.all(np.isfinite(result.values))
