"""Numbers of markers in an image: white, above every outline, and beside what they number."""

import numpy as np

from tests.scenes import ring
from tests.vision.conftest import camera_of
from tssgeom.vision.overlay import annotated
from tssgeom.vision.views import Located, Sightings

GREY = 40


def test_each_number_is_white_and_stands_off_the_line_on_its_outer_side() -> None:
    lens = ring(1)[0]
    turn = np.linspace(0.0, np.pi, 9)
    points = 0.1 * np.column_stack([np.cos(turn), 0.0 * turn, np.sin(turn)])
    pixels = lens.project(points)
    count = len(points)
    sightings = Sightings(pixels[:, None], np.full(count, 0.1), np.full(count, -1), np.full(count, 80.0))
    one = Located(points, np.zeros((count, 3, 3)), np.zeros(count), np.ones(count), np.arange(count)[:, None])
    image = np.full((lens.height, lens.width, 3), GREY, np.uint8)
    picture = annotated(image, camera_of(lens), sightings, one, 0, range(count), "")
    heading = picture.shape[0] - lens.height
    white = np.argwhere((picture[heading:] > 180).all(axis=2))[:, ::-1]
    middle = pixels.mean(axis=0)
    nearest = np.linalg.norm(white[:, None] - pixels, axis=2)
    written = white[nearest.min(axis=1) > 8.0]  # farther than the outlines, and their strokes
    labelled = np.unique(np.linalg.norm(written[:, None] - pixels, axis=2).argmin(axis=1))
    assert labelled.tolist() == list(range(count))
    out = np.linalg.norm(pixels - middle, axis=1)
    assert (np.linalg.norm(written - middle, axis=1) > out.min()).all()
