"""The engine carries the tendon from frame to frame, whatever drives it and whatever the route does."""

import math
from dataclasses import replace

import numpy as np
import pytest
from msgspec.structs import replace as changed

from tssgeom.effects import Creep, HiddenBend, ThermalDrift
from tssgeom.engine import process
from tssgeom.rig import Friction, Rig, ShapeSensor
from tssgeom.sensed_route import sensed_route
from tssgeom.stream import Frame, FrameResult, Rejected, pulled
from tssgeom.tendon.bars.bar_state import BarState
from tssgeom.tendon.capstan import Corners
from tssgeom.tendon.state import pretensioned

RIG = Rig(shape=ShapeSensor(noise_mm=0.1))


def bend(count=60, angle=math.pi, seed=0):
    """Noisy points on an arc of 0.5 m [m]."""
    turn = np.linspace(0.0, angle, count)
    flat = 0.5 / angle * np.column_stack((np.sin(turn), 1 - np.cos(turn), 0 * turn))
    return flat + np.random.default_rng(seed).normal(0.0, 1e-4, flat.shape)


def results(frames, **options):
    return list(process(frames, RIG, tension_in=15.0, **options))


def moving_run():
    """A bend that opens under a pull and a release, the number of points changing."""
    tensions = (5.0, 12.0, 15.0, 15.0, 9.0, 4.0)
    return [
        Frame(bend(50 + 5 * k, 3.0 - 0.2 * k, k), float(k), tension_in=tension)
        for k, tension in enumerate(tensions)
    ]


def test_live_equals_batch():
    frames = moving_run()
    batch = results(frames)
    coming = process(iter(frames), RIG, tension_in=15.0)
    live = [next(coming) for _ in frames]
    assert [one.transmission for one in live] == [one.transmission for one in batch]
    half = results(frames[:3])
    again = results(frames[3:], state=half[-1].state)  # the fits start anew, the tendon goes on
    assert again[-1].transmission.direction_index == batch[-1].transmission.direction_index
    assert again[-1].transmission.tension_in == batch[-1].transmission.tension_in


def test_the_tendon_survives_a_changing_number_of_points_under_load():
    moved = results(moving_run())
    assert isinstance(moved[-1].state.along, BarState)
    assert moved[-1].transmission.tension_in == pytest.approx(4.0, rel=1e-9)
    # released from 15 N, the distal end still feels more than the drive gives
    assert moved[-1].transmission.tension_out > 4.0


def test_a_route_that_stands_still_stays_exact_in_spite_of_noise():
    frames = [
        Frame(bend(seed=k), float(k), tension_in=tension) for k, tension in enumerate((8.0, 15.0, 10.0))
    ]
    still = results(frames)
    assert isinstance(still[-1].state.along, Corners)
    last, before = still[-1].transmission, still[-2].transmission
    assert last.dead_zone
    # the route is known better by the last frame
    assert abs(last.tension_out - before.tension_out) < 2.0 * before.tension_out_se


def test_a_measured_displacement_drives_frames_that_bring_no_tension():
    by_force = results([Frame(bend(), float(k), tension_in=t) for k, t in enumerate((10.0, 15.0, 8.0))])
    positions = [one.transmission.displacement_in for one in by_force]
    by_position = results([Frame(bend(), float(k), displacement_in=x) for k, x in enumerate(positions)])
    for one, other in zip(by_position, by_force, strict=True):
        # bars against corners: 5e-4 of δ, over a load spring of 1 N/mm and a tendon of 6 N/mm
        assert one.transmission.tension_out == pytest.approx(other.transmission.tension_out, rel=1e-3)
    both = results([Frame(bend(), 0.0, tension_in=10.0, displacement_in=0.5)])
    assert both[0].transmission.tension_in == pytest.approx(10.0)


def test_a_target_without_a_drive_is_taken_as_reached():
    frames = [Frame(bend(), float(k), displacement_target=x) for k, x in enumerate((2e-3, 6e-3, 5e-3))]
    for frame, one in zip(frames, results(frames), strict=True):
        assert one.transmission.displacement_out == pytest.approx(frame.displacement_target, rel=1e-9)
        assert one.displacement_command == one.transmission.displacement_in
        assert one.tension_command == one.transmission.tension_in


def test_a_target_beside_a_measured_drive_is_advice_and_moves_nothing():
    plain = Frame(bend(), 0.0, tension_in=10.0)
    advised = replace(plain, tension_out_target=9.0)
    (without,), (with_target,) = results([plain]), results([advised])
    assert with_target.transmission == without.transmission
    assert without.displacement_command is None
    assert with_target.tension_command == pytest.approx(
        9.0 * math.exp(0.145 * with_target.state.route.total_angle), rel=1e-9
    )


def test_commands_do_not_chatter_while_a_target_is_held_on_a_noisy_route():
    frames = [Frame(bend(seed=k), float(k), displacement_target=6e-3) for k in range(12)]
    commands = [one.displacement_command for one in results(frames)]
    # the tendon may be discretised anew once the route is known better; one reversal would be 0.1 mm and more
    assert np.ptp(commands) < 1e-6


def test_a_target_out_of_reach_leaves_the_tendon_as_it_was():
    frames = [
        Frame(bend(), 0.0, tension_in=10.0),
        Frame(bend(), 1.0, displacement_target=-1.0),
        Frame(bend(), 2.0, tension_in=10.0),
    ]
    first, bad, last = results(frames)
    assert isinstance(bad, Rejected)
    assert "only pulls" in bad.reason
    assert isinstance(last, FrameResult)
    assert last.transmission == first.transmission


# --- effects ------------------------------------------------------------------------------------------------

SOME = (HiddenBend(at_m=0.2, angle_rad=0.6), Creep(ratio=0.1), ThermalDrift(expansion_per_K=1e-5))
EFFECTS = changed(RIG, effects=SOME)


def warmed_run():
    return [replace(frame, temperature=20.0 + frame.time) for frame in moving_run()]


def test_live_equals_batch_with_effects():
    frames = warmed_run()
    batch = list(process(frames, EFFECTS, tension_in=15.0))
    coming = process(iter(frames), EFFECTS, tension_in=15.0)
    assert [next(coming).transmission for _ in frames] == [one.transmission for one in batch]
    half = list(process(frames[:3], EFFECTS, tension_in=15.0))[-1]
    by_hand, last = half.state, half.tracked
    for seq, frame in enumerate(frames[3:], 3):
        result = pulled(seq, frame, by_hand, EFFECTS, 15.0, sensed_route(frame, EFFECTS, last))
        by_hand, last = result.state, result.tracked
        assert result.transmission == batch[seq].transmission


def test_a_hidden_bend_takes_its_share_on_a_route_that_moves():
    bent = changed(RIG, effects=(HiddenBend(at_m=0.2, angle_rad=0.6),))
    frames = moving_run()[:3]  # a pull while the bend opens
    for one, other in zip(process(frames, bent, tension_in=15.0), results(frames), strict=True):
        share = one.transmission.tension_out / other.transmission.tension_out
        # the distal end slides on all three frames, through the bend as well
        assert share == pytest.approx(math.exp(-0.145 * 0.6), rel=1e-6)


def test_a_frame_without_temperature_says_what_does_nothing():
    warm, cold = (list(process(run(), EFFECTS, tension_in=15.0)) for run in (warmed_run, moving_run))
    assert not any("temperature" in text for one in warm for text in one.warnings)
    assert all("no temperature_C: thermal_drift does nothing" in one.warnings for one in cold)


def test_a_target_beside_a_drive_is_advice_with_effects_too():
    frame = Frame(bend(), 1.0, tension_in=10.0, tension_out_target=7.0, temperature=20.0)
    (result,) = process([frame], EFFECTS, tension_in=15.0)
    assert result.transmission.tension_in == 10.0
    (followed,) = process(
        [replace(frame, tension_in=None)], EFFECTS, tension_in=15.0, state=pretensioned(EFFECTS, 0.0)
    )
    assert followed.transmission.tension_out == pytest.approx(7.0, rel=1e-9)
    assert followed.tension_command == followed.transmission.tension_in


def test_the_noise_of_a_frame_counts_unless_the_rig_states_its_own():
    result = next(process([Frame(bend(), noise=3e-4)], Rig(), tension_in=15.0))
    of_the_rig = next(process([Frame(bend(), noise=3e-4)], RIG, tension_in=15.0))
    assert isinstance(result, FrameResult)
    assert isinstance(of_the_rig, FrameResult)
    assert result.route.noise == pytest.approx(3e-4)
    assert of_the_rig.route.noise == pytest.approx(1e-4)
    assert result.arcs.total_angle_se > 1.5 * of_the_rig.arcs.total_angle_se


@pytest.mark.parametrize("noise", [0.0, -1e-4, math.nan, math.inf])
def test_a_noise_that_is_none_is_refused(noise):
    refused = next(process([Frame(bend(), noise=noise)], Rig(), tension_in=15.0))
    assert isinstance(refused, Rejected)
    assert "the noise is" in refused.reason


def test_a_command_that_no_tendon_bears_is_rejected():
    asked = Frame(bend(), 0.0, tension_in=5.0, displacement_target=2.0)  # millimetres, sent as metres
    (result,) = results([asked])
    assert isinstance(result, Rejected)
    assert "would stretch the tendon by" in result.reason


@pytest.mark.parametrize(("pull", "strain"), [(1e300, "3.16e+298%"), (3000.0, "94.8%")])
def test_a_tension_that_strains_the_tendon_beyond_half_is_refused(pull, strain):
    (refused,) = results([Frame(bend(), tension_in=pull)])
    assert isinstance(refused, Rejected)
    assert refused.reason.startswith(f"{pull:g} N would stretch the tendon by {strain}: ")


def test_a_hidden_bend_beyond_the_route_has_a_warning():
    rig = changed(RIG, effects=(HiddenBend(at_m=7.0, angle_rad=0.6),))
    (result,) = process([Frame(bend())], rig, tension_in=15.0)
    (warning,) = result.warnings
    assert warning.startswith("hidden_bend at 7 m on a route of 0.5 m: ")


@pytest.mark.parametrize("asked", [{"displacement_in": 1e-3}, {"displacement_target": 1e-3}])
def test_friction_that_lets_nothing_through_is_refused_where_it_would_overflow(asked):
    rig = changed(RIG, friction=Friction(coefficient=1e6))
    (result,) = process([Frame(bend(), **asked)], rig, tension_in=15.0)
    assert isinstance(result, Rejected)
    assert "nothing gets through" in result.reason


def test_a_target_that_friction_keeps_out_of_reach_is_refused_with_the_reason():
    rig = changed(RIG, friction=Friction(coefficient=10.0))
    (result,) = process([Frame(bend(), displacement_target=1e-3)], rig, tension_in=15.0)
    assert isinstance(result, Rejected)
    assert "1 N at the distal end need" in result.reason
