"""A route that is hardly bent, or bent in a small part, has an error bar even where it is straight."""

import numpy as np
import pytest

from tssgeom import analyse
from tssgeom.engine import process
from tssgeom.rig import Rig, ShapeSensor
from tssgeom.route.geometry import measure
from tssgeom.route.observations import clean
from tssgeom.route.tracking import follow
from tssgeom.stream import Frame, FrameResult

DRAWS = 60


def arc(turn: float, length: float, count: int) -> np.ndarray:
    """Points on an arc in a plane [m] that turns by so much [rad]."""
    s = np.linspace(0.0, length, count)
    radius = length / turn
    return np.column_stack([radius * np.sin(s / radius), radius * (1 - np.cos(s / radius)), 0 * s])


def shaft_and_bend(straight: int, bent: int, radius: float, turn: float) -> np.ndarray:
    """Points on a straight shaft of 420 mm, then densely on a tight bend [m]."""
    shaft = np.column_stack([np.linspace(0.0, 0.42, straight), np.zeros(straight), np.zeros(straight)])
    way = np.linspace(0.0, turn, bent + 1)[1:]
    bend = np.column_stack([0.42 + radius * np.sin(way), radius * (1 - np.cos(way)), 0 * way])
    return np.concatenate([shaft, bend])


@pytest.mark.parametrize(
    ("turn", "length", "count", "noise"),
    [(0.005, 0.3, 60, 2e-4), (0.03, 0.1, 20, 5e-4), (0.05, 0.1, 20, 5e-4), (0.005, 0.4, 200, 5e-4)],
)
def test_intervals_hold_the_turn_of_a_route_that_is_hardly_bent(turn, length, count, noise):
    rng = np.random.default_rng(7)
    held = 0
    for _ in range(DRAWS):
        arcs = measure(clean(arc(turn, length, count) + noise * rng.standard_normal((count, 3)))).arcs
        assert arcs.total_angle_se > 0.0
        held += abs(arcs.total_angle - turn) <= 1.96 * arcs.total_angle_se
    assert held >= 0.85 * DRAWS  # 95 % would fall below this once in 400 runs


def test_a_followed_straight_route_keeps_its_error_and_its_profile_has_the_same():
    rng = np.random.default_rng(1)
    last = None
    for _ in range(5):
        last = follow(clean(arc(0.01, 0.2, 40) + 5e-4 * rng.standard_normal((40, 3))), None, last)
        arcs, profile = last.fit.arcs, last.fit.profile
        assert arcs.total_angle_se > 5e-3
        assert profile.total_angle_se == pytest.approx(arcs.total_angle_se, rel=1e-6)
        assert profile.kappa_se.min() > 0.0


def test_exact_points_on_a_line_are_straight_to_the_last_digits():
    points = np.column_stack([np.linspace(0.0, 0.5, 50), np.zeros(50), np.zeros(50)])
    arcs = measure(clean(points)).arcs
    assert arcs.total_angle < 1e-6
    assert arcs.total_angle_se < 1e-6


@pytest.mark.parametrize("decimals", [2, 3, 4, 6])
@pytest.mark.parametrize(
    ("straight", "bent", "radius", "turn"),
    [
        (40, 39, 5e-3, np.pi),
        (100, 39, 5e-3, np.pi),
        (40, 19, 5e-3, np.pi),
        (40, 39, 10e-3, 1.5),
        (20, 40, 5e-3, 4.0),
    ],
)
def test_the_points_of_a_dense_bend_behind_a_shaft_are_no_outliers(straight, bent, radius, turn, decimals):
    points = np.round(1e3 * shaft_and_bend(straight, bent, radius, turn), decimals) / 1e3
    arcs = measure(clean(points)).arcs
    assert abs(arcs.total_angle - turn) <= max(3.0 * arcs.total_angle_se, 0.01 * turn)


def test_loops_that_no_point_determines_are_not_in_the_estimate():
    rng = np.random.default_rng(1)
    points = shaft_and_bend(20, 20, 3e-3, np.pi / 2) + 5e-5 * rng.standard_normal((40, 3))
    for noise in (None, 5e-5):
        arcs = measure(clean(points), noise).arcs
        assert abs(arcs.total_angle - np.pi / 2) < 4.0 * arcs.total_angle_se + 2.0  # it was 33 ± 0.02 rad


def test_a_route_has_a_length_or_is_refused():
    points = np.array(
        [
            [-0.02679, -0.06810, 0.01408],
            [-0.08009, -0.01959, -0.00390],
            [-0.10441, -0.08950, 0.00771],
            [-0.10670, -0.15987, 0.00534],
            [-0.15994, -0.20731, 0.03060],
            [-0.23213, -0.21838, 0.03863],
            [np.nan, np.nan, np.nan],
            [-0.17510, -0.13117, 0.03771],
        ]
    )
    (result,) = process([Frame(points)], Rig(), tension_in=10.0)
    assert not isinstance(result, FrameResult) or result.arcs.length.min() > 0.0


@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_points_that_run_back_along_a_straight_route_are_warned_of(noise):
    x = np.concatenate([np.linspace(0.0, 0.1, 41), np.linspace(0.1, 0.0875, 6)[1:]])
    points = np.column_stack([x, 0 * x, 0 * x])
    points += noise * np.random.default_rng(3).standard_normal(points.shape)
    (result,) = process([Frame(points)], Rig(), tension_in=10.0)
    assert isinstance(result, FrameResult)
    turned = abs(result.arcs.total_angle - np.pi) < 3.0 * result.arcs.total_angle_se + 0.1
    assert turned or any("run back" in text or "ignored" in text for text in result.warnings)


def test_points_that_go_out_and_straight_back_stop_no_stream():
    x = np.concatenate([np.linspace(0.0, 0.1, 4), np.linspace(0.1, 0.0, 4)[1:]])
    frames = [Frame(np.column_stack([x, 0 * x, 0 * x]), 0.0), Frame(arc(1.0, 0.1, 20), 1.0)]
    _, sound = process(frames, Rig(), tension_in=10.0)
    assert sound.arcs.total_angle == pytest.approx(1.0, rel=1e-3)


def test_a_straight_line_has_an_error_as_a_spline_too():
    rng = np.random.default_rng(0)
    for _ in range(20):
        line = np.column_stack([np.linspace(0.0, 0.4, 200), np.zeros((200, 2))])
        arcs = measure(clean(line + 5e-4 * rng.standard_normal((200, 3))), method="spline").arcs
        assert 0.0 < arcs.total_angle_se < 0.1


@pytest.mark.parametrize("source", ["em", "fbg", "smoothed"])
def test_a_straight_route_by_a_source_has_an_error_bar_of_its_size(source):
    """Its angle may be none, of which errors that neighbours share are no share."""
    rig = Rig(shape=ShapeSensor(source=source))
    for seed in range(8):
        rng = np.random.default_rng(seed)
        points = np.column_stack([np.linspace(0.0, 0.3, 11), np.zeros((11, 2))])
        profile = analyse(points + 1e-3 * rng.standard_normal((11, 3)), rig=rig).profile
        assert profile.total_angle_se < 1.5
        assert profile.total_angle < 1.96 * profile.total_angle_se
