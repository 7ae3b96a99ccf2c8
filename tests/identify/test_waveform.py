"""Drives of experiments stay within their limits, and begin and end their legs at samples."""

import numpy as np
import pytest

from tssgeom.identify.waveform import Range, Waveform, course_of, random_waveform, varied_waveform
from tssgeom.plausibility.limits import LIMITS


def within(low, high, speed, duration=60.0):
    return Range(0.0, low, high, speed=speed, duration=duration, interval=0.02, samples=300)


WITHIN = within(-5e-4, 4e-3, 3e-3)


def test_random_and_varied_drives_keep_every_limit():
    rng, made = np.random.default_rng(5), 0
    waveform = random_waveform(rng)
    for _ in range(400):
        waveform = varied_waveform(waveform, rng) if rng.uniform() < 0.7 else random_waveform(rng)
        course = course_of(waveform, WITHIN)
        if course is None:
            continue
        made += 1
        step = np.diff(course.time)
        assert LIMITS.fewest_rows <= len(course.time) <= WITHIN.samples
        assert course.time[-1] <= WITHIN.duration * (1.0 + 1e-9)
        assert step.min() >= WITHIN.interval * (1.0 - 1e-9)
        assert np.abs(np.diff(course.drive[:, 0]) / step).max() <= WITHIN.speed * (1.0 + 1e-9)
        assert course.drive.min() >= WITHIN.low - 1e-12
        assert course.drive.max() <= WITHIN.high + 1e-12
        assert course.drive[0] == WITHIN.rest
        at = np.searchsorted(course.time, course.corner_time - 1e-9)
        np.testing.assert_allclose(course.time[at], course.corner_time, atol=1e-9)
        np.testing.assert_allclose(course.drive[at], course.corner, atol=1e-12)
    assert made > 100


def test_too_long_a_run_loses_its_dwells_before_its_slow_legs():
    slow = Waveform((1.0, 0.0), (0.05, 0.05), (0.5, 0.5), 1)
    course = course_of(slow, WITHIN)
    assert course is not None
    still = np.diff(course.drive[:, 0]) == 0.0
    assert still[10:].sum() * (course.time[1] - course.time[0]) < 0.1 * WITHIN.duration
    speeds = np.abs(np.diff(course.corner[:, 0]) / np.diff(course.corner_time))
    assert speeds[speeds > 0.0].min() == pytest.approx(0.05 * WITHIN.speed, rel=0.1)  # legs of whole samples


def test_cycles_that_do_not_fit_are_left_out():
    many = Waveform((1.0, 0.0), (1.0, 1.0), (0.0, 0.0), 4)
    four, fewer = (course_of(many, within(-5e-4, 4e-3, 3e-3, duration)) for duration in (60.0, 5.0))
    assert four is not None
    assert fewer is not None
    assert len(fewer.corner) < len(four.corner)


@pytest.mark.parametrize(
    "within",
    [
        within(0.0, 0.0, 3e-3),  # no range
        within(-5e-4, 4e-3, 1e-5),  # too slow for a leg
    ],
)
def test_where_nothing_fits_there_is_no_drive(within):
    assert course_of(Waveform((1.0, 0.0), (1.0, 1.0), (0.0, 0.0), 1), within) is None
