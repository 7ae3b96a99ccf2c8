"""Recorded runs that are followed and smoothed, against the truth of the independent simulator."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from scipy.stats import chi2

from tests.adapt.cases import BEGIN_S, columns_of, follow, rig_of, route_of, scores
from tests.twins import drifting_friction, drifting_zeros, machine, sound, wet_sheath
from tssgeom.adapt.kinds import assumed_noise
from tssgeom.adapt.offline import RunFollower
from tssgeom.errors import SettingsError
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.moving import MovingRoute
from tssgeom.tendon.simulation import Measured

EVERY = 2  # 50 Hz; chosen: half of the time
WIDER = 1.5  # bars over errors of numbers that might begin to drift; docs/model.md (268)


@pytest.fixture(
    scope="module", params=[(drifting_friction, 1), (drifting_zeros, 2)], ids=["friction", "zeros"]
)
def case(request):
    make, seed = request.param
    scenario = make(seed, 0.06)
    run = follow(scenario, every=EVERY)
    assert run.alerts == ()
    return scenario, run, *scores(run, scenario)


def test_friction_is_followed_to_3_percent_and_the_zero_to_10_millinewtons(case):
    scenario, _, _, smoothed = case
    assert smoothed.worst[0] < 0.03 * scenario.machine.friction
    assert smoothed.rms[1] < 0.010


def test_all_readings_give_more_than_those_up_to_a_time(case):
    _, _, filtered, smoothed = case
    assert np.all(smoothed.rms < filtered.rms)
    # not at each moment: later readings also show a drift that was not known of then
    assert np.all(smoothed.se.mean(axis=0) < filtered.se.mean(axis=0))
    np.testing.assert_allclose(smoothed.se[-1], filtered.se[-1], rtol=1e-9)


def test_bands_hold_the_truth_about_as_often_as_they_promise(case):
    scenario, _, filtered, smoothed = case
    free = 2.0 * (scenario.times[-1] - BEGIN_S) / 60.0  # two numbers
    low, high = chi2.ppf([0.025, 0.975], free) / free
    for one in (filtered, smoothed):
        assert np.all(one.coverage > 0.85)  # an error lasts a minute, and few of them are in one run
        assert low / WIDER**2 < one.nees.mean() < high


def test_the_distal_tension_is_known_in_each_row_though_it_is_not_measured(case):
    scenario, run, _, _ = case
    truth, counts = scenario.truth["tension_out_N"][::EVERY], run.time > 30.0
    error = (run.ends[:, 1] - truth)[counts]
    assert np.sqrt(np.mean(error**2)) < 0.03
    assert run.lost == 0
    assert run.rig.friction.coefficient == run.last.values[0]


def test_bands_of_the_distal_tension_hold_an_error_that_a_turn_leaves():
    """At a stop the noise of the drive moves the tendon too far, and T_out keeps that for the next leg."""
    scenario = sound(16, 0.02)
    run = follow(scenario)
    error = run.ends[:, 1] - scenario.truth["tension_out_N"]
    squared = (error / run.ends_se[:, 1])[run.time > 30.0] ** 2
    assert 0.3 < squared.mean() < 2.0  # 16 where each leg forgets the turn before it


def test_after_a_fault_the_history_begins_anew_and_what_followed_it_is_left_out():
    scenario = wet_sheath(3, 0.05, whole=True)
    run = follow(scenario, every=2)
    alert = run.alerts[0]
    assert scenario.begins_s is not None
    assert alert.mechanism == "friction_over_time"
    assert scenario.begins_s - 1.0 < alert.since <= alert.time < scenario.begins_s + 15.0
    before, after = (stretch.numbers for stretch in run.stretches[:2])
    assert before.time[-1] < alert.since < alert.time < after.time[0]
    friction = np.interp([before.time[-1], after.time[-1]], scenario.times, scenario.truth["friction"])
    # the sheath is wet a little before the drive moves and the readings show it
    assert before.values[-1, 0] == pytest.approx(friction[0], rel=0.1) or alert.since > scenario.begins_s
    assert after.values[-1, 0] == pytest.approx(friction[1], rel=0.05)


def test_zeros_of_a_cell_that_is_not_there_are_not_followed():
    scenario = drifting_friction(1, 0.01)
    run = follow(scenario, every=10)
    assert run.keys == ("friction.coefficient", "tension_in_offset.offset_N")
    assert len(follow(scenario, every=10, tension_out=True).keys) == 3


def test_noise_that_no_rig_states_is_that_of_the_readings_or_of_exact_ones_assumed():
    scenario = drifting_friction(1, 0.01)
    stated = rig_of(scenario.machine)
    silent = msgspec.structs.replace(stated, sensors={})
    read = RunFollower(silent, route_of(scenario), columns_of(scenario))
    assert len(read.notes) == 2
    assert not RunFollower(stated, route_of(scenario), columns_of(scenario)).notes
    noise = {name: sensor.noise for name, sensor in read.rig.sensors.items()}
    assert noise == {name: pytest.approx(stated.sensors[name].noise, rel=0.1) for name in noise}
    columns = replace(columns_of(scenario), tension_in=scenario.truth["tension_in_N"])
    exact = RunFollower(silent, route_of(scenario), columns).rig.sensors
    assert exact["tension_in_N"].noise == assumed_noise("tension_in_N")


def test_a_run_without_readings_beside_its_drive_is_refused():
    scenario = drifting_friction(1, 0.01)
    given = machine(1)
    route = MovingRoute(np.zeros(1), [Arcs.exact(given.lengths_m, given.angles_rad)])
    alone = Measured(scenario.times, tension_in=scenario.readings["tension_in_N"])
    with pytest.raises(SettingsError, match="tension_in_N and no reading beside it"):
        RunFollower(rig_of(given), route, alone)
