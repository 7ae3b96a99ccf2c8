"""Nearest points on a wall: the compiled entry against its twin."""

import numpy as np
import pytest

from tests.core.twins.lumen_wall import nearest_on_wall
from tssgeom import core
from tssgeom.lumen.wall import Wall

ROUNDING = 1e-12


def soup(rng: np.random.Generator) -> np.ndarray:
    """Triangles in any position, some of them flat or a point."""
    corners = rng.normal(size=(rng.integers(1, 30), 1, 3)) + rng.normal(size=(1, 3, 3)) * 0.3
    corners = corners + 0.2 * rng.normal(size=corners.shape)
    corners[rng.random(len(corners)) < 0.1, 1] = corners[0, 0]
    return np.ascontiguousarray(np.where(rng.random((len(corners), 1, 1)) < 0.1, corners[:, :1], corners))


def grid(rng: np.random.Generator) -> np.ndarray:
    """A wavy sheet with a rim, whose triangles share corners."""
    rows, columns = rng.integers(2, 6, 2)
    height = 0.3 * rng.normal(size=(rows, columns))
    x, y = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    vertex = np.stack([x, y, height], axis=2).astype(float)
    a, b, c, d = vertex[:-1, :-1], vertex[1:, :-1], vertex[:-1, 1:], vertex[1:, 1:]
    triangles = [np.stack(some, axis=2).reshape(-1, 3, 3) for some in ((a, b, c), (b, d, c))]
    return np.ascontiguousarray(np.concatenate(triangles))


@pytest.mark.parametrize(("wall_of", "size"), [(soup, 1.0), (grid, 1.0), (grid, 1e-4)])
def test_positions_distances_sides_and_rims_are_those_of_the_twin(wall_of, size):
    for seed in range(200 if size == 1.0 else 50):
        rng = np.random.default_rng(seed)
        wall = Wall(size * wall_of(rng))
        inside = wall.corners[rng.integers(len(wall.corners), size=2)].mean(axis=1)
        points = np.vstack(
            [
                *(3.0 * size * rng.normal(size=(6, 3)), wall.corners[0], inside),
                *(wall.corners[-1, :2].mean(axis=0), wall.corners[rng.integers(len(wall.corners))]),
            ]
        )
        given = points, wall.corners, wall.boxes.order, wall.boxes.low, wall.boxes.high
        position, distance, side, on_rim = core.nearest_on_wall(*given)
        wanted = nearest_on_wall(*given)
        np.testing.assert_allclose(position, wanted[0], atol=ROUNDING)
        np.testing.assert_allclose(distance, wanted[1], atol=ROUNDING)
        off = wanted[1] > ROUNDING  # on the wall itself rounding decides the side
        np.testing.assert_array_equal(side[off], wanted[2][off])
        np.testing.assert_array_equal(on_rim, wanted[3])


def test_no_points_and_points_that_are_not_finite_end():
    wall = Wall(grid(np.random.default_rng(0)))
    tree = wall.corners, wall.boxes.order, wall.boxes.low, wall.boxes.high
    assert [len(one) for one in core.nearest_on_wall(np.zeros((0, 3)), *tree)] == [0, 0, 0, 0]
    for value in (np.nan, np.inf):
        assert not np.isfinite(core.nearest_on_wall(np.full((1, 3), value), *tree)[1]).any()
