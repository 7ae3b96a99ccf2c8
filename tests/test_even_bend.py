"""A route that a rig gives as one even bend, for pictures and calls that need a route in space."""

import numpy as np
import pytest

from tssgeom.analysis import even_bend
from tssgeom.route.pieces import Arcs


@pytest.mark.parametrize("angle", [0.0, 1e-3, 3.0, 6.2, 20.0, 60.0])
def test_points_and_fit_of_an_even_bend_have_its_length_and_angle(angle):
    result = even_bend(Arcs.exact(np.array([0.8]), np.array([angle])))
    assert result.arcs.total_angle == angle
    assert result.arcs.total_angle_se == 0.0
    assert result.profile.total_angle == pytest.approx(angle, abs=1e-5)
    chords = np.linalg.norm(np.diff(result.frame.points, axis=0), axis=1)
    assert chords.max() == pytest.approx(chords.min(), rel=1e-6)
    assert result.route.s[-1] == pytest.approx(0.8, rel=1e-6)
    assert result.warnings == ()


def test_turns_of_a_long_bend_lie_side_by_side():
    points = even_bend(Arcs.exact(np.array([1.0]), np.array([20.0]))).frame.points
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    along = np.abs(np.subtract.outer(*[np.linspace(0.0, 1.0, len(points))] * 2))
    assert apart[along > 0.1].min() > 0.02
