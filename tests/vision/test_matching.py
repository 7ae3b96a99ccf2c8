"""Blobs of several views are matched where one answer is left, and left open where there are two."""

import numpy as np

from tests.scenes import arch, loop, ring, towards
from tssgeom.vision.cameras import eyes, sight
from tssgeom.vision.matching import clash, match, sure
from tssgeom.vision.triangulation import gates, weights


def matched(cameras, pixels, noise=0.1):
    view_sets = [sight(camera, sightings) for camera, sightings in zip(cameras, pixels, strict=True)]
    weights_of_all = [weights(by_pixel, np.full(len(by_pixel), noise)) for _, by_pixel in view_sets]
    return match(eyes(cameras), [slope for slope, _ in view_sets], weights_of_all, gates(len(cameras)))


def views_of(lenses, positions, noise=0.1, seed=3):
    """Pixels of each lens in an order of its own, and that order."""
    random = np.random.default_rng(seed)
    orders = [random.permutation(len(positions)) for _ in lenses]
    pixels = [
        lens.project(positions[order]) + noise * random.standard_normal(positions[:, :2].shape)
        for lens, order in zip(lenses, orders, strict=True)
    ]
    return pixels, orders


def true_share(result, chosen, orders):
    """Whether each chosen combination is of one marker."""
    rows = result.blobs[chosen]
    named = [[order[k] for k, order in zip(row, orders, strict=True) if k >= 0] for row in rows]
    return np.array([len(set(one)) == 1 for one in named])


def test_no_sure_match_is_wrong_in_a_hundred_scenes(cameras_of):
    wrong, right = 0, 0
    for seed in range(100):
        lenses = ring(2 + seed % 2, height=0.3 + 0.01 * (seed % 40))
        positions = loop(20)[0] if seed % 3 else arch(20)[0]
        pixels, orders = views_of(lenses, positions, seed=seed)
        result = matched(cameras_of(lenses), pixels)
        good = true_share(result, sure(result)[0], orders)
        wrong, right = wrong + int((~good).sum()), right + int(good.sum())
    assert wrong == 0
    assert right > 0.9 * 100 * 20  # the rest is left open, since two answers fit


def test_markers_on_one_epipolar_line_are_left_open(cameras_of):
    here, there = np.array([-0.1, -0.5, 0.0]), np.array([0.1, -0.5, 0.0])
    lenses = [towards(position, np.zeros(3), distortion=(0.0,) * 5) for position in (here, there)]
    positions = np.column_stack((np.linspace(-0.05, 0.05, 5), np.zeros(5), np.zeros(5)))
    pixels, _ = views_of(lenses, positions)
    result = matched(cameras_of(lenses), pixels)
    certain, left = sure(result)
    assert len(certain) == 0
    assert len(left) >= 10  # each of the five fits several of the other view


def test_a_marker_that_one_of_three_cameras_does_not_see_is_matched_by_the_others(cameras_of):
    lenses, positions = ring(3), arch(15)[0]
    pixels, orders = views_of(lenses, positions)
    hidden = int(np.flatnonzero(orders[2] == 6)[0])
    pixels[2], orders[2] = np.delete(pixels[2], hidden, axis=0), np.delete(orders[2], hidden)
    result = matched(cameras_of(lenses), pixels)
    certain = sure(result)[0]
    by_two = [row for row in result.blobs[certain] if row[2] < 0]
    assert [orders[0][row[0]] for row in by_two] == [6]


def test_combinations_that_share_a_blob_clash():
    blobs = np.array([[0, 1, -1], [0, -1, 2], [3, 4, -1], [-1, 4, 5]])
    expected = np.zeros((4, 4), bool)
    expected[0, 1] = expected[1, 0] = expected[2, 3] = expected[3, 2] = True
    np.testing.assert_array_equal(clash(blobs), expected)
