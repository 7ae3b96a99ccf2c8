import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tssgeom.stream import FrameResult
from tssgeom.view.camera import ASPECT, Camera, camera
from tssgeom.view.drawn import drawn
from tssgeom.view.labels import label_places


def helix(turns: float, pitch: float, size: float) -> np.ndarray:
    turn = np.linspace(0, 2 * math.pi * turns, 80)
    return size * np.column_stack([np.cos(turn), np.sin(turn), pitch * turn])


def looking_at(points: np.ndarray) -> Camera:
    return camera(points, points[-1] - points[0])


@given(st.floats(0.3, 4), st.floats(0, 2), st.floats(1e-3, 10))
def test_every_node_is_inside_the_view_whatever_the_size(turns: float, pitch: float, size: float) -> None:
    points = helix(turns, pitch, size)
    seen = np.abs(looking_at(points).project(points))
    assert (seen <= [0.5 * ASPECT, 0.5]).all()


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


def test_flat_route_is_looked_at_squarely() -> None:
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
    frames = [drawn(result) for result in moving]
    view = looking_at(np.concatenate([frame.position for frame in frames]))
    for frame, result in zip(frames, moving, strict=True):
        # Rerun hangs a label below its anchor; these boxes are half as large as the room kept free.
        places = view.project(label_places(view, frame, result.arcs)) - (0.0, 0.033)
        apart = np.abs(places[:, None] - places[None]) / (0.13, 0.025)
        np.fill_diagonal(apart[:, :, 0], np.inf)
        assert (apart.max(axis=2) > 1.0).all()
        route = np.abs(places[:, None] - view.project(frame.position)[None]) / (0.13, 0.025)
        assert (route.max(axis=2) > 0.5).all()
