"""Routes with corners: no smooth curve fits them, and their angle is estimated all the same."""

import math

import numpy as np
import pytest

from tssgeom.route.arcs.corners import _turned
from tssgeom.route.geometry import measure
from tssgeom.route.observations import clean
from tssgeom.route.tracking import follow

CORNERS = {
    "one": [(0, 0, 0), (2, 0, 0), (2, 2, 0)],
    "two": [(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0)],
    "closed square": [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 0)],
    "out of plane": [(0, 0, 0), (1, 0, 0), (1.5, 0.5, 0), (2.5, 0.5, 0), (3, 0.5, 1)],
}


def _polygon(name: str, n: int, noise: float, seed: int = 1) -> tuple[np.ndarray, np.ndarray, float]:
    """Points [m] at even stations [m] of a polygon, and its angle [rad]."""
    corner = 0.1 * np.array(CORNERS[name], float)
    leg = np.diff(corner, axis=0)
    size = np.linalg.norm(leg, axis=1)
    way = leg / size[:, None]
    at = np.append(0.0, np.cumsum(size))
    s = np.linspace(0.0, at[-1], n)
    points = np.column_stack([np.interp(s, at, corner[:, c]) for c in range(3)])
    angle = sum(math.acos(np.clip(a @ b, -1.0, 1.0)) for a, b in zip(way[1:], way[:-1], strict=True))
    return points + noise * np.random.default_rng(seed).standard_normal((n, 3)), s, angle


@pytest.mark.parametrize("known", [True, False], ids=["stations known", "unknown"])
@pytest.mark.parametrize("noise", [0.0, 1e-5, 5e-4])
@pytest.mark.parametrize("n", [50, 77, 200, 600])
@pytest.mark.parametrize("name", CORNERS)
def test_a_polygon_turns_by_its_corners(name, n, noise, known):
    points, s, angle = _polygon(name, n, noise)
    arcs = measure(clean(points, s if known else None)).arcs
    assert abs(arcs.total_angle - angle) < max(0.025 * angle, 3.0 * arcs.total_angle_se)
    assert arcs.total_angle_se < 0.2


def test_a_corner_is_kept_from_frame_to_frame():
    """A chain with a kink starts the next fit with pieces that are as short."""
    last = None
    for seed in range(12):
        points, _, angle = _polygon("one", 100, 3e-4, seed)
        last = follow(clean(points), 3e-4, last)
        assert last.fit.arcs.method == "arcs"
        assert last.fit.arcs.total_angle == pytest.approx(angle, abs=0.03)


def test_a_coarse_polygon_has_a_standard_error_that_covers_its_bias():
    points, s, angle = _polygon("two", 10, 0.0)
    arcs = measure(clean(points, s)).arcs
    assert abs(arcs.total_angle - angle) < 2.0 * arcs.total_angle_se


def test_a_frame_stays_square_over_thousands_of_turns():
    rng, frame = np.random.default_rng(0), np.eye(3)
    for _ in range(2000):
        tangent = rng.standard_normal(3)
        tangent /= np.linalg.norm(tangent)
        _, frame = _turned(frame, tangent)
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(frame[0], tangent, atol=1e-12)
