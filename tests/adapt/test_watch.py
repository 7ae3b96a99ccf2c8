"""Sequential tests of innovations: how seldom they cry wolf, and how soon they see a fault."""

import numpy as np

from tssgeom.adapt import watch
from tssgeom.adapt.watch import Watch, threshold


def test_the_bound_gives_the_stated_interval_between_false_alarms(monkeypatch):
    """A CUSUM of white blocks, 40 of them a mean run, simulated beside the formula."""
    settings = watch.WATCH._replace(false_alarm_interval=100.0, block=0.25)
    monkeypatch.setattr(watch, "WATCH", settings)
    bound, rng, runs = threshold(1), np.random.default_rng(1), []
    for _ in range(400):
        total, count = 0.0, 0
        while total <= bound:
            total = max(total + rng.standard_normal() - settings.shift, 0.0)
            count += 1
        runs.append(count * settings.block)
    assert 0.7 * 100.0 < np.mean(runs) < 1.5 * 100.0


def test_white_innovations_of_an_hour_raise_no_alarm():
    rng, tests = np.random.default_rng(2), Watch(("tension_in_N",))
    z = rng.standard_normal(100 * 3600)
    one, none = np.ones(1), np.zeros(1)
    assert all(tests.take(z[i : i + 1], one, none, 0.01 * i) is None for i in range(len(z)))


def test_a_shift_is_reported_with_its_begin_and_way():
    rng, tests = np.random.default_rng(3), Watch(("tension_in_N", "tension_out_N"))
    for i in range(6000):
        off = rng.standard_normal(2) - (2.0 if i >= 4000 else 0.0) * np.array([0.0, 1.0])
        alarm = tests.take(off, np.ones(2), np.zeros(2), 0.01 * i)
        if alarm is not None:
            break
    assert alarm is not None
    assert (alarm.channel, alarm.way) == ("tension_out_N", -1)
    assert abs(alarm.since - 40.0) < 0.6
    assert alarm.time < 43.0


def test_a_reading_that_is_far_off_for_half_a_second_is_an_alarm_though_it_is_not_used():
    tests = Watch(("tension_in_N",))
    unused = np.full(1, np.nan)
    for i in range(2000):
        alarm = tests.take(unused, np.ones(1), np.full(1, 9.0 if i >= 1000 else 1.0), 0.01 * i)
        if alarm is not None:
            break
    assert alarm is not None
    assert alarm.since == 10.0
    assert 10.5 <= alarm.time < 10.6


def test_a_single_outlier_is_none():
    tests = Watch(("tension_in_N",))
    for i in range(2000):
        z = 50.0 if i == 1000 else 0.0
        assert tests.take(np.full(1, z), np.ones(1), np.full(1, z), 0.01 * i) is None
