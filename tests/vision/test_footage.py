"""Videos and folders of images come frame by frame, in step, or are refused with a reason."""

import os

import cv2
import numpy as np
import pytest

from tssgeom.errors import SettingsError, SourceError
from tssgeom.vision.footage import open_footage


def folder(path, count, shade=0):
    path.mkdir()
    for k in range(count):
        cv2.imwrite(str(path / f"shot{k}.png"), np.full((8, 10, 3), shade + k, np.uint8))
    return path


def video(path, count, rate=25.0):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), rate, (32, 16))
    for k in range(count):
        writer.write(np.full((16, 32, 3), 10 * k, np.uint8))
    writer.release()
    return path


def test_images_come_in_the_order_of_their_numbers(tmp_path):
    footage = open_footage([folder(tmp_path / "left", 12)])
    assert [int(image[0, 0, 0]) for (image,) in footage] == list(range(12))
    assert footage.rate is None


def test_two_sources_run_in_step_until_the_shorter_ends_and_it_is_said(tmp_path):
    footage = open_footage([folder(tmp_path / "left", 5), folder(tmp_path / "right", 3, 100)], rate=10.0)
    pairs = [(int(one[0, 0, 0]), int(two[0, 0, 0])) for one, two in footage]
    assert pairs == [(0, 100), (1, 101), (2, 102)]
    assert "3 to 5 frames" in footage.warnings[0]
    assert footage.rate == 10.0


def test_a_video_states_its_rate_and_can_be_read_twice(tmp_path):
    footage = open_footage([video(tmp_path / "run.avi", 7)])
    assert footage.rate == pytest.approx(25.0)
    assert [len(list(footage)), len(list(footage))] == [7, 7]


def test_an_image_that_cannot_be_read_is_a_frame_without_sight(tmp_path):
    path = folder(tmp_path / "left", 3)
    (path / "shot1.png").write_bytes(b"no image")
    os.mkfifo(path / "shot3.png")
    (path / "shot4.png").symlink_to("/dev/zero")
    assert [image is None for (image,) in open_footage([path])] == [False, True, False, True, True]


def test_videos_of_different_rates_are_refused(tmp_path):
    with pytest.raises(SettingsError, match="film in step"):
        open_footage([video(tmp_path / "a.avi", 3), video(tmp_path / "b.avi", 3, rate=30.0)])


def test_what_is_no_video_is_refused(tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.mp4").write_text("no video")
    for name, says in (("gone.mp4", "no such file"), ("empty", "no image"), ("text.mp4", "cannot be read")):
        with pytest.raises(SourceError, match=says):
            open_footage([tmp_path / name])
