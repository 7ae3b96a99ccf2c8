"""A whole run through the model: both ways of a step, the corner list, rates, holds, errors."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.effects.rig import ARCS, FORCE, POSITION, RIG, RUNS, TIME, modelled
from tests.tendon.bars import with_laws
from tests.tendon.steps import pretensioned_bars, step
from tssgeom.core.constants_tendon_rows import PLANT
from tssgeom.effects import (
    KINDS,
    Backlash,
    ChannelLag,
    Creep,
    EndFittingFrictionProximal,
    HiddenBend,
    LoadPlay,
    VelocityDependentFriction,
    ViscousDrag,
    with_size,
)
from tssgeom.effects.kinds import DISTAL, Bend, Setup
from tssgeom.errors import FitError, SettingsError
from tssgeom.identify.drive import calmed
from tssgeom.rig import Load, Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon import capstan as profile
from tssgeom.tendon.bars.contact_grid import edges, with_bends
from tssgeom.tendon.bars.model import CHANNELS, begin, carry_on, moved, predict, prepare
from tssgeom.tendon.capstan import transmit

SWIFT = [
    name
    for name, kind in KINDS.items()
    if prepare(RUNS[FORCE], ARCS, RIG, [with_size(kind)]).plant.number(PLANT.swift)
]


def test_only_what_moves_the_tendon_by_itself_or_by_its_speed_takes_the_long_way():
    assert set(KINDS) - set(SWIFT) == {
        "velocity_dependent_friction",
        "viscous_drag",
        "presliding",
        "creep",
        "thermal_drift",
    }


@pytest.mark.parametrize("drive", [FORCE, POSITION])
@pytest.mark.parametrize("name", SWIFT)
def test_the_sweep_is_the_balance_of_all_contacts(name, drive):
    model = prepare(RUNS[drive], ARCS, RIG, [with_size(KINDS[name])])
    slow = replace(model, plant=with_laws(model.plant, swift=0.0))
    short, long = (carry_on(m, begin(m), RUNS[drive])[0].channels for m in (model, slow))
    for channel in CHANNELS:  # the balance leaves 1e-8 N to its passes
        assert np.abs(short[channel] - long[channel]).max() < {"N": 1e-7, "m": 1e-11}[channel[-1]]


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(0.0, 20.0), min_size=2, max_size=30))
def test_the_base_is_the_corner_list(pulls):
    rig = Rig(tendon=Tendon(pretension_N=2.0))
    run = {"time_s": np.arange(len(pulls), dtype=float), FORCE: np.array(pulls)}
    observed, state = predict(run, ARCS, rig, bars=60), profile.pretensioned(rig)
    for i, pull in enumerate(pulls):
        state = profile.step(state, pull, rig.friction.coefficient)
        exact = transmit(state, ARCS, rig)
        assert observed["tension_out_N"][i] == pytest.approx(
            exact.tension_out, abs=1e-9
        )  # exact for any bars
        assert observed["elongation_m"][i] == pytest.approx(exact.elongation, abs=2e-6)  # 60 bars, 3e-3 m


def both_ways(kind):
    """Whether a position determines the tension that gave it, at the samples alone.

    Behind backlash or a fitting at the drive it does not; where the steps within a sample matter, tension and
    position cannot both be straight in time.
    """
    setup = with_size(kind).on(Setup(0.2, 0.0, 2.0, 3000.0))
    at_the_drive = setup.backlash_m or setup.fitting_in_N
    return not (at_the_drive or setup.drag_Ns_per_m2 or setup.speed_gain)


@pytest.mark.parametrize(
    "name", [name for name, kind in KINDS.items() if kind.hook != "observation" and both_ways(kind)]
)
def test_driving_by_the_position_that_a_tension_gave_gives_the_tension(name):
    effect = with_size(KINDS[name])
    forced = modelled(FORCE, effect)
    moving = np.flatnonzero(np.abs(np.diff(RUNS[FORCE][FORCE])) > 0.0) + 1  # in a hold T_in is not unique
    back = predict(RUNS[FORCE] | {POSITION: forced[POSITION]}, ARCS, RIG, [effect], drive=POSITION)
    assert back["tension_out_N"] == pytest.approx(forced["tension_out_N"], abs=1e-5)
    if name != "thermal_drift":
        assert back[FORCE][moving] == pytest.approx(forced[FORCE][moving], abs=1e-5)


@pytest.mark.parametrize(
    "effect", [ViscousDrag(coefficient_Ns_per_m2=300.0), VelocityDependentFriction(gain=0.08)]
)
def test_friction_by_rate_converges_with_the_step(effect):
    steps = [modelled(FORCE, effect, longest_step_s=s)["tension_out_N"] for s in (0.2, 0.05, 0.0125, 0.003)]
    coarse, mid, fine = (np.sqrt(np.mean((s - steps[-1]) ** 2)) for s in steps[:-1])
    size = np.sqrt(np.mean((steps[-1] - modelled(FORCE)["tension_out_N"]) ** 2))
    assert coarse < 0.2 * size  # most of it in the sample in which the far end starts
    assert mid < 0.8 * coarse  # the steps after a turn are fine already
    assert fine < 0.6 * mid
    assert fine < 0.06 * size
    locked = steps[0][112:115] - steps[-1][112:115]
    assert np.abs(locked).max() < 0.15 * size  # what a turn leaves behind: 1.1 without the steps after it


@pytest.mark.parametrize("drive", [FORCE, POSITION])
def test_a_hold_changes_nothing_without_creep_and_does_with_it(drive):
    held = slice(21, 31)
    still, creeping = modelled(drive), modelled(drive, Creep(ratio=0.06))
    for channel in CHANNELS:
        assert np.ptp(still[channel][held]) == 0.0
    assert np.ptp(creeping["elongation_m"][held]) > 1e-6


def test_slow_and_fast_runs_are_one_where_no_effect_asks_for_time():
    slow = predict(RUNS[FORCE] | {"time_s": 100.0 * TIME}, ARCS, RIG)
    for channel in CHANNELS:
        assert np.array_equal(slow[channel], modelled(FORCE)[channel])


def test_a_tendon_that_is_given_more_than_it_takes_hangs_slack():
    run = {"time_s": np.arange(4.0), POSITION: np.array([0.0, 3e-3, -2e-3, 3e-3])}
    observed = predict(run, ARCS, RIG)
    assert observed["tension_in_N"][2] == 0.0
    assert observed["tension_out_N"][2] == 0.0
    assert observed["tension_in_N"][3] == pytest.approx(observed["tension_in_N"][1], rel=1e-9)


def test_a_dead_weight_keeps_its_tension_and_runs_away_beyond_the_cone():
    rig = Rig(tendon=Tendon(pretension_N=5.0), load=Load(stiffness_N_per_m=0.0))
    observed = predict({"time_s": TIME[:40], POSITION: 1e-3 * TIME[:40]}, ARCS, rig)
    assert observed["tension_out_N"] == pytest.approx(np.full(40, 5.0), abs=1e-12)
    assert observed["displacement_out_m"][-1] > 1e-3
    with pytest.raises(FitError, match=r"no equilibrium .* at 1 s, tension_in_N 20"):
        predict({"time_s": np.arange(3.0), FORCE: np.array([5.0, 20.0, 5.0])}, ARCS, rig)


def test_a_lag_that_is_asked_for_in_a_ramp_stays_behind_by_its_time():
    run = {"time_s": TIME, FORCE: 2.0 + 0.5 * TIME}
    lag = ChannelLag(lag_s=0.3, channel="displacement_in_m")
    plain, late = predict(run, ARCS, RIG)[POSITION], predict(run, ARCS, RIG, [lag])[POSITION]
    speed = (plain[-1] - plain[-2]) / (TIME[-1] - TIME[-2])
    assert late[-1] == pytest.approx(plain[-1] - 0.3 * speed, abs=1e-9)  # e^(−24/0.3) is left


def test_backlash_is_lost_at_a_turn_and_regained_at_the_next():
    gap = modelled(FORCE, Backlash(width_m=2e-4))[POSITION] - modelled(FORCE)[POSITION]
    assert gap[[30, 45, 60]] == pytest.approx([0.0, -2e-4, 0.0], abs=1e-12)


def test_play_of_the_load_is_read_at_both_channels_of_its_way_and_behind_a_lag():
    out, width = "displacement_out_m", 2e-4
    true, read = modelled(FORCE), modelled(FORCE, LoadPlay(width_m=width))
    lost, at = [], true[out][0]
    for x in true[out]:
        at = min(max(at, x), x + width)
        lost.append(x - at)
    assert np.ptp(lost) == pytest.approx(width, rel=1e-12)
    assert read[out] == pytest.approx(true[out] - lost, abs=1e-15)
    assert read["elongation_m"] == pytest.approx(true["elongation_m"] + lost, abs=1e-15)
    assert all((read[name] == true[name]).all() for name in (FORCE, POSITION, "tension_out_N"))
    lag = ChannelLag(lag_s=0.5, channel=out)
    model = prepare(RUNS[FORCE], ARCS, RIG, [LoadPlay(width_m=width), lag])
    first, second = (
        {name: each[rows] for name, each in RUNS[FORCE].items()} for rows in (slice(40), slice(40, None))
    )
    begun, state = carry_on(model, begin(model), first)
    rest, _ = carry_on(model, state, second)
    whole = modelled(FORCE, LoadPlay(width_m=width), lag)[out]
    assert np.concatenate((begun.channels[out], rest.channels[out])) == pytest.approx(whole, abs=1e-15)
    assert np.abs(whole - read[out]).max() > 1e-5


@pytest.mark.parametrize("delay", [0.05, 0.5, 3.0])
def test_a_late_recorder_reads_all_distal_channels_as_they_were(delay):
    true, late = modelled(POSITION), ChannelLag(lag_s=delay, channel="distal")
    read = modelled(POSITION, late)
    for name in CHANNELS:
        was = np.interp(TIME - delay, TIME, true[name]) if name in DISTAL else true[name]
        assert read[name] == pytest.approx(was, abs=1e-12)
    model = prepare(RUNS[POSITION], ARCS, RIG, [late])
    state, parts = begin(model), list[dict[str, np.ndarray]]()
    for rows in (slice(1), slice(1, 2), slice(2, 40), slice(40, None)):
        trace, state = carry_on(model, state, {name: each[rows] for name, each in RUNS[POSITION].items()})
        parts.append(trace.channels)
    for name in CHANNELS:
        whole = np.concatenate([each[name] for each in parts])
        assert whole == pytest.approx(read[name], abs=1e-9)  # times are added up from another start


def test_a_late_recorder_stores_what_a_filter_has_left_of_a_channel():
    slow, late = ChannelLag(lag_s=0.4), ChannelLag(lag_s=0.5, channel="distal")
    filtered = modelled(POSITION, slow)["tension_out_N"]
    model = prepare(RUNS[POSITION], ARCS, RIG, [slow, late])
    first, second = (
        {name: each[rows] for name, each in RUNS[POSITION].items()} for rows in (slice(40), slice(40, None))
    )
    begun, state = carry_on(model, begin(model), first)
    rest, _ = carry_on(model, state, second)
    read = np.concatenate([each.channels["tension_out_N"] for each in (begun, rest)])
    assert read == pytest.approx(np.interp(TIME - 0.5, TIME, filtered), abs=1e-9)


@pytest.mark.parametrize(("at", "width"), [(0.0, 0.02), (0.25, 0.02), (0.5, 0.02), (0.2, 1e-6), (0.7, 0.02)])
def test_a_hidden_bend_keeps_the_length_and_adds_its_angle(at, width):
    setup = Setup(0.1, 1e-4, 0.0, 1e3, bends=(Bend(at, 0.6, width),))
    length, angle = with_bends(setup, ARCS).length, with_bends(setup, ARCS).angle
    assert length.sum() == pytest.approx(0.5, rel=1e-14)
    assert angle.sum() == pytest.approx(ARCS.total_angle + 0.6, rel=1e-14)
    assert length.min() > 0.0


def test_bars_follow_bends_and_begin_small():
    cut = edges(ARCS, 30)
    assert cut[0] == 0.0
    assert cut[-1] == 1.0
    assert np.diff(cut).min() > 0.0
    assert np.diff(cut)[0] < 0.01
    turned = np.interp(
        0.5 * cut,
        np.concatenate(([0.0], np.cumsum(ARCS.length))),
        np.concatenate(([0.0], np.cumsum(ARCS.angle))),
    )
    assert np.diff(turned).max() < 0.35  # rad: the mean tension of a sliding bar is right to 1e-4


@pytest.mark.parametrize(
    ("run", "effects", "reported"),
    [
        ({"time_s": TIME}, (), r"the run has no drive: it needs a column tension_in_N"),
        ({"time_s": TIME[::-1], FORCE: TIME}, (), r"time_s goes from 24 to 23.8 s: give increasing"),
        (
            {"time_s": TIME, FORCE: np.where(TIME == 0.4, np.nan, 3.0)},
            (),
            r"tension_in_N is missing in sample 2",
        ),
        ({"time_s": TIME, FORCE: TIME}, (ChannelLag(lag_s=0.1), ChannelLag(lag_s=0.2)), r"lags twice"),
        (
            {"time_s": TIME, FORCE: TIME},
            (ChannelLag(lag_s=0.1, channel="distal"), ChannelLag(lag_s=0.2, channel="distal")),
            r"distal lags twice",
        ),
    ],
)
def test_a_run_that_cannot_be_gone_through_is_refused(run, effects, reported):
    with pytest.raises(SettingsError, match=reported):
        predict(run, ARCS, RIG, effects)


def test_a_tendon_that_does_not_stretch_is_refused():
    with pytest.raises(SettingsError, match=r"compliance_per_N is 0 1/N: a tendon of bars has to stretch"):
        predict(RUNS[FORCE], ARCS, Rig(tendon=Tendon(compliance_per_N=0.0)))


def test_a_fitting_that_holds_leaves_the_tendon_behind_it_as_it_was():
    # Released to 0.47 N and pulled to 0.55 N: the fitting holds 0.6 N, nothing behind it moves, either way.
    run = {"time_s": np.arange(4.0), FORCE: np.array([0.0, 5.88, 0.47, 0.55])}
    arcs, rig = Arcs.exact(np.array([0.3]), np.array([1.0])), Rig(load=Load(stiffness_N_per_m=100.0))
    model = prepare(run, arcs, rig, [EndFittingFrictionProximal(force_N=0.6, ratio=0.1)])
    slow = replace(model, plant=with_laws(model.plant, swift=0.0))
    for way in (model, slow):
        tension = carry_on(way, begin(way), run, profile=True)[0].tension
        assert tension[3, 1:] == pytest.approx(tension[2, 1:], abs=1e-9)


def test_two_hidden_bends_act_both():
    one, two = HiddenBend(at_m=0.1, angle_rad=0.3), HiddenBend(at_m=0.4, angle_rad=0.3)
    sizes = [modelled(FORCE, *e)["tension_out_N"][30] for e in ((), (one,), (one, two))]
    assert sizes[2] / sizes[0] == pytest.approx(np.exp(-0.145 * 0.6), rel=1e-9)
    assert sizes[1] / sizes[0] == pytest.approx(np.exp(-0.145 * 0.3), rel=1e-9)


@pytest.mark.parametrize("drive", [FORCE, POSITION])
def test_on_a_moving_route_one_sample_at_a_time_is_the_step_without_effects(drive):
    run = {key: column[:60] for key, column in RUNS[drive].items()}
    model = prepare(run, ARCS, RIG)
    state = begin(model)
    bars = pretensioned_bars(RIG, ARCS, len(model.edge) - 1)._replace(edge=model.edge)
    for i in range(60):
        route = Arcs.exact(ARCS.length, ARCS.angle * (1.0 + 0.5 * np.sin(0.3 * i + np.arange(4))))
        trace, state = carry_on(
            moved(model, route), state, {key: column[i : i + 1] for key, column in run.items()}
        )
        drives = {"tension_in" if drive == FORCE else "displacement_in": run[drive][i]}
        bars = step(bars, route, RIG, **drives)
        assert trace.channels["tension_in_N"][0] == pytest.approx(bars.tension_in, abs=1e-7)
        assert trace.channels["tension_out_N"][0] == pytest.approx(bars.tension_out, abs=1e-7)
        assert trace.channels["displacement_out_m"][0] == pytest.approx(bars.displacement_out, abs=1e-10)


def test_the_profile_runs_from_drive_to_load():
    model = prepare(RUNS[FORCE], ARCS, RIG)
    trace, _ = carry_on(model, begin(model), RUNS[FORCE], profile=True)
    assert np.array_equal(trace.tension[:, 0], trace.channels["tension_in_N"])
    assert np.array_equal(trace.tension[:, -1], trace.channels["tension_out_N"])
    assert set(np.unique(trace.slip_out)) == {-1.0, 0.0, 1.0}


def noisy(seed, samples=481, noise=0.05):
    time = np.linspace(0.0, 24.0, samples)
    pulls = np.interp(time, TIME, RUNS[FORCE][FORCE])
    return time, pulls, pulls + noise * np.random.default_rng(seed).standard_normal(samples)


def test_a_calmed_drive_leaves_no_noise_locked_in_a_hold():
    errors = []
    for seed in range(8):
        time, pulls, read = noisy(seed)
        observed = [
            predict({"time_s": time, FORCE: d}, ARCS, RIG)["tension_out_N"]
            for d in (pulls, read, calmed(read, 0.05))
        ]
        held = (time > 4.5) & (time < 6.0)
        errors.append([np.mean((s - observed[0])[held]) for s in observed[1:]])
    raw, calm = np.mean(errors, axis=0)
    assert raw > 0.04  # near one standard deviation of the noise, the same in every run
    assert abs(calm) < 0.02


def test_a_calmed_drive_is_monotone_between_its_turns_and_a_clean_one_stays_as_it_is():
    time, pulls, read = noisy(3)
    calm = calmed(read, 0.05)
    for start, stop, sign in ((0.0, 3.9, 1), (6.5, 8.8, -1), (9.3, 11.7, 1), (12.4, 14.7, -1)):
        assert (sign * np.diff(calm[(time > start) & (time < stop)])).min() >= 0.0
    assert np.abs(calm - pulls).max() < 0.25  # five standard deviations: legs meet between samples
    assert calmed(pulls, 0.0) is pulls
    assert calmed(pulls, 1e-9) == pytest.approx(pulls, abs=1e-8)
