"""Streams of noisy routes that stand, against the truth: Φ and T_out at the bound of all frames so far."""

from dataclasses import replace

import numpy as np
import pytest

from tests.route.test_ratio_average import random_course
from tssgeom import smoothed_frames
from tssgeom.engine import alone, process, recorded
from tssgeom.frame import Frame
from tssgeom.rig import Rig, ShapeSensor
from tssgeom.route.pieces import Arcs
from tssgeom.route.synthetic import chain, positions
from tssgeom.sensed_route import fit_frame
from tssgeom.stream import FrameResult, Rejected
from tssgeom.tendon.state import pretensioned, step, transmit

NOISE, FRAMES = 5e-4, 80
LENGTH, ANGLE = np.array([0.1, 0.12, 0.08, 0.1]), np.array([1.1, 0.7, 1.3, 0.5])
PLANE = np.array([0.0, 0.9, -0.7, 0.4])


def stream(seed):
    """Frames of a course that stands, with noise, under 10 N."""
    rng = np.random.default_rng(seed)
    course = chain(LENGTH, ANGLE / LENGTH, PLANE)
    exact = positions(course, np.linspace(0.0, course.total_length, 40))
    for count in range(FRAMES):
        points = exact + NOISE * rng.standard_normal((40, 3))
        yield Frame(points, time=0.02 * count, tension_in=10.0)


def test_angle_and_tension_of_a_route_that_stands_improve_as_the_root_of_the_frames():
    rig = Rig()
    course = Arcs.exact(LENGTH, ANGLE)
    true = transmit(step(pretensioned(rig), course, rig, tension_in=10.0), rig)
    angle, tension, first = list[float](), list[float](), list[float]()
    for seed in range(5):
        results = list(process(stream(seed), rig, tension_in=10.0))
        assert all(isinstance(each, FrameResult) for each in results)
        for count, each in enumerate(results):
            assert isinstance(each, FrameResult)
            off = each.arcs.total_angle - course.total_angle
            if count == 0:
                first.append(off)
            if count >= 60:
                angle.append(off / each.arcs.total_angle_se)
                tension.append(
                    (each.transmission.tension_out - true.tension_out) / each.transmission.tension_out_se
                )
                assert abs(off) < 0.02
    assert np.sqrt(np.mean(np.square(first))) > 0.015
    for z in (angle, tension):
        assert np.mean(np.abs(z) < 1.96) > 0.85
        assert np.sqrt(np.mean(np.square(z))) < 1.5


@pytest.mark.parametrize(("count", "noise", "greatest"), [(24, 3e-4, 2.0), (12, 1e-3, 12.0)])
def test_few_points_that_stand_need_few_fits_from_nothing(count, noise, greatest):
    edges = np.linspace(0.0, 0.5, 1001)
    s = 0.5 * (edges[1:] + edges[:-1])
    bends = ((0.12, 9.0), (0.26, 12.0), (0.4, 8.0))
    course = chain(np.diff(edges), sum(size * np.exp(-0.5 * ((s - at) / 0.04) ** 2) for at, size in bends))
    exact = positions(course, np.linspace(0.0, course.total_length, count))
    rng = np.random.default_rng(3)
    frames = [
        Frame(exact + noise * rng.standard_normal(exact.shape), 0.04 * i, tension_in=5.0) for i in range(150)
    ]
    results = [each for each in process(frames, Rig(), tension_in=5.0) if isinstance(each, FrameResult)]
    assert sum(each.tracked.age == 0 for each in results) < 25
    off = np.degrees([each.arcs.total_angle - course.total_angle for each in results])
    se = np.degrees([each.arcs.total_angle_se for each in results])
    assert np.mean(np.abs(off) < 1.96 * se) > 0.9
    assert se[-1] < greatest < 1.5 * se[0]


def test_no_stairs_where_nothing_moves():
    results = [each.transmission for each in process(stream(1), Rig(), tension_in=10.0)][40:]
    steps = np.diff([each.tension_out for each in results])
    assert np.abs(steps).max() < 0.6 * results[-1].tension_out_se
    assert abs(steps.sum()) < 2.0 * results[0].tension_out_se


def test_a_recording_is_known_by_all_its_frames_from_the_first_on():
    results = list(alone(stream(2), Rig(), tension_in=10.0))
    angle = np.array([each.arcs.total_angle for each in results])
    assert np.abs(angle - ANGLE.sum()).max() < 0.015
    noise = [replace(each.arcs, covariance=each.arcs.noise_covariance) for each in results]
    assert noise[0].total_angle_se == pytest.approx(noise[-1].total_angle_se, rel=0.3)


def test_a_recording_in_which_the_tendon_goes_on_is_known_by_the_frames_to_come_too():
    off = {process: list[float](), recorded: list[float]()}
    for seed in range(3):
        rng, frames, angles = np.random.default_rng(seed), list[Frame](), list[float]()
        for count in range(60):
            share = 1.0 + 0.15 * np.sin(2 * np.pi * count / 250)
            course = chain(LENGTH, share * ANGLE / LENGTH, PLANE)
            points = positions(course, np.linspace(0.0, course.total_length, 40))
            frames.append(Frame(points + NOISE * rng.standard_normal((40, 3)), 0.02 * count, tension_in=10.0))
            angles.append(share * ANGLE.sum())
        for one, errors in off.items():
            for each, angle in zip(one(frames, Rig(), tension_in=10.0), angles, strict=True):
                assert isinstance(each, FrameResult)
                errors.append(each.arcs.total_angle - angle)
                assert abs(errors[-1]) < 4.0 * each.arcs.total_angle_se
    causal, smoothed = (np.sqrt(np.mean(np.square(errors))) for errors in off.values())
    assert smoothed < 0.85 * causal


def test_a_recording_longer_than_a_window_keeps_its_frames_in_order(monkeypatch):
    monkeypatch.setattr(smoothed_frames, "_WINDOW", smoothed_frames.Window(points=100, most=9, overlap=4))
    frames: list[Frame | Rejected] = list(stream(4))[:30]
    frames[11] = Rejected(0, 0.22, "no points")
    results = list(recorded(frames, Rig(), tension_in=10.0))
    assert [each.seq for each in results] == list(range(30))
    assert [each.seq for each in results if isinstance(each, Rejected)] == [11]


def test_the_filter_can_be_switched_off():
    rig = Rig(shape=ShapeSensor(time_filter=False))
    frames = list(stream(3))
    results = list(process(frames, rig, tension_in=10.0))
    for each, frame in zip(results, frames, strict=True):
        np.testing.assert_array_equal(each.shape.points, frame.points)
    assert results[-1].arcs.total_angle_se > 0.02


@pytest.mark.parametrize("seed", [2, 5, 8, 11])
def test_eight_points_of_a_stream_are_not_taken_for_noise(seed):
    rng, n = np.random.default_rng([seed, 8]), 8
    course = random_course(rng)
    s = np.linspace(0.0, 0.5, n)
    s[1:-1] += 0.1 / (n - 1) * rng.standard_normal(n - 2)
    points = positions(course, s)
    frames = [Frame(points + 2e-4 * rng.standard_normal((n, 3)), 0.01 * k) for k in range(25)]
    for one in process(frames, Rig(), tension_in=5.0):
        assert isinstance(one, FrameResult)
        assert abs(one.arcs.total_angle - course.total_angle) < 1.96 * one.arcs.total_angle_se


@pytest.mark.parametrize("noise", [1.5e-4, 5e-4])
def test_noise_as_sensed_is_that_of_the_points_where_few_of_them_hide_the_route(noise):
    rng = np.random.default_rng(0)
    course = chain(LENGTH, ANGLE / LENGTH, PLANE)
    exact = positions(course, np.linspace(0.0, course.total_length, 14))
    frames = [Frame(exact + noise * rng.standard_normal(exact.shape), time=0.02 * k) for k in range(60)]
    for result in list(recorded(frames, Rig(), tension_in=10.0))[20:]:
        assert isinstance(result, FrameResult)
        for one in (result, result.strip()):
            assert one.sensed_noise == pytest.approx(noise, rel=0.1)  # 4 s.e. of 20 frames of 42 coordinates


def moving(seed, count=110, noise=3e-4):
    """Return frames of twelve points on a tube with three bends, some points missing, and true Φ."""
    rng, s = np.random.default_rng(seed), np.linspace(0.0, 0.62, 621)
    size, _ = rng.uniform(0.5, 3.5, 3) * rng.choice([-1, 1], 3), rng.uniform(0.0, 2.0 * np.pi, 3)
    frames, true = [], []
    for time in 0.025 * np.arange(count):
        bell = [np.exp(-(((s - at) / width) ** 2)) for at, width in ((0.15, 0.06), (0.35, 0.07), (0.5, 0.06))]
        first = 1e-3 * np.cumsum(
            (1.0 + 0.3 * np.sin(0.8 * time)) * 2.0 * (size[0] * bell[0] + size[1] * bell[1])
        )
        other = 1e-3 * np.cumsum((1.0 + 0.2 * np.cos(time)) * size[2] * bell[2])
        tangent = np.column_stack(
            (np.cos(first) * np.cos(other), np.sin(first) * np.cos(other), np.sin(other))
        )
        true.append(np.linalg.norm(np.diff(tangent, axis=0), axis=1).sum())
        points = 1e-3 * np.cumsum(tangent, axis=0)[np.linspace(0, 620, 12).astype(int)]
        points += noise * rng.standard_normal((12, 3))
        points[rng.random(12) < 0.006] = np.nan
        frames.append(Frame(points, time, tension_in=10.0))
    return frames, true


def test_few_points_of_a_recording_stay_within_their_bars_once_a_first_one_is_missing():
    """A fit of points that hardly scatter after a filter took a wrong turn, and 17 frames kept its noise."""
    frames, true = moving(10)
    known, last = smoothed_frames.smoothed_in_time(frames, Rig()), None
    for k, (frame, angle) in enumerate(zip(frames, true, strict=True)):
        last = fit_frame(frame, Rig(), last, known.get(k))[1]
        if not np.isnan(frame.points[[0, -1]]).any():
            arcs = last.fit.arcs
            assert abs(arcs.total_angle - angle) < 5.0 * arcs.total_angle_se
