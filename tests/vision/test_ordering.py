"""Nameless markers are ordered along the one chain that links them, or the frame is refused."""

import numpy as np
import pytest

from tests.scenes import arch, loop
from tssgeom.errors import ShapeError
from tssgeom.vision.ordering import belonging, chained


def shuffled(positions, seed):
    order = np.random.default_rng(seed).permutation(len(positions))
    return positions[order], order


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("route", [arch(20)[0], loop(24)[0], loop(40, turns=2.2)[0]])
def test_the_order_of_shuffled_markers_comes_back(route, seed):
    positions, order = shuffled(route, seed)
    result = order[chained(positions)]
    assert (np.diff(result) == 1).all() or (np.diff(result) == -1).all()


def test_coils_closer_to_each_other_than_neighbours_are_refused():
    positions, _ = loop(12, radius=0.05, rise=0.02, turns=2.0)
    with pytest.raises(ShapeError, match=r"tags with numbers|no one chain"):
        chained(shuffled(positions, 1)[0])


def test_a_hole_of_several_markers_is_refused():
    positions = np.delete(arch(20)[0], [7, 8, 9, 10, 11], axis=0)
    with pytest.raises(ShapeError, match="no one chain"):
        chained(positions)


def test_three_markers_are_no_route():
    with pytest.raises(ShapeError, match="3 markers"):
        chained(np.eye(3))


def test_a_lone_point_far_off_does_not_belong():
    positions = np.vstack((arch(12)[0], [[0.0, 0.4, 0.0]]))
    assert belonging(positions, 0.05).tolist() == [True] * 12 + [False]
