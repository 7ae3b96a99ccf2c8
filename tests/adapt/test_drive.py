"""The drive behind noisy readings: no turn that is none, no lag that lasts."""

import numpy as np
import pytest

from tssgeom.adapt.moments import DriveTracker

NOISE = 1e-5


def tracked(path, seed=0):
    tracker, rng = DriveTracker(NOISE), np.random.default_rng(seed)
    values = []
    for x in path + NOISE * rng.standard_normal(len(path)):
        tracker.take(x)
        values.append(tracker.value)
    return np.array(values)


@pytest.mark.parametrize("step", [0.1, 0.5, 2.0, 5.0])
def test_a_steady_motion_has_no_bias(step):
    path = step * NOISE * np.arange(4000)
    off = (tracked(path) - path)[500:]
    assert abs(off.mean()) < 0.35 * NOISE
    assert off.std() < 1.2 * NOISE


def test_noise_of_a_hold_turns_no_drive():
    path = np.concatenate((3.0 * NOISE * np.arange(300), np.full(20000, 900.0 * NOISE)))
    values = tracked(path)[300:]
    assert np.diff(values).min() >= 0.0
    assert abs(values - 900.0 * NOISE).max() < 3.0 * NOISE


def test_a_turn_is_followed():
    path = NOISE * np.concatenate((2.0 * np.arange(300), 600.0 - 2.0 * np.arange(300)))
    off = (tracked(path) - path)[320:]
    assert abs(off.mean()) < 0.5 * NOISE


def test_readings_without_noise_are_the_drive():
    tracker = DriveTracker(0.0)
    for x in (0.0, 1.0, 0.5):
        tracker.take(x)
        assert tracker.value == x
