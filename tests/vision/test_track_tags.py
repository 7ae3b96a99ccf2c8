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
PLACES, _ = arch(len(IDS))


def tag(number, place, axes):
    picture = cv2.aruco.generateImageMarker(dictionary("4x4_50"), number, 6)
    return TagAt((picture > 127).astype(int), SIDE, place, axes)


def scene(numbers=IDS, covers=(), toward=(0.0, -0.6, 0.2)):
    poses = tag_poses(PLACES, np.array(toward))
    tags = [tag(*one) for one in zip(numbers, PLACES, poses, strict=True)]
    return Scene(tags=tags, covers=covers, background=90.0)


def images_of(lenses, seen, frames=1):
    return [[FIND(render(lens, seen, v, f)) for v, lens in enumerate(lenses)] for f in range(frames)]


def test_tags_are_placed_at_their_middles_in_the_order_that_is_asked(cameras_of):
    lenses = ring(2)
    found = track(cameras_of(lenses), images_of(lenses, scene(), 4), Wanted(tags=True, ids=IDS))
    assert found.ids == IDS
    error = np.array([one.points for one in found.frames]) - PLACES
    spread = np.array([one.covariance for one in found.frames])
    told = np.sqrt(np.trace(spread, axis1=2, axis2=3).mean() / 3)
    assert np.isfinite(error).all()
    # corners share what the lens and the pixels do to an edge, which no view can tell from the others
    assert np.sqrt(np.mean(error**2)) < 2.0 * told
    assert np.sqrt(np.mean(error**2)) < 5e-5  # a twentieth of a pixel


def test_without_an_order_the_numbers_rise_along_the_route(cameras_of):
    lenses = ring(2)
    found = track(cameras_of(lenses), images_of(lenses, scene(sorted(IDS))), Wanted(tags=True))
    assert found.ids == tuple(sorted(IDS))
    np.testing.assert_allclose(found.frames[0].points, PLACES, atol=3e-4)


def test_a_hidden_tag_is_a_gap(cameras_of):
    lenses = ring(2)
    x, y = lenses[0].project(PLACES[4:5])[0].astype(int)
    hidden = scene(covers=((0, x - 14, y - 14, x + 3, y + 14),))
    found = track(cameras_of(lenses), images_of(lenses, hidden), Wanted(tags=True, ids=IDS))
    assert np.flatnonzero(np.isnan(found.frames[0].points[:, 0])).tolist() == [4]


def test_a_number_that_is_there_twice_tells_nothing(cameras_of):
    lenses = ring(2)
    twice = scene((7, 3, 12, 20, 31, 44, 0, 7, 25))
    found = track(cameras_of(lenses), images_of(lenses, twice), Wanted(tags=True))
    assert 7 not in found.ids
    assert len(found.ids) == 7


def test_one_camera_places_tags_of_a_known_side_and_says_how_badly(cameras_of):
    lenses = ring(1, distance=0.3)
    found = track(
        cameras_of(lenses),
        images_of(lenses, scene(toward=tuple(lenses[0].place))),
        Wanted(tags=True, ids=IDS, alone=Alone(side=SIDE)),
    )
    one = found.frames[0]
    seen = np.isfinite(one.points[:, 0])
    assert seen.sum() >= 5
    error = one.points[seen] - PLACES[seen]
    square = np.einsum("ni,nij,nj->n", error, np.linalg.inv(one.covariance[seen]), error)
    assert np.sqrt(square.mean() / 3) < 2.0
    along = np.sqrt(
        np.einsum("i,nij,j->n", lenses[0].rotation[2], one.covariance[seen], lenses[0].rotation[2])
    )
    across = np.sqrt(
        np.einsum("i,nij,j->n", lenses[0].rotation[0], one.covariance[seen], lenses[0].rotation[0])
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
    axes = tag_poses(np.zeros((1, 3)), lens.place)[0]
    image = render(lens, Scene(tags=[TagAt((picture > 127).astype(int), 0.05, np.zeros(3), axes)]), 0, 1)
    found = tag_finder(family)(image)
    assert found.ids.tolist() == [5]
    half = 0.025
    corners = np.array([-axes[0] + axes[1], axes[0] + axes[1], axes[0] - axes[1], -axes[0] - axes[1]]) * half
    np.testing.assert_allclose(found.pixels[0], lens.project(corners), atol=0.3)
