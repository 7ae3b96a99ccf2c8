"""A fit that lost its points is refused: what comes out follows the points, or nothing comes out."""

from contextlib import suppress

import numpy as np
import pytest

from tssgeom.errors import FitError
from tssgeom.route.geometry import measure
from tssgeom.route.observations import clean
from tssgeom.route.tracking import follow


def _hairpin(gap: float, noise: float) -> np.ndarray:
    """Out by 0.1 m and back beside it, the turn itself not sampled [m]."""
    x = np.linspace(0.0, 0.1, 30)
    out, back = np.column_stack((x, 0 * x, 0 * x)), np.column_stack((x[-2::-1], 0 * x[1:] + gap, 0 * x[1:]))
    return np.vstack((out, back)) + noise * np.random.default_rng(0).standard_normal((59, 3))


@pytest.mark.parametrize("gap", [0.0, 5e-4, 5e-3])
@pytest.mark.parametrize("noise", [0.0, 1e-4])
@pytest.mark.parametrize("known", [True, False])
def test_a_turn_back_between_two_points_is_half_a_circle_or_refused(gap, noise, known):
    points = _hairpin(gap, noise)
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    with suppress(FitError):
        arcs = follow(clean(points, way if known else None), None, None).fit.arcs
        assert arcs.total_angle == pytest.approx(np.pi, rel=0.03)


@pytest.mark.parametrize("method", ["auto", "spline", "arcs"])
def test_a_route_is_not_straight_because_it_turns_straight_back(method):
    points, s = _hairpin(0.0, 0.0), np.linspace(0.0, 0.2, 59)
    with suppress(FitError):
        assert measure(clean(points, s), None, method).arcs.total_angle > 3.0


@pytest.mark.parametrize("corner", [0.5, 1.0, 1.6])
def test_a_kink_between_two_points_is_followed(corner):
    """The turn is within one spacing, so its angle is known to the noise over the lengths beside it."""
    x = np.linspace(0.0, 0.1, 30)
    first = np.column_stack((x, 0 * x, 0 * x))
    second = first[-1] + (x[1:, None]) * np.array([np.cos(corner), np.sin(corner), 0.0])
    points = np.vstack((first, second)) + 1e-4 * np.random.default_rng(1).standard_normal((59, 3))
    arcs = follow(clean(points), None, None).fit.arcs
    assert abs(arcs.total_angle - corner) < max(4 * arcs.total_angle_se, 0.01)
