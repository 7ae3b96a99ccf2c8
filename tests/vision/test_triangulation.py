"""Points are triangulated to the noise of pixels, with a true covariance, and a wrong view is detected."""

import numpy as np
import pytest

from tests.scenes import arch, ring, towards
from tssgeom.vision.cameras import eyes, sight
from tssgeom.vision.triangulation import gates, pixel_scale, triangulate, weights

NOISE = 0.3
POSITIONS, _ = arch(25)


def located(cameras, pixels, noise=NOISE, scale=1.0):
    view_sets = [sight(camera, sightings) for camera, sightings in zip(cameras, pixels, strict=True)]
    slope = np.array([slope for slope, _ in view_sets])
    sd = np.full(slope.shape[1], noise)
    weight = np.array([weights(by_pixel, sd) for _, by_pixel in view_sets])
    return triangulate(eyes(cameras), slope, weight, gates(len(cameras), scale))


def visible_to(lenses, noise=NOISE, seed=0, times=1):
    random = np.random.default_rng(seed)
    positions = np.tile(POSITIONS, (times, 1))
    return [lens.project(positions) + noise * random.standard_normal((len(positions), 2)) for lens in lenses]


@pytest.mark.parametrize("views", [2, 3, 4])
def test_exact_pixels_give_exact_points(cameras_of, views):
    lenses = ring(views)
    result = located(cameras_of(lenses), visible_to(lenses, noise=0.0))
    np.testing.assert_allclose(result.points, POSITIONS, atol=1e-9)  # a micropixel of the inverse lens


@pytest.mark.parametrize("views", [2, 3])
def test_errors_are_as_large_as_their_covariance_says_in_every_direction(cameras_of, views):
    lenses, times = ring(views), 40
    result = located(cameras_of(lenses), visible_to(lenses, times=times))
    error = result.points - np.tile(POSITIONS, (times, 1))
    good = np.isfinite(error[:, 0])
    square = np.einsum("ni,nij,nj->n", error[good], np.linalg.inv(result.covariance[good]), error[good])
    # the mean of 1000 values of chi square with 3 degrees of freedom has a standard error of 0.08
    assert square.mean() == pytest.approx(3.0, abs=0.32)
    assert good.mean() > 0.995  # one in ten thousand is left out by chance


def test_reprojection_errors_give_the_noise_of_a_pixel(cameras_of):
    lenses = ring(3)
    result = located(cameras_of(lenses), visible_to(lenses, times=40), noise=NOISE / 2, scale=5.0)
    scale = pixel_scale(result.square, result.freedom)
    assert scale == pytest.approx(
        2.0, rel=0.05
    )  # 1000 points of 3 degrees of freedom: 2 % and the median's loss


def test_a_view_that_is_wrong_is_left_out_where_two_others_agree(cameras_of):
    lenses = ring(3)
    pixels = visible_to(lenses)
    pixels[1][7] += [14.0, -9.0]
    result = located(cameras_of(lenses), pixels)
    assert result.used[:, 7].tolist() == [True, False, True]
    assert (
        np.linalg.norm(result.points[7] - POSITIONS[7]) < 4e-3
    )  # four standard deviations of two views in depth


def test_two_views_that_contradict_each_other_give_no_point(cameras_of):
    lenses = ring(2)
    pixels = visible_to(lenses)
    pixels[1][7] += [0.0, 6.0]
    result = located(cameras_of(lenses), pixels)
    assert np.isnan(result.points[7]).all()
    assert np.isfinite(np.delete(result.points, 7, axis=0)).all()


def test_one_view_gives_no_point(cameras_of):
    lenses = ring(2)
    pixels = visible_to(lenses)
    pixels[1][3] = np.nan
    assert np.isnan(located(cameras_of(lenses), pixels).points[3]).all()


def test_parallel_rays_give_no_depth(cameras_of):
    lenses = [towards(np.array([x, -0.5, 0.1]), np.zeros(3)) for x in (-0.004, 0.004)]
    assert np.isnan(located(cameras_of(lenses), visible_to(lenses, noise=0.0)).points).all()
