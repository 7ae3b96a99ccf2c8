"""Tags in rendered films: named, in the order of their numbers, with corners to a fraction of a pixel."""

import cv2
import numpy as np
import pytest

from tests.scenes import Scene, TagAt, arch, render, ring, tag_poses
from tssgeom.errors import SettingsError, ShapeError
from tssgeom.vision.localisation import Alone
from tssgeom.vision.tags import dictionary, tag_finder
from tssgeom.vision.track import Wanted, track

FIND = tag_finder("4x4_50")
SIDE = 0.018
IDS = (7, 3, 12, 20, 31, 44, 0, 18, 25)
POSITIONS, _ = arch(len(IDS))


def tag(number, position, axes):
    picture = cv2.aruco.generateImageMarker(dictionary("4x4_50"), number, 6)
    return TagAt((picture > 127).astype(int), SIDE, position, axes)


def scene(numbers=IDS, covers=(), toward=(0.0, -0.6, 0.2)):
    poses = tag_poses(POSITIONS, np.array(toward))
    tags = [tag(*one) for one in zip(numbers, POSITIONS, poses, strict=True)]
    return Scene(tags=tags, covers=covers, background=90.0)


def images_of(lenses, sightings, frames=1):
    return [[FIND(render(lens, sightings, v, f)) for v, lens in enumerate(lenses)] for f in range(frames)]


def test_tags_are_located_at_their_middles_in_the_given_order(cameras_of):
    lenses = ring(2)
    result = track(cameras_of(lenses), images_of(lenses, scene(), 4), Wanted(tags=True, ids=IDS))
    assert result.ids == IDS
    error = np.array([one.points for one in result.frames]) - POSITIONS
    spread = np.array([one.covariance for one in result.frames])
    stated = np.sqrt(np.trace(spread, axis1=2, axis2=3).mean() / 3)
    assert np.isfinite(error).all()
    # corners share what the lens and the pixels do to an edge, which no view can distinguish
    assert np.sqrt(np.mean(error**2)) < 2.0 * stated
    assert np.sqrt(np.mean(error**2)) < 5e-5  # a twentieth of a pixel


def test_without_an_order_the_numbers_rise_along_the_route(cameras_of):
    lenses = ring(2)
    result = track(cameras_of(lenses), images_of(lenses, scene(sorted(IDS))), Wanted(tags=True))
    assert result.ids == tuple(sorted(IDS))
    np.testing.assert_allclose(result.frames[0].points, POSITIONS, atol=3e-4)


def test_a_hidden_tag_is_missing(cameras_of):
    lenses = ring(2)
    x, y = lenses[0].project(POSITIONS[4:5])[0].astype(int)
    hidden = scene(covers=((0, x - 14, y - 14, x + 3, y + 14),))
    result = track(cameras_of(lenses), images_of(lenses, hidden), Wanted(tags=True, ids=IDS))
    assert np.flatnonzero(np.isnan(result.frames[0].points[:, 0])).tolist() == [4]


def test_a_number_that_occurs_twice_is_left_out(cameras_of):
    lenses = ring(2)
    twice = scene((7, 3, 12, 20, 31, 44, 0, 7, 25))
    result = track(cameras_of(lenses), images_of(lenses, twice), Wanted(tags=True))
    assert 7 not in result.ids
    assert len(result.ids) == 7


def test_one_camera_locates_tags_of_a_known_side_with_large_errors(cameras_of):
    lenses = ring(1, distance=0.3)
    result = track(
        cameras_of(lenses),
        images_of(lenses, scene(toward=tuple(lenses[0].position))),
        Wanted(tags=True, ids=IDS, alone=Alone(side=SIDE)),
    )
    one = result.frames[0]
    sightings = np.isfinite(one.points[:, 0])
    assert sightings.sum() >= 5
    error = one.points[sightings] - POSITIONS[sightings]
    square = np.einsum("ni,nij,nj->n", error, np.linalg.inv(one.covariance[sightings]), error)
    assert np.sqrt(square.mean() / 3) < 2.0
    along = np.sqrt(
        np.einsum("i,nij,j->n", lenses[0].rotation[2], one.covariance[sightings], lenses[0].rotation[2])
    )
    across = np.sqrt(
        np.einsum("i,nij,j->n", lenses[0].rotation[0], one.covariance[sightings], lenses[0].rotation[0])
    )
    assert np.median(along / across) > 3  # depth from size is the poor one


def test_a_family_that_is_none_is_refused():
    with pytest.raises(SettingsError, match="apriltag_36h11"):
        tag_finder("4x4")


def test_no_tag_at_all_is_refused(cameras_of):
    lenses = ring(2)
    with pytest.raises(ShapeError, match="no tag"):
        track(cameras_of(lenses), images_of(lenses, Scene()), Wanted(tags=True))


@pytest.mark.parametrize("family", ["apriltag_36h11", "6x6_250"])
def test_other_families_are_read(family):
    lens, cells = ring(1)[0], 8
    picture = cv2.aruco.generateImageMarker(dictionary(family), 5, cells)
    axes = tag_poses(np.zeros((1, 3)), lens.position)[0]
    image = render(lens, Scene(tags=[TagAt((picture > 127).astype(int), 0.05, np.zeros(3), axes)]), 0, 1)
    result = tag_finder(family)(image)
    assert result.ids.tolist() == [5]
    half = 0.025
    corners = np.array([-axes[0] + axes[1], axes[0] + axes[1], axes[0] - axes[1], -axes[0] - axes[1]]) * half
    np.testing.assert_allclose(result.pixels[0], lens.project(corners), atol=0.3)
