"""Bars of followed numbers beside the independent simulator, at drifts as stated and at others."""

import numpy as np
import pytest
from scipy.stats import chi2

from tests.adapt.cases import BEGIN_S, columns_of, follow, rig_of, route_of, scores
from tests.twins import scenarios
from tssgeom.adapt.offline import RunFollower

EVERY = 4  # at 25 Hz
INDEPENDENT_S = 60.0  # between moments whose errors have nothing in common


def test_nees_of_machines_that_do_not_drift_is_not_above_its_band():
    hours, seeds = 0.06, range(4)
    runs = [scenarios.sound(seed, hours) for seed in seeds]
    results = [scores(follow(one, every=EVERY), one) for one in runs]
    free = 2 * len(seeds) * (3600.0 * hours - BEGIN_S) / INDEPENDENT_S
    high = float(chi2.ppf(0.975, free)) / free
    for which in range(2):  # filtered, smoothed; below 1, as numbers might begin to drift
        assert 0.2 < np.mean([one[which].nees.mean() for one in results]) < high


@pytest.mark.parametrize("begins_s", [0.0, 60.0])
def test_bars_hold_friction_that_rises_far_faster_than_is_stated(begins_s):
    holds = list[bool]()
    for seed in (0, 1):
        scenario = scenarios.rising_friction(seed, (begins_s + 120.0) / 3600.0, begins_s)
        run = follow(scenario, rig_of(scenario.machine, friction_hourly=0.2), every=EVERY)
        for numbers in (stretch.numbers for stretch in run.stretches):
            true = np.interp(numbers.time, scenario.times, scenario.truth["friction"])
            off = np.abs(numbers.filtered[:, 0] - true) / numbers.filtered_se[:, 0]
            holds += (off < 1.96)[numbers.time > begins_s + 60.0].tolist()
    assert np.mean(holds) >= 0.9


def test_readings_of_a_drive_that_stands_say_nothing_of_friction_now():
    scenario = scenarios.sound(1, 0.01)
    stands = np.minimum(np.arange(len(scenario.times)), 1000)
    given = scenario._replace(readings={name: one[stands] for name, one in scenario.readings.items()})
    numbers = follow(given, every=EVERY).stretches[0].numbers
    at = np.searchsorted(numbers.time, [12.0, 35.0])
    assert numbers.filtered_se[at[1], 0] > 2.0 * numbers.filtered_se[at[0], 0]
    assert numbers.filtered_se[at[1], 1] < 2.0 * numbers.filtered_se[at[0], 1]  # the zero is read


@pytest.mark.parametrize("seed", [0, 1])
def test_play_that_grows_raises_one_alert(seed):
    run = follow(scenarios.growing_play(seed, 0.04), every=EVERY)
    assert [one.mechanism for one in run.alerts] == ["play_at_drive"]


@pytest.mark.parametrize("seed", [41, 42])
def test_the_ends_are_within_their_bars_also_where_the_drive_may_have_turned(seed):
    scenario = scenarios.sound(seed, 0.03)
    run = RunFollower(rig_of(scenario.machine), route_of(scenario), columns_of(scenario, every=EVERY))
    names = ("tension_in_N", "tension_out_N", "displacement_in_m", "displacement_out_m")
    truth = np.column_stack([scenario.truth[name][::EVERY] for name in names])
    off = list[np.ndarray]()
    for i, _ in enumerate(run.rows()):
        now, known = run._follower.filter, run._follower.known
        if known is not None and i > 250 and now.trackers["displacement_in_m"].may_have_turned:
            off.append((known.ends - truth[i]) / known.ends_se)
    assert len(off) > 100
    assert np.abs(off).max() < 8.0
    assert (np.mean(np.square(off), axis=0) < 1.5).all()
