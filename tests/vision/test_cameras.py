"""Cameras project points as the optics of the scenes do, and their rays pass through the points."""

import numpy as np
import pytest

from tests.scenes import arch, ring
from tssgeom.errors import SettingsError
from tssgeom.vision.cameras import pixels_by_slope, project, refuse_other_size, sight

POSITIONS, _ = arch(30)
LENSES = ring(3)


@pytest.mark.parametrize("view", range(3))
def test_points_project_to_where_the_lens_bends_them(cameras_of, view):
    sightings = project(cameras_of(LENSES)[view], POSITIONS)
    # two programs in double precision on the same formula
    np.testing.assert_allclose(sightings, LENSES[view].project(POSITIONS), atol=1e-9)


def test_a_sight_undoes_the_lens_out_to_the_corners_of_the_image(cameras_of):
    camera, lens = cameras_of(LENSES)[0], LENSES[0]
    corners = np.array([[0.0, 0.0], [639.0, 0.0], [639.0, 479.0], [0.0, 479.0], [300.0, 200.0]])
    slope, _ = sight(camera, corners)
    # a thousandth of the finest centre that a blob gives
    np.testing.assert_allclose(lens.pixels(slope), corners, atol=2e-5)


def test_the_derivative_of_a_pixel_is_that_of_the_lens(cameras_of):
    camera, lens = cameras_of(LENSES)[1], LENSES[1]
    slope = np.array([[0.3, -0.2], [0.0, 0.1], [-0.4, 0.3]])
    for axis in range(2):
        step = 1e-6 * np.eye(2)[axis]
        change = (lens.pixels(slope + step) - lens.pixels(slope - step)) / 2e-6
        # central differences: rounding of 1e-13 px over steps of 1e-6
        np.testing.assert_allclose(pixels_by_slope(camera, slope)[:, :, axis], change, atol=1e-5)


def test_a_point_behind_a_camera_has_no_pixel(cameras_of):
    camera = cameras_of(LENSES)[0]
    behind = camera.position - camera.rotation[2]
    sightings = project(camera, np.array([behind, POSITIONS[0]]))
    assert np.isnan(sightings[0]).all()
    assert np.isfinite(sightings[1]).all()


def test_images_of_another_size_than_calibrated_are_refused(cameras_of):
    with pytest.raises(SettingsError, match=r"320 x 240 px.*640 x 480 px"):
        refuse_other_size(cameras_of(LENSES)[0], np.zeros((240, 320)), "small.avi")
