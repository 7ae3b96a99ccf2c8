"""Markers beside the centre line: the route is that of the centre line."""

import numpy as np
import pytest

from tssgeom import Frame, FrameResult, Rig, process
from tssgeom.errors import SettingsError, ShapeError
from tssgeom.rig import ShapeSensor
from tssgeom.route.arcs.chain import along, form_of
from tssgeom.route.bounds import polygon
from tssgeom.route.marker_offset import carried_axis, follow_markers
from tssgeom.route.observations import clean
from tssgeom.route.synthetic import Course, chain

BENT = chain(np.array([0.1, 0.15, 0.1]), np.array([3.0, 12.0, 6.0]), np.array([0.0, 0.4, 1.0]))
STRAIGHT = Course(np.array([0.35]), np.zeros((1, 2)))
OFFSET = np.array([[0.0, 0, 0], [25, 0, 0], [-20, 5, 0], [15, -10, 0], [-25, 0, 0], [0, 20, 0], [0, 0, 8]])


def _markers(course: Course, noise: float = 1e-5, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Markers on their offsets [m], and the first axis: the joints carry the same axes as the formula."""
    s = np.linspace(0.0, course.total_length, len(OFFSET))
    joints = np.concatenate(([0.0], np.cumsum(course.length)[:-1]))
    fine = np.linspace(0.0, course.total_length, 4001)
    form = form_of(np.zeros(3), np.eye(3), joints, course.bend)
    axis, tangent = np.array([0.0, 1.0, 0.0]), along(fine, form)[1]
    at = np.searchsorted(fine, s - 1e-9)
    first = carried_axis(tangent, axis)[at]
    second, rng = np.cross(tangent[at], first), np.random.default_rng(seed)
    aside = np.einsum("ij,ijk->ik", 1e-3 * OFFSET, np.stack((first, second, tangent[at]), axis=1))
    return along(s, form)[0] + aside + noise * rng.standard_normal((len(s), 3)), axis


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("course", [BENT, STRAIGHT], ids=["bent", "straight"])
def test_the_route_is_that_of_the_centre_line(course, known):
    points, axis = _markers(course)
    shape, tracked = follow_markers(clean(points), None, OFFSET.tolist(), axis.tolist() if known else None)
    arcs = tracked.fit.arcs
    off = abs(arcs.total_angle - course.total_angle)
    assert off < max(2.5 * arcs.total_angle_se, 0.01)
    assert arcs.total_length == pytest.approx(course.total_length, rel=0.01)
    assert np.abs(shape.points - points).max() == pytest.approx(0.025, rel=0.1)
    assert polygon(points, np.ones(len(points))).turn.sum() > course.total_angle + 0.5  # the markers zigzag


def test_a_stream_starts_from_the_axes_of_the_last_frame():
    sensor = ShapeSensor(marker_offset_mm=tuple(map(tuple, OFFSET.tolist())), marker_axis=(0.0, 2.0, 0.0))
    frames = [Frame(_markers(BENT, 1e-4, seed)[0], float(seed)) for seed in range(8)]
    frames[5].points[3] = np.nan  # an unobserved marker keeps its row
    results = list(process(frames, Rig(shape=sensor), tension_in=5.0))
    for one in results:
        assert isinstance(one, FrameResult)
        assert abs(one.arcs.total_angle - BENT.total_angle) < max(3.0 * one.arcs.total_angle_se, 0.05)
        assert one.arcs.total_length == pytest.approx(BENT.total_length, rel=0.02)
        assert one.tracked.marker_axis is not None


def test_what_cannot_be_is_refused():
    points, axis = _markers(BENT)
    with pytest.raises(ShapeError, match="7 markers, 6 offsets"):
        follow_markers(clean(points), None, OFFSET[:6].tolist(), axis.tolist())
    with pytest.raises(ShapeError, match="lies along the route"):
        follow_markers(clean(_markers(STRAIGHT)[0]), None, (0.0 * OFFSET).tolist(), [1.0, 0.0, 0.0])
    with pytest.raises(SettingsError, match="marker_axis has no direction"):
        ShapeSensor(marker_offset_mm=((0.0, 0.0, 0.0),), marker_axis=(0.0, 0.0, 0.0))
    with pytest.raises(SettingsError, match="give both"):
        ShapeSensor(marker_axis=(0.0, 1.0, 0.0))
    with pytest.raises(SettingsError, match="finite"):
        ShapeSensor(marker_offset_mm=((0.0, float("nan"), 0.0),))
