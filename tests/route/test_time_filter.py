"""Points filtered in time: calibrated on routes that stand, move and leap; exchanged and leaping points."""

import numpy as np
import pytest

from tests.live_process import ROUTES, points_mm
from tssgeom.engine import Engine
from tssgeom.rig import Rig
from tssgeom.route import tracking
from tssgeom.route.noise import noise_left
from tssgeom.route.time_filter import begun, filtered
from tssgeom.route.time_smoother import smoothed
from tssgeom.route.tracking import noise_growth
from tssgeom.stream import Frame

NOISE = 5e-4  # [m]
S = np.linspace(0.0, 0.4, 40)


def route(bend):
    """Points along an arc with a total turn [rad], 0.4 m long."""
    turn = bend * S / S[-1]
    step = np.diff(S, prepend=0.0)[:, None]
    return np.cumsum(step * np.column_stack((np.cos(turn), np.sin(turn), 0.2 * np.sin(2 * turn))), axis=0)


MOTIONS = {
    "stands": lambda _: 2.0,
    "drifts": lambda frame: 2.0 + 0.002 * frame,
    "sways slowly": lambda frame: 2.0 + 0.3 * np.sin(2 * np.pi * frame / 250),
    "sways quickly": lambda frame: 2.0 + 0.6 * np.sin(2 * np.pi * frame / 25),
    "leaps": lambda frame: 2.0 + 0.6 * ((frame // 40) % 2),
}


def streamed(motion, frames=120, seed=0, noise=NOISE):
    """Yield the filter after each frame, with the true and the sensed points."""
    rng, state = np.random.default_rng(seed), None
    for frame in range(frames):
        true = route(motion(frame))
        sensed = true + noise * rng.standard_normal(true.shape)
        if state is None:
            state = begun(sensed, noise, 0.0)
        else:
            state = filtered(state, sensed, state.noise, 0.01 * frame)
        assert state is not None
        yield state, true, sensed


@pytest.mark.parametrize("name", MOTIONS)
def test_the_noise_that_is_left_is_as_large_as_stated(name):
    ratio, bound = list[float](), list[float]()
    for seed in range(4):
        for state, true, _ in list(streamed(MOTIONS[name], seed=seed))[20:]:
            ratio.append(float(np.mean((state.points - true) ** 2)) / state.noise**2)
            bound.append(state.noise)
    assert 0.7 < np.sqrt(np.mean(ratio)) < 1.15
    assert np.mean(bound) < 1.1 * NOISE


def test_in_its_first_frames_a_route_that_stands_is_not_taken_to_move():
    for seed in range(20):
        first, *later = [state.stands for state, _, _ in streamed(MOTIONS["stands"], frames=20, seed=seed)]
        assert first is None
        assert False not in later
        assert later[-1]
    moving = [state.stands for state, _, _ in streamed(MOTIONS["sways quickly"], frames=20)]
    assert set(moving[3:]) == {False}


def test_the_points_of_a_route_that_stands_improve_as_the_root_of_the_frames():
    errors = np.zeros(100)
    for seed in range(6):
        for frame, (state, true, _) in enumerate(streamed(MOTIONS["stands"], frames=100, seed=seed)):
            errors[frame] += float(np.mean((state.points - true) ** 2)) / 6
    for frame in (9, 24, 99):
        assert np.sqrt(errors[frame]) == pytest.approx(NOISE / np.sqrt(frame + 1), rel=0.35)


def test_a_leap_is_followed_in_the_same_frame():
    for frame, (state, _, sensed) in enumerate(streamed(MOTIONS["leaps"], frames=41)):
        if frame == 40:
            assert np.abs(state.points - sensed).max() < 0.02 * NOISE
            assert state.standing < 0.01
            assert state.noise == pytest.approx(NOISE, rel=0.1)


def test_recorded_frames_reach_the_bound_of_all_frames_together():
    rng, true = np.random.default_rng(3), route(2.0)
    sensed = [true + NOISE * rng.standard_normal(true.shape) for _ in range(100)]
    for state in smoothed(sensed, list(np.arange(100.0)), NOISE):
        assert state is not None
        assert np.sqrt(np.mean((state.points - true) ** 2)) == pytest.approx(NOISE / 10, rel=0.3)
        assert state.noise == pytest.approx(NOISE / 10, rel=0.3)


def test_a_stated_noise_that_does_not_change_in_time_stays():
    *_, (state, _, _) = streamed(MOTIONS["stands"], frames=60)
    assert noise_left(state, None) is None
    assert noise_left(state, NOISE) == pytest.approx(state.noise, rel=1e-6)
    assert noise_left(state, 4 * NOISE) == pytest.approx(np.sqrt(15) * NOISE, rel=0.05)


def test_frames_that_are_sent_again_are_no_new_ones():
    *_, (state, _, sensed) = streamed(MOTIONS["stands"], frames=10)
    again = filtered(state, np.array(sensed), NOISE, 0.1)
    assert again is not None
    np.testing.assert_array_equal(again.points, state.points)
    assert again.noise == state.noise


def test_points_that_are_exchanged_are_put_back_and_named():
    *_, (state, true, _) = streamed(MOTIONS["sways slowly"], frames=30)
    sensed = route(MOTIONS["sways slowly"](30)) + 1e-5
    sensed[[11, 12]] = sensed[[12, 11]]
    after = filtered(state, sensed, NOISE, 0.30)
    assert after is not None
    assert after.warnings == ("points 11 and 12 are exchanged in this frame: put back",)
    assert np.linalg.norm(after.points[11] - true[11]) < 5 * NOISE


def test_a_point_that_leaps_alone_is_believed_after_five_frames():
    *_, (state, true, _) = streamed(MOTIONS["stands"], frames=30)
    rng = np.random.default_rng(5)
    for frame in range(30, 38):
        sensed = true + NOISE * rng.standard_normal(true.shape)
        sensed[7] += 0.02
        after = filtered(state, sensed, NOISE, 0.01 * frame)
        assert after is not None
        state = after
        off = float(np.linalg.norm(state.points[7] - true[7]))
        if frame < 35:
            assert off < 2 * NOISE
            assert state.warnings[0].startswith("point 7 leapt while the others did not")
        elif frame > 35:
            assert off == pytest.approx(0.02 * np.sqrt(3), rel=0.1)


def test_a_missing_point_stays_missing_and_comes_back():
    *_, (state, true, _) = streamed(MOTIONS["stands"], frames=20)
    sensed = np.array(true)
    sensed[5] = np.nan
    after = filtered(state, sensed, NOISE, 0.20)
    assert after is not None
    assert np.isnan(after.points[5]).all()
    assert np.isfinite(np.delete(after.points, 5, axis=0)).all()
    back = filtered(after, true, NOISE, 0.21)
    assert back is not None
    assert np.linalg.norm(back.points[5] - true[5]) < NOISE


def test_a_point_that_was_missing_is_believed_where_it_comes_back():
    *_, (state, true, _) = streamed(MOTIONS["stands"], frames=20)
    sensed = np.array(true)
    sensed[5] = np.nan
    after = filtered(state, sensed, NOISE, 0.20)
    assert after is not None
    sensed[5] = true[5] + 0.01
    back = filtered(after, sensed, NOISE, 0.21)
    assert back is not None
    assert np.linalg.norm(back.points[5] - sensed[5]) < NOISE
    assert back.warnings == ()


def test_a_point_that_is_missing_while_the_route_leaps_is_where_it_comes_back():
    state = None
    for frame in range(40):
        true = route(1.0 + 0.9 * ((frame // 3) % 2))
        sensed = true + NOISE * np.random.default_rng(frame).standard_normal(true.shape)
        sensed[frame % 7 :: 7] = np.nan
        state = begun(sensed, NOISE, 0.0) if state is None else filtered(state, sensed, NOISE, 0.5 * frame)
        assert state is not None
        off = np.linalg.norm(state.points - true, axis=1)
        assert np.nanmax(off) < 8 * NOISE
        assert all("missing" in text for text in state.warnings)  # at an end


@pytest.mark.parametrize("change", ["count", "pause", "infinite"])
def test_a_filter_ends_where_frames_do_not_go_on(change):
    *_, (state, _, sensed) = streamed(MOTIONS["stands"], frames=10)
    time = 100.0 if change == "pause" else 0.1
    if change == "count":
        sensed = sensed[:-5]
    if change == "infinite":
        sensed = np.array(sensed)
        sensed[3, 0] = np.inf
    assert filtered(state, sensed, NOISE, time) is None


@pytest.mark.parametrize("is_noise_new", [True, False])
@pytest.mark.parametrize("route", ROUTES)
def test_a_route_that_sways_is_tracked_where_the_filter_leaves_other_noise(monkeypatch, route, is_noise_new):
    """Else every hundredth frame of a stream at 100 Hz took 20 ms, for a fit from nothing."""
    anew = list[int]()
    measured = tracking.measure
    monkeypatch.setattr(tracking, "measure", lambda *given: anew.append(1) or measured(*given))
    engine = Engine(Rig(), tension_in=10.0)
    for k in range(360):
        points = points_mm(60, 0.01 * k, k if is_noise_new else 0, route=route)
        engine.push(Frame(1e-3 * points, 0.01 * k, tension_in=8.0))
        engine.idle()
    assert len(anew) == 1


def test_the_noise_of_points_that_are_not_filtered_any_more_is_that_of_the_sensor():
    state = [one for one, _, _ in streamed(MOTIONS["stands"], frames=30)][-1]
    assert noise_growth(1e-3, None, state) == 1.0
    assert noise_growth(1e-3, state, state) == pytest.approx(1.0)
    assert noise_growth(state.noise, state, None) == pytest.approx(np.sqrt(30), rel=0.2)


def test_noise_that_is_the_same_in_each_frame_neither_grows_nor_falls():
    state = [one for one, _, _ in streamed(MOTIONS["stands"], frames=30)][-1]
    calmer, constant = state._replace(noise=0.5 * state.noise), 10.0
    growth = noise_growth(constant * state.noise, state, calmer)
    assert growth == pytest.approx(np.sqrt(constant**2 - 0.75) / constant)
    assert noise_growth(0.5 * state.noise, state, calmer) == pytest.approx(0.5)  # none is
    assert 0.0 < noise_growth(0.0, state, calmer) < np.inf
