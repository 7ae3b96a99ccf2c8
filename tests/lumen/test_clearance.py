"""Distance to a wall, its sign, and where a tube touches: against solids of known distance."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from tssgeom.io.formats.meshes import wall_of
from tssgeom.lumen.clearance import clearance
from tssgeom.lumen.wall import nearest
from tssgeom.route.route import Route

RADIUS = 0.02


def pipe(length=0.3, radius=RADIUS, around=64, along=200):
    """An open tube along x whose triangles run either way round."""
    turn, x = np.linspace(0, 2 * np.pi, around, endpoint=False), np.linspace(0, length, along)
    ring = np.column_stack((np.zeros(around), radius * np.cos(turn), radius * np.sin(turn)))
    vertices = (np.column_stack((x, 0 * x, 0 * x))[:, None] + ring).reshape(-1, 3)
    i, j = (index.ravel() for index in np.meshgrid(np.arange(along - 1), np.arange(around), indexing="ij"))
    a, b = i * around + j, i * around + (j + 1) % around
    faces = np.vstack((np.column_stack((a, b, a + around)), np.column_stack((b, b + around, a + around))))
    return trimesh.Trimesh(vertices, faces, process=False)


def straight(start, end, noise=1e-5, nodes=201):
    position = np.linspace(start, end, nodes)
    s = np.linalg.norm(position - position[0], axis=1)
    tangent = np.tile((position[-1] - position[0]) / s[-1], (nodes, 1))
    zero = np.zeros((nodes, 3))
    return Route(s, position, tangent, zero, noise, np.ones(nodes), s, zero)


def boxes_distance(points, half):
    """Signed distance to a box, positive inside."""
    off = np.abs(points) - half
    outside = np.linalg.norm(np.maximum(off, 0.0), axis=1)
    return np.where(outside > 0, -outside, -np.max(off, axis=1))


def signed(mesh, points):
    wall = wall_of(mesh)
    result = nearest(wall, points)
    assert wall.outward is not None
    return result.distance * result.side * (-1.0 if wall.outward else 1.0)


@settings(max_examples=60, deadline=None)  # the first call compiles
@given(st.integers(0, 10**6), st.booleans())
def test_the_distance_to_a_box_is_exact_inside_and_outside_and_at_its_edges(seed, turned_over):
    half = np.array([0.03, 0.05, 0.02])
    box = trimesh.creation.box(2 * half)
    if turned_over:
        box.invert()
    points = np.random.default_rng(seed).uniform(-0.09, 0.09, (40, 3))
    np.testing.assert_allclose(signed(box, points), boxes_distance(points, half), atol=1e-12)


def test_triangles_of_very_different_size_do_not_hide_each_other():
    ball = trimesh.creation.icosphere(4, 0.01).apply_translation((0, 0, 0.2))
    mesh = trimesh.util.concatenate([trimesh.creation.box((2.0, 2.0, 0.02)), ball])
    points = np.array([[0.3, 0.2, 0.05], [0.0, 0.0, 0.18], [0.7, -0.6, 0.4]])
    result = nearest(wall_of(mesh), points)
    np.testing.assert_allclose(result.distance[[0, 2]], [0.04, 0.39], atol=1e-12)
    assert result.distance[1] == pytest.approx(0.01, abs=1e-5)  # the ball is made of flat faces


@pytest.mark.parametrize("turned_over", [False, True])
def test_a_tube_in_the_middle_of_a_pipe_keeps_the_difference_of_the_radii(turned_over):
    mesh = pipe()
    if turned_over:
        mesh.invert()
    result = clearance(straight([0.02, 0, 0], [0.28, 0, 0]), wall_of(mesh), 0.006)
    apothem = RADIUS * np.cos(np.pi / 64)
    np.testing.assert_allclose(result.distance, apothem - 0.006, atol=1e-9)
    assert result.contacts == result.outside == ()
    assert result.beyond == 0.0


def test_a_route_that_leans_on_the_wall_touches_where_geometry_says():
    leaning = straight([0.02, 0.0, 0.0], [0.28, 0.019, 0.0])
    result = clearance(leaning, wall_of(pipe()), 0.006)
    apothem = RADIUS * np.cos(np.pi / 64)
    assert len(result.contacts) == 1
    slope = 0.019 / leaning.s[-1]
    # the middle reaches apothem - radius from the wall; facets of the pipe are flat to 0.02 mm
    assert result.contacts[0].begin == pytest.approx((apothem - 0.006) / slope, abs=1e-3)
    assert result.contacts[0].end == pytest.approx(leaning.s[-1])
    assert result.outside == ()


def test_a_route_through_the_wall_is_outside_from_there_on_and_says_how_far():
    through = straight([0.02, 0.0, 0.0], [0.28, 0.03, 0.0])
    result = clearance(through, wall_of(pipe()), 0.002)
    (outside,) = result.outside
    apothem = RADIUS * np.cos(np.pi / 64)
    assert outside.begin == pytest.approx(apothem / 0.03 * through.s[-1], abs=1e-3)
    assert result.least == pytest.approx(apothem - 0.03 - 0.002, abs=5e-5)
    assert "out of the lumen" in result.warnings()[0]
    assert "10.0 mm" in result.warnings()[0]


def test_what_lies_beyond_the_open_ends_is_neither_inside_nor_outside():
    result = clearance(straight([-0.05, 0, 0], [0.28, 0, 0], nodes=331), wall_of(pipe()), 0.006)
    assert result.beyond == pytest.approx(0.05, abs=1.5e-3)  # nodes are 1 mm apart
    assert result.outside == ()
    assert np.isnan(result.distance[:49]).all()
    assert np.isfinite(result.distance[52:]).all()
    assert "beyond the ends" in result.warnings()[0]


def test_the_noise_of_the_route_counts_as_contact_but_not_as_out_of_the_lumen():
    near = straight([0.02, 0.0137, 0], [0.28, 0.0137, 0], noise=2e-4)  # 0.28 mm from touching
    result = clearance(near, wall_of(pipe()), 0.006)
    assert len(result.contacts) == 1
    assert result.outside == ()
    assert clearance(straight([0.02, 0.0137, 0], [0.28, 0.0137, 0]), wall_of(pipe()), 0.006).contacts == ()
