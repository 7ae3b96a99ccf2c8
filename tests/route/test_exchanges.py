"""Exchanged sensors of streams and recordings: detected in time, put back, named; others are left alone."""

import numpy as np
import pytest

from tssgeom import smoothed_frames
from tssgeom.engine import process, recorded
from tssgeom.frame import Frame
from tssgeom.rig import Rig, ShapeSensor
from tssgeom.route.synthetic import chain, positions
from tssgeom.route.time_filter import begun, filtered
from tssgeom.route.time_smoother import smoothed
from tssgeom.sensed_route import fit_frame
from tssgeom.stream import FrameResult

COUNT, FRAMES = 10, 90
WAYS = {"stream": process, "recording": recorded}


def route(k, step=0.02):
    """A route of three arcs in two planes, 0.45 m long, that sways slowly."""
    turn = np.array([0.9, 1.1, 0.7]) * (1.0 + 0.1 * np.sin(2 * np.pi * step * k / 6.0))
    course = chain(np.full(3, 0.15), turn / 0.15, np.array([0.0, 1.5, 3.0]))
    return positions(course, np.linspace(0.0, 0.45, COUNT)), course.total_angle


def sensed(seed, noise=5e-4):
    rng = np.random.default_rng(seed)
    true = np.array([route(k)[0] for k in range(FRAMES)])
    return true, true + noise * rng.standard_normal(true.shape)


def exchanged(points, rows, frames):
    """The same points with these rows exchanged in some frames: each comes as the next one."""
    sent = np.array(points)
    for k in frames:
        sent[k, rows] = points[k, np.roll(rows, 1)]
    return sent


def results(way, points):
    frames = [Frame(one, 0.02 * k) for k, one in enumerate(points)]
    given = list(WAYS[way](frames, Rig(), tension_in=10.0))
    assert all(isinstance(one, FrameResult) for one in given)
    return [one for one in given if isinstance(one, FrameResult)]


def names(result):
    return [text for text in result.warnings if "exchanged" in text]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(
    ("rows", "frames", "text"),
    [
        ([3, 4], range(40, 60), "points 3 and 4 are"),
        ([8, 9], range(50, FRAMES), "points 8 and 9 are"),
        ([2, 6], (30, 41, 77), "points 2 and 6 are"),
        ([4, 5, 6], range(40, 60), "points 4, 5 and 6 are"),
    ],
)
def test_exchanged_sensors_are_put_back_and_named(way, rows, frames, text):
    _, points = sensed(len(rows) + rows[0])
    clean, mixed = results(way, points), results(way, exchanged(points, rows, frames))
    for k, (one, other) in enumerate(zip(clean, mixed, strict=True)):
        assert names(one) == []
        assert names(other) == ([f"{text} exchanged in this frame: put back"] if k in frames else [])
        np.testing.assert_array_equal(one.shape.points, other.shape.points)
        assert one.arcs.total_angle == other.arcs.total_angle


def test_two_pairs_are_put_back():
    _, points = sensed(5)
    sent = exchanged(exchanged(points, [0, 1], range(40, 60)), [5, 6], range(40, 60))
    for k, one in enumerate(results("stream", sent)):
        assert len(names(one)) == (2 if 40 <= k < 60 else 0)
        assert abs(one.arcs.total_angle - route(k)[1]) < 3 * one.arcs.total_angle_se


def test_a_recording_that_begins_with_exchanged_sensors_is_put_right_from_its_end():
    true, points = sensed(6)
    for k, one in enumerate(results("recording", exchanged(points, [4, 5], range(30)))):
        assert len(names(one)) == (k < 30)
        assert np.linalg.norm(one.shape.points - true[k], axis=1).max() < 5e-3


def test_the_order_goes_on_from_one_part_of_a_recording_to_the_next(monkeypatch):
    monkeypatch.setattr(smoothed_frames, "_WINDOW", smoothed_frames.Window(200, 20, 4))
    _, points = sensed(11)
    mixed = exchanged(points, [4, 5], range(15, FRAMES))
    assert [len(names(one)) for one in results("recording", mixed)] == [int(k >= 15) for k in range(FRAMES)]


def test_a_stream_that_began_with_exchanged_sensors_takes_the_shorter_path():
    _, points = sensed(7)
    mixed = results("stream", exchanged(points, [4, 5], range(30)))
    assert names(mixed[30]) == ["points 4 and 5 were exchanged until this frame, whose path is shorter"]
    for k, one in enumerate(mixed[31:], 31):
        assert names(one) == []
        assert abs(one.arcs.total_angle - route(k)[1]) < 3 * one.arcs.total_angle_se


def test_directions_are_put_back_with_their_points():
    true, points = sensed(8)
    directions = np.gradient(true, axis=1)
    directions /= np.linalg.norm(directions, axis=2)[:, :, None]
    rig, last = Rig(shape=ShapeSensor(direction_noise_deg=1.0)), None
    sent, turned = (exchanged(each, [3, 4], range(20, 30)) for each in (points, directions))
    for k in range(30):
        shape, last = fit_frame(Frame(sent[k], 0.02 * k, directions=turned[k]), rig, last)
        assert shape.directions is not None
        np.testing.assert_allclose(shape.directions, directions[k], atol=1e-12)


def test_an_exchanged_frame_that_is_sent_again_is_no_new_one():
    _, points = sensed(9)
    sent, state = exchanged(points, [3, 4], [20]), begun(points[0], 5e-4, 0.0)
    for k in range(1, 21):
        assert state is not None
        state = filtered(state, sent[k], 5e-4, 0.02 * k)
    assert state is not None
    again = filtered(state, np.array(sent[20]), 5e-4, 0.42)
    assert again is not None
    np.testing.assert_array_equal(again.points, state.points)
    assert again.warnings == state.warnings == ("points 3 and 4 are exchanged in this frame: put back",)


def turned(points, angle, rng):
    """A frame that is turned about a random axis through its middle."""
    axis = rng.standard_normal(3)
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return (points - points.mean(axis=0)) @ turn.T + points.mean(axis=0)


@pytest.mark.parametrize("moves", ["sways", "leaps", "slides"])
def test_sensors_that_move_however_fast_are_not_taken_for_exchanged(moves):
    for seed in range(4):
        rng = np.random.default_rng(seed)
        _, points = sensed(seed)
        if moves == "leaps":
            points = [turned(one, np.pi * rng.random() * (k % 7 == 0), rng) for k, one in enumerate(points)]
        if moves == "slides":  # by a spacing in two frames
            at = np.arange(COUNT)
            points = [
                np.column_stack([np.interp(at - 0.5 * (k % 4), at, column) for column in one.T])
                for k, one in enumerate(points)
            ]
        state, taken = None, list[bool]()
        for k, one in enumerate(points):
            state = None if state is None else filtered(state, one, 5e-4, 0.02 * k)
            state = state or begun(one, 5e-4, 0.02 * k)
            assert state is not None
            taken.append(state.order is not None or state.reordered)
        both = smoothed(list(points), list(0.02 * np.arange(FRAMES)), 5e-4)
        assert not any(taken)
        assert all(one is None or one.order is None for one in both)


def test_a_point_that_leapt_in_a_recording_is_where_the_frames_beside_it_had_it():
    true, points = sensed(10)
    points[40, 5] += 0.03
    state = smoothed(list(points), list(0.02 * np.arange(FRAMES)), 5e-4)[40]
    assert state is not None
    assert state.warnings[0].startswith("point 5 leapt")
    assert np.linalg.norm(state.points[5] - true[40, 5]) < 5 * 5e-4
