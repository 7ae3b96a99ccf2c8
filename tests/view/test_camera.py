import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.view.conftest import analysed
from tssgeom.route.synthetic import Course, positions
from tssgeom.stream import Frame, FrameResult
from tssgeom.view.samples import route_samples
from tssgeom.view.scene.labels import (
    ASPECT,
    Camera,
    LabelPositions,
    camera,
    label_positions,
    labelled,
    scale_label,
    time_position,
)


def helix(turns: float, pitch: float, size: float) -> np.ndarray:
    turn = np.linspace(0, 2 * math.pi * turns, 80)
    return size * np.column_stack([np.cos(turn), np.sin(turn), pitch * turn])


def looking_at(points: np.ndarray) -> Camera:
    return camera(points, points[-1] - points[0])


@given(st.floats(0.3, 4), st.floats(0, 2), st.floats(1e-3, 10))
def test_every_node_is_inside_the_view_whatever_the_size(turns: float, pitch: float, size: float) -> None:
    points = helix(turns, pitch, size)
    screen = np.abs(looking_at(points).project(points))
    assert (screen <= [0.5 * ASPECT, 0.5]).all()


@given(st.floats(0.3, 4), st.floats(0.2, 2), st.floats(1e-3, 1e3))
def test_picture_does_not_depend_on_the_unit_of_length(turns: float, pitch: float, scale: float) -> None:
    small, large = helix(turns, pitch, 1.0), helix(turns, pitch, scale)
    np.testing.assert_allclose(
        looking_at(small).project(small), looking_at(large).project(large), atol=1e-6
    )  # the axes are eigenvectors, good to the square root of rounding where two spreads are alike


def test_proximal_end_is_on_the_left() -> None:
    points = helix(2, 1, 0.1)
    for route in (points, points[::-1]):
        across = looking_at(route).project(route)[:, 0]
        assert across[0] < across[-1]


def test_camera_faces_the_plane_of_a_flat_route() -> None:
    view = looking_at(helix(0.7, 0.0, 0.1))
    assert abs(np.cross(view.across, view.up)[2]) == pytest.approx(1.0)


def test_straight_line_has_a_camera_too() -> None:
    line = np.outer(np.linspace(0, 1, 20), [1.0, 2.0, 2.0])
    view = looking_at(line)
    assert np.isfinite(view.eye).all()
    assert abs(view.across @ view.up) < 1e-12


def test_scale_bar_is_as_long_as_it_says() -> None:
    bar, text = looking_at(helix(1, 1, 0.1)).scale_bar(0.05)
    assert 1e3 * np.linalg.norm(bar[1] - bar[0]) == pytest.approx(float(text.removesuffix(" mm")))


def test_labels_cover_neither_one_another_nor_the_route(moving: list[FrameResult]) -> None:
    frames = [route_samples(result) for result in moving]
    view = looking_at(np.concatenate([frame.position for frame in frames]))
    for frame, result in zip(frames, moving, strict=True):
        located = label_positions(view, frame, result.arcs)
        assert located.whole.all()
        centre, half = boxes(view, located, 1.0)
        assert (separation(centre, half) > 1.0).all()
        route = np.abs(centre[:, None] - view.project(frame.position)[None]) / half[:, None]
        assert (route.max(axis=2) > 0.5).all()


@pytest.mark.parametrize("text_scale", [1.0, 1.6, 2.0])
def test_in_a_crowd_labels_are_shortened_and_none_covers_an_end_or_the_scale(text_scale: float) -> None:
    turn = np.linspace(0.0, 1.0, 200)
    wave = 0.05 * np.column_stack([6 * turn, np.sin(12 * turn), np.sin(7 * turn)])
    (result,) = analysed([Frame(wave + np.random.default_rng(1).normal(0.0, 1e-4, wave.shape))])
    assert len(result.arcs.length) > 10
    chosen = labelled(result.arcs)
    assert len(chosen) == 6
    assert result.arcs.angle[chosen].min() >= np.delete(result.arcs.angle, chosen).max()
    view = looking_at(result.route.position)
    located = label_positions(view, route_samples(result), result.arcs, text_scale)
    assert located.whole[:2].all()
    if text_scale > 1.0:
        assert not located.whole.all()
    centre, half = boxes(view, located, text_scale)
    _, _, anchor = scale_label(view, text_scale)
    centre = np.vstack([centre, view.project(anchor) - (0.0, text_scale * RISE)])
    half = np.vstack([half, text_scale * SCALE])
    assert (separation(centre, half)[[0, 1, -1]] > 1.0).all()


RISE = 0.025  # Rerun hangs a label below its anchor, by this part of the height of the view
WHOLE, NUMBER, SCALE = np.array([[0.12, 0.0185], [0.025, 0.0185], [0.042, 0.0185]])
"""Half of the size of labels as they are drawn in a view of common height, measured in a picture."""


def boxes(view: Camera, located: LabelPositions, text_scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Centres of the labels and half of their sizes on the screen, each [n, 2]."""
    centre = view.project(located.position) - (0.0, text_scale * RISE)
    return centre, text_scale * np.where(located.whole[:, None], WHOLE, NUMBER)


def separation(centre: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Separation of boxes in the sum of their half sizes; below 1 they overlap."""
    room = np.abs(centre[:, None] - centre[None]) / (half[:, None] + half[None])
    np.fill_diagonal(room[:, :, 0], np.inf)
    return room.max(axis=2)


def test_no_label_of_a_piece_covers_the_time_or_the_letters_of_the_axes() -> None:
    bend = np.array([[6.0, 0.0], [0.0, 0.0], [-18.0, 0.0], [-7.0, 2.0], [12.0, 0.0]])
    points = positions(Course(np.array([0.08, 0.12, 0.07, 0.15, 0.08]), bend), np.linspace(0.0, 0.5, 120))
    (result,) = analysed([Frame(points)])
    view = looking_at(points)
    centre, half = boxes(view, label_positions(view, route_samples(result), result.arcs), 1.0)
    _, letters = view.triad(view.room_below)
    for fixed, size in ((time_position(view), (0.065, 0.021)), (letters, (0.015, 0.021))):
        between = np.abs(centre[:, None] - view.project(fixed)) / (half[:, None] + size)
        assert (between.max(axis=2) > 0.95).all()  # a box touches another where this is 1


@given(st.integers(0, 2**32 - 1))
def test_the_letters_of_the_axes_stand_apart_and_none_below_the_foot(seed: int) -> None:
    random = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
    view = looking_at(helix(0.8, 0.05, 0.1) @ turn)
    _, letters = view.triad(view.room_below)
    projected = view.project(letters)
    for k in range(3):
        between = np.abs(np.delete(projected, k, axis=0) - projected[k])
        assert (between > 0.9 * np.array([0.03, 0.042])).any(axis=1).all()
    foot = (letters - view.target) @ view.up / view.view_height
    assert foot.min() >= -view.half_height / view.view_height - view.room_below - 1e-9
