"""What is known of the scenarios: their truth against balance and geometry, their readings against it."""

import itertools

import numpy as np
import pytest

from tests.twins import (
    CHANNELS,
    DRIFTS,
    FAULTS,
    acts_s,
    drifting,
    frames,
    machine,
    route_points,
    sound,
    unplugged,
)
from tests.twins.scenarios import drifts_of, friction_walk
from tssgeom import Rig
from tssgeom.sensed_route import fit_frame

HOURS = 0.03  # 108 s
ALL = DRIFTS | FAULTS
AFTER = 500  # samples: in the first stroke the tension is still that of rest


CASES = [(name, seed) for seed, name in enumerate(ALL)] + [("wet_sheath", 3)]  # 7 wets all of it, 3 a stretch


@pytest.fixture(scope="module", params=CASES, ids=lambda case: f"{case[0]}-{case[1]}")
def scenario(request):
    name, seed = request.param
    return ALL[name](seed, HOURS)


def loss(scenario):
    """[n] Log ratio of the true tensions, over the most that friction holds at that time."""
    truth, angle = scenario.truth, scenario.machine.total_angle_rad
    # a kink has the friction of its own stretch, which no fault changes beside it
    most = truth["friction"] * (angle + truth["kink_rad"])
    return np.log(truth["tension_in_N"] / truth["tension_out_N"]) / most


def test_the_loss_reaches_what_friction_holds_and_no_more(scenario):
    ratio = loss(scenario)
    begins = round((scenario.full_s or scenario.times[-1]) * 100)
    for part in (slice(AFTER, begins), slice(begins, None)):
        if len(ratio[part]) > 100:
            assert ratio[part].max() == pytest.approx(1.0, abs=3e-3)  # 96 cells; vertices of a kink: 0.1 rad
            assert ratio[part].min() == pytest.approx(-1.0, abs=3e-3)


def exponent(scenario, at, s):
    """[S] Friction times angle from the drive to arc lengths, at a sample."""
    given, truth = scenario.machine, scenario.truth
    angle, mean = given.angle_at(s), truth["friction"][at]
    if scenario.kind == "kinked_sheath":
        angle = angle + truth["kink_rad"][at] * np.interp(s, scenario.stretch_m, [0.0, 1.0])
    if scenario.kind != "wet_sheath":
        return mean * angle
    dry = given.friction * drifts_of(scenario.seed, HOURS).changes[0].at(scenario.times[at])
    wet = given.angle_at(np.clip(s, *scenario.stretch_m)) - given.angle_at(np.array(scenario.stretch_m[0]))
    return dry * angle - (dry - mean) * given.total_angle_rad * wet / wet[-1]


def test_the_elongation_after_a_full_pull_is_that_of_the_true_tendon(scenario):
    given, truth = scenario.machine, scenario.truth
    full = np.flatnonzero(loss(scenario) > 0.9995)
    assert len(full) > 20
    s = np.linspace(0.0, given.length_m, 2001)
    for at in full[::10]:
        pull = np.trapezoid(np.exp(-exponent(scenario, at, s)), s) * truth["tension_in_N"][at]
        elongation = truth["compliance_per_N"][at] * pull + truth["tendon_longer_m"][at]
        elongation -= given.compliance_per_N * given.length_m * given.pretension_N
        ends = truth["displacement_in_m"][at] - truth["displacement_out_m"][at]
        # measured: 1 µm by the cells, 2 µm where the first part of the route has not yet slid
        assert -1.5e-6 - truth["play_m"][at] < ends - elongation < 3e-6


def test_the_load_is_a_spring(scenario):
    given, truth = scenario.machine, scenario.truth
    force = truth["tension_out_N"] - given.pretension_N
    assert truth["displacement_out_m"] == pytest.approx(force / given.stiffness_N_per_m, abs=1e-12)


def test_readings_are_truth_and_zero_and_noise(scenario):
    until = len(scenario.times) if scenario.channel is None else round(scenario.begins_s * 100)
    for name in CHANNELS:
        off = scenario.readings[name] - scenario.truth[name] - scenario.truth[f"zero_{name}"]
        noise = scenario.machine.noise[name]
        assert off[:until].std() == pytest.approx(noise, rel=0.1)  # 1/√10 800 = 1 % is one standard error
        assert abs(off[:until].mean()) < 0.1 * noise
        if scenario.channel == name:
            assert np.all(scenario.readings[name][until:] == 0.0)
            assert np.ptp(scenario.truth[name][until:]) > 50.0 * noise


def test_tension_stays_within_what_the_machine_is_for(scenario):
    tension = scenario.truth["tension_in_N"][AFTER:]
    assert tension.max() < 25.5
    # a frayed tendon gives way by 0.5 mm and more
    assert tension.min() > (0.0 if scenario.kind == "frayed_tendon" else 2.0)
    assert np.ptp(tension) > 10.0


def test_a_scenario_has_one_row_for_each_sample(scenario):
    names = ["friction", "compliance_per_N", "tendon_longer_m", "play_m", "kink_rad", "route_angle_gain"]
    assert list(scenario.truth) == [*names, *(f"zero_{name}" for name in CHANNELS), *CHANNELS]
    assert list(scenario.readings) == list(CHANNELS)
    assert {v.shape for v in (*scenario.truth.values(), *scenario.readings.values())} == {(10_800,)}
    assert np.diff(scenario.times) == pytest.approx(0.01, abs=1e-9)
    assert (scenario.begins_s is not None) == (scenario.kind in FAULTS)
    assert scenario.kind in ALL


@pytest.mark.parametrize("scenario", [case for case in CASES if case[0] in FAULTS], indirect=True)
def test_a_fault_has_its_size_from_its_time_on(scenario):
    plain = drifting(scenario.seed, HOURS)
    before, after = scenario.times < scenario.begins_s, scenario.times >= scenario.full_s
    sizes = {
        "frayed_tendon": {"compliance_per_N": 1.6, "tendon_longer_m": 5e-4},
        "kinked_sheath": {"kink_rad": 0.8},
    }.get(scenario.kind, {})
    for name, values in scenario.truth.items():
        if name not in CHANNELS:
            assert np.array_equal(values[before], plain.truth[name][before])
        if name in sizes:
            nominal = plain.truth[name][0] if name == "compliance_per_N" else 1.0
            assert values[after] == pytest.approx(sizes[name] * nominal, rel=1e-9)
    assert 0.4 <= scenario.begins_s / (HOURS * 3600.0) <= 0.6
    if scenario.kind == "wet_sheath":
        fallen = scenario.truth["friction"][after] / plain.truth["friction"][after]
        whole = scenario.stretch_m == (0.0, scenario.machine.length_m)
        assert whole == (scenario.seed == 7)
        assert np.all(np.abs(fallen - 0.45) < 1e-9) if whole else np.all((fallen > 0.45) & (fallen < 0.9))
        assert np.ptp(fallen) < 1e-9
    if scenario.kind == "wrong_shape":
        gain = scenario.truth["route_angle_gain"]
        assert set(gain[before]) == {1.0}
        assert set(gain[after]) <= {0.75, 1.25}
        assert np.array_equal(scenario.truth["tension_in_N"], plain.truth["tension_in_N"])


def test_a_fault_acts_when_it_begins_or_in_the_motion_after(scenario):
    acts = acts_s(scenario)
    if scenario.kind == "unplugged_tension_out_N":
        assert acts is None
        assert acts_s(scenario, ["tension_out_N"]) == scenario.begins_s
    elif scenario.begins_s is None:
        assert acts is None
    else:
        assert scenario.begins_s <= acts < scenario.begins_s + 30.0


def test_drifts_have_their_size_within_an_hour():
    at = np.linspace(0.0, 3600.0, 1000)
    for seed in range(20):
        plan = drifts_of(seed, 1.0)
        factor = plan.changes[0].at(at)
        assert (factor.min(), factor.max(), factor[0]) == pytest.approx((0.7, 1.3, 1.0), abs=1e-4)
        for zero in plan.zeros.values():
            assert 0.1 <= np.abs(np.interp(at, *zero)).max() <= 0.3
        walk = friction_walk(seed, 6.0).values
        assert walk[0] == pytest.approx(1.0, abs=1e-12)
        assert np.abs(walk - 1.0).max() <= 0.3 + 1e-12
        assert np.ptp(walk) > 0.3


def test_a_seed_gives_its_digits_and_a_longer_run_begins_as_a_shorter_one():
    one, again, longer, other = sound(1, 0.01), sound(1, 0.01), sound(1, 0.02), sound(2, 0.01)
    for name in CHANNELS:
        assert np.array_equal(one.readings[name], again.readings[name])
        assert np.array_equal(one.truth[name], longer.truth[name][: len(one.times)])
    assert other.machine.friction != one.machine.friction


def test_a_sensor_that_holds_reads_its_last_value():
    scenario = unplugged(3, 0.01, "displacement_in_m", "hold")
    read = scenario.readings["displacement_in_m"][scenario.times >= scenario.begins_s]
    assert np.ptp(read) == 0.0
    assert read[0] != 0.0


def test_motion_has_strokes_of_many_depths_and_dwells():
    moved = sound(4, 0.1).truth["displacement_in_m"]
    still = np.abs(np.diff(moved)) == 0.0
    assert 0.05 < still.mean() < 0.6
    turns = moved[1:-1][(np.diff(moved)[:-1] > 0.0) & (np.diff(moved)[1:] <= 0.0)]
    assert len(turns) > 20
    assert turns.std() > 0.1 * turns.mean()


@pytest.mark.parametrize("spatial", [False, True])
def test_points_have_the_lengths_and_angles_of_the_pieces(spatial):
    given = machine(5)
    step = np.diff(route_points(given.lengths_m, given.angles_rad, 20_001, spatial), axis=0)
    length = np.linalg.norm(step, axis=1)
    across = np.linalg.norm(np.cross(step[1:], step[:-1]), axis=1)
    turned = np.arctan2(across, np.sum(step[1:] * step[:-1], axis=1))
    assert length.sum() == pytest.approx(given.length_m, rel=1e-6)
    assert turned.sum() == pytest.approx(given.total_angle_rad, rel=1e-3)
    rank = np.linalg.matrix_rank(step, tol=1e-9)
    assert rank == (3 if spatial else 2)


def test_frames_hold_readings_and_the_same_points_while_nothing_is_wrong():
    scenario = FAULTS["wrong_shape"](6, HOURS)
    taken = list(itertools.islice(frames(scenario, every=100, tension_out=True), 50))
    assert all(frame.points is taken[0].points for frame in taken)
    for k, frame in enumerate(taken):
        assert frame.time == scenario.times[100 * k]
        assert frame.tension_in == scenario.readings["tension_in_N"][100 * k]
        assert frame.displacement_in == scenario.readings["displacement_in_m"][100 * k]
        assert frame.tension_out == scenario.readings["tension_out_N"][100 * k]
    assert next(frames(scenario)).tension_out is None
    noisy = next(frames(scenario, noise_m=1e-4)).points - taken[0].points
    assert noisy.std() == pytest.approx(1e-4, rel=0.3)


def test_the_angle_that_frames_state_has_the_gain_of_their_time():
    scenario = FAULTS["wrong_shape"](6, HOURS)
    first, *_, last = frames(scenario, every=1000, points=200)
    angles = [fit_frame(frame, Rig())[1].fit.arcs.angle.sum() for frame in (first, last)]
    assert angles[0] == pytest.approx(scenario.machine.total_angle_rad, rel=0.01)  # corners of 200 points
    assert angles[1] / angles[0] == pytest.approx(scenario.truth["route_angle_gain"][-1], rel=0.01)
