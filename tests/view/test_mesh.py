import math
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tssgeom.errors import ShapeError
from tssgeom.view.colours import tension_rgb
from tssgeom.view.mesh import SIDES, rotation_minimising_frame, tube


def helix(count: int = 200) -> tuple[np.ndarray, np.ndarray]:
    turn = np.linspace(0, 6 * math.pi, count)
    position = np.column_stack([0.05 * np.cos(turn), 0.05 * np.sin(turn), 0.01 * turn])
    tangent = np.column_stack([-0.05 * np.sin(turn), 0.05 * np.cos(turn), np.full(count, 0.01)])
    return position, tangent / np.linalg.norm(tangent, axis=1, keepdims=True)


def test_tube_is_watertight_and_encloses_its_prism() -> None:
    position, tangent = helix()
    mesh = tube(position, tangent, np.linspace(15, 5, 200), 0.004)
    length = np.linalg.norm(np.diff(position, axis=0), axis=1).sum()
    section = 0.5 * SIDES * math.sin(2 * math.pi / SIDES) * 0.004**2
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    # Chords of 5° cut the corners of the bend by (5°)²/24 and the like: far below 1 %.
    assert mesh.volume == pytest.approx(section * length, rel=0.01)


def test_normals_point_outward() -> None:
    position = np.outer(np.linspace(0, 1, 5), [0.0, 0.0, 1.0])
    mesh = tube(position, np.tile([0.0, 0.0, 1.0], (5, 1)), np.ones(5), 0.1)
    assert mesh.volume > 0


def test_frame_is_orthonormal_and_right_handed() -> None:
    _, tangent = helix()
    first, second = rotation_minimising_frame(tangent)
    frames = np.stack([tangent, first, second], axis=1)
    np.testing.assert_allclose(
        frames @ frames.transpose(0, 2, 1), np.tile(np.eye(3), (200, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)


def test_frame_of_a_flat_curve_keeps_its_angle_to_the_plane() -> None:
    turn = np.linspace(0, 2, 50)
    tangent = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(50)])
    first, _ = rotation_minimising_frame(tangent)
    np.testing.assert_allclose(first[:, 2], first[0, 2], atol=1e-12)


def test_frame_turns_about_the_tangent_by_no_more_than_second_order() -> None:
    """The rate of a rotation-minimising frame lies along the tangent, up to the chord's square."""
    _, tangent = helix(2000)
    first, second = rotation_minimising_frame(tangent)
    twist = np.sum(np.diff(first, axis=0) * 0.5 * (second[:-1] + second[1:]), axis=1)
    assert np.abs(twist).sum() < 1e-4


def test_vertices_have_the_colour_of_the_tension_at_their_ring(tmp_path: Path) -> None:
    position, tangent = helix(20)
    tension = np.linspace(10, 2, 20)
    tube(position, tangent, tension, 0.004, top=10.0).export(tmp_path / "tube.glb")
    read = trimesh.load(tmp_path / "tube.glb", force="mesh", process=False)
    expected = np.rint(255 * tension_rgb(tension, 10.0)).astype(int)
    colours = read.visual.vertex_colors[: 20 * SIDES, :3].reshape(20, SIDES, 3)
    np.testing.assert_array_equal(colours, np.repeat(expected[:, None], SIDES, axis=1))


def test_radius_that_is_not_positive_is_refused() -> None:
    position, tangent = helix(10)
    with pytest.raises(ShapeError, match="radius is 0 mm"):
        tube(position, tangent, np.ones(10), 0.0)
