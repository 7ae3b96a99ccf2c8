"""Blobs are found to a small part of a pixel, and what is no whole blob is not taken for one."""

import numpy as np
import pytest

from tests.scenes import Ball, Scene, arch, render, ring
from tssgeom.errors import SettingsError
from tssgeom.vision.blobs import BlobLook, blob_finder

LENS = ring(1)[0]
PLACES, _ = arch(12)
TRUTH = LENS.project(PLACES)


def balls(**look):
    return [Ball(place, **look) for place in PLACES]


def off(found, truth=TRUTH):
    """Distance of every found centre to the nearest true one, and of every true one to the nearest found."""
    distance = np.linalg.norm(found.centre[:, None] - truth[None], axis=2)
    return distance.min(axis=1), distance.min(axis=0)


def test_every_ball_is_found_to_a_twentieth_of_a_pixel():
    found = blob_finder(BlobLook())(render(LENS, Scene(balls()), 0, 1))
    nearest, missed = off(found)
    assert len(found) == len(PLACES)
    assert max(nearest.max(), missed.max()) < 0.05


def test_the_error_of_a_centre_is_what_the_noise_of_the_image_allows():
    find, errors, stated = blob_finder(BlobLook()), [], []
    for seed in range(6):
        found = find(render(LENS, Scene(balls()), 0, seed, noise=12.0))
        order = np.linalg.norm(found.centre[:, None] - TRUTH[None], axis=2).argmin(axis=1)
        errors.append((found.centre - TRUTH[order]).ravel())
        stated.append(found.noise)
    ratio = np.concatenate(errors).std() / np.concatenate(stated).mean()
    assert 0.75 < ratio < 1.3  # 140 errors tell their spread to 6 %; blur and edge are not in the propagation


def test_dark_balls_are_found_on_a_bright_ground():
    scene = Scene(balls(colour=(20.0, 20.0, 20.0)), background=170.0)
    found = blob_finder(BlobLook("dark"))(render(LENS, scene, 0, 2))
    assert len(found) == len(PLACES)
    assert off(found)[0].max() < 0.08


def test_a_colour_is_told_from_others_as_bright():
    red = [Ball(place, colour=(40.0, 40.0, 220.0)) for place in PLACES[::2]]
    colours = [(220.0, 40.0, 40.0), (230.0, 230.0, 230.0)] * 3
    others = [Ball(p, colour=c) for p, c in zip(PLACES[1::2], colours, strict=True)]
    found = blob_finder(BlobLook("#e03030"))(render(LENS, Scene([*red, *others]), 0, 3))
    assert len(found) == len(red)
    assert off(found, TRUTH[::2])[0].max() < 0.08


def test_a_ball_cut_by_the_edge_of_the_image_is_left_out():
    ray = np.append(LENS.slopes(np.array([[1.0, 240.0]]))[0], 1.0) @ LENS.rotation
    cut = Ball(LENS.place + 0.5 * ray)
    assert len(blob_finder(BlobLook())(render(LENS, Scene([cut]), 0, 4))) == 0


def test_an_image_of_noise_alone_holds_no_blob():
    assert len(blob_finder(BlobLook())(render(LENS, Scene(), 0, 6, noise=6.0))) == 0


@pytest.mark.parametrize(("look", "says"), [("pink", "bright, dark or a colour"), ("#808482", "nearly grey")])
def test_a_look_that_is_none_is_refused(look, says):
    with pytest.raises(SettingsError, match=says):
        blob_finder(BlobLook(look))
