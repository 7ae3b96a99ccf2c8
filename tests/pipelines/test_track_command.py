"""`track` from films to a recording that the other commands read, and `track --calibrate` before it."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.described import described
from tests.scenes import Ball, Scene, arch, board_images, board_poses, checkerboard, render, ring
from tests.view.recorded import columns, entities, timelines, verify, views
from tssgeom.io.formats.cameras import read_cameras
from tssgeom.io.formats.files import open_recording

PROGRAM = (sys.executable, "-c", "from pipelines.cli import main; main()")
COUNT, FRAMES = 14, 5
HEADING = 18  # rows above each image that say which it is
LENSES = [
    replace(lens, focal=tuple(0.75 * f for f in lens.focal), centre=(238.0, 182.0), width=480, height=360)
    for lens in ring(2)
]


def routes():
    return [arch(COUNT, 0.03 * f) for f in range(FRAMES)]


@pytest.fixture(scope="module")
def filmed(tmp_path_factory) -> Path:
    """A folder with a film and images of a board for each of two cameras."""
    folder = tmp_path_factory.mktemp("films")
    board, poses = checkerboard(), board_poses(checkerboard(), 16)[::2]
    for v, lens in enumerate(LENSES):
        (folder / "boards" / f"cam{v}").mkdir(parents=True)
        for k, image in enumerate(board_images(lens, board, poses, v)):
            cv2.imwrite(str(folder / "boards" / f"cam{v}" / f"{k}.png"), image)
        film = cv2.VideoWriter(str(folder / f"cam{v}.avi"), cv2.VideoWriter_fourcc(*"FFV1"), 25.0, (480, 360))
        for f, (locations, _) in enumerate(routes()):
            balls = [Ball(position, 0.005) for position in locations]
            x, y = lens.project(locations[5:6])[0].astype(int)
            hidden = [(v, x - 9, y - 9, x + 10, y + 10)] if v == 1 and f == 2 else []
            film.write(render(lens, Scene(balls, covers=hidden), v, f))
        film.release()
    return folder


@pytest.fixture
def calibration(filmed, run) -> Path:
    path = filmed / "cameras.toml"
    if not path.exists():
        sources = [filmed / "boards" / name for name in ("cam0", "cam1")]
        outcome = run(
            "track", *sources, "--calibrate", "--board", "9x6", "--square-mm", "30", "--out", path, "--json"
        )
        assert outcome.status == 0
        report = json.loads(outcome.out)
        described("track --calibrate --json", report)
        assert max(camera["reprojection_px"] for camera in report["cameras"]) < 0.3
    return path


def films(filmed):
    return [filmed / "cam0.avi", filmed / "cam1.avi"]


def test_a_calibration_from_boards_reads_back_with_both_cameras_in_one_frame(calibration):
    one, two = read_cameras(calibration)
    assert (one.name, two.name) == ("cam0", "cam1")
    apart = np.linalg.norm(LENSES[1].position - LENSES[0].position)
    assert np.linalg.norm(two.position - one.position) == pytest.approx(
        apart, rel=0.01
    )  # the s.e. of eight boards is 3 ‰


def test_films_become_a_recording_that_analyse_reads_with_the_angle_in_its_error_bar(
    filmed, calibration, run, tmp_path
):
    out, start = tmp_path / "run.jsonl", LENSES[0].project(routes()[0][0][:1])[0]
    outcome = run(
        "track", *films(filmed), "--calibration", calibration, "--blobs", "bright", "--out", out, "--json",
        "--proximal", f"{start[0]:.0f},{start[1]:.0f}", "--overlay", tmp_path / "seen",
    )  # fmt: skip
    output = json.loads(outcome.out)
    described("track --json", output)
    assert outcome.status == 0
    assert (output["frames"], output["markers"], output["warnings"]) == (FRAMES, COUNT, [])
    assert output["seen"] == pytest.approx(1 - 1 / (FRAMES * COUNT))  # one marker is hidden once
    assert len(list((tmp_path / "seen").glob("frame_*.jpg"))) == FRAMES
    recording = open_recording(out)
    assert recording.timed
    frames = list(recording.frames)
    assert [frame.time for frame in frames] == pytest.approx([k / 25.0 for k in range(FRAMES)])
    assert np.isnan(frames[2].points[5]).all()
    assert all(frame.noise and 1e-6 < frame.noise < 1e-3 for frame in frames)
    shape = json.loads(run("analyse", out, "--json").out)
    assert (shape["frames"], shape["rejected"]) == (FRAMES, 0)
    angle = routes()[-1][1]
    # three standard errors of the markers, and 3 ‰ that the calibration from eight small boards leaves
    assert abs(shape["total_angle_rad"] - angle) < 3 * shape["total_angle_se_rad"] + 3e-3 * angle


def test_the_picture_has_each_image_the_markers_in_space_and_how_sure_they_are(
    filmed, calibration, run, tmp_path
):
    picture = tmp_path / "seen.rrd"
    command = ("track", *films(filmed), "--calibration", calibration, "--blobs", "bright", "--quiet")
    assert run(*command, "--out", tmp_path / "run.jsonl", "--picture", picture).status == 0
    verify(picture)
    assert {"/sensed", "/route", "/scale", "/summary", "/series/seen", "/series/noise"} <= entities(picture)
    assert timelines(picture) == {"time"}
    for camera in ("cam0", "cam1"):
        images = columns(picture, f"/camera/{camera}", timed=True)["EncodedImage:blob"]
        assert len(images) == FRAMES
        shape = cv2.imdecode(np.array(images[0][0], np.uint8), cv2.IMREAD_COLOR).shape
        assert shape == (360 + HEADING, 480, 3)
    located = columns(picture, "/sensed", timed=True)
    counts = [COUNT - (f == 2) for f in range(FRAMES)]  # one marker is hidden once
    assert [len(row) for row in located["Points3D:positions"]] == counts
    points = [frame.points for frame in open_recording(tmp_path / "run.jsonl").frames]
    np.testing.assert_allclose(located["Points3D:positions"][0], points[0], atol=1e-6)  # single precision
    (text,) = columns(picture, "/summary", timed=False)["TextDocument:text"][0]
    assert f"**{COUNT} markers** along the sheath in {FRAMES} frames" in text
    assert views(picture).count("2D") == 2


def test_covariances_stand_beside_the_points_in_both_formats(filmed, calibration, run, tmp_path):
    for name in ("run.jsonl", "run.npz"):
        command = ("track", *films(filmed), "--calibration", calibration, "--blobs", "bright", "--quiet")
        assert run(*command, "--out", tmp_path / name).out == ""
    with np.load(tmp_path / "run.npz") as archive:
        arrays = dict(archive)
    lines = [json.loads(line) for line in (tmp_path / "run.jsonl").read_text().splitlines()]
    assert arrays["covariance_mm2"].shape == (FRAMES, COUNT, 3, 3)
    triangle = np.array([lines[0]["covariance_mm2"]]).reshape(COUNT, 6)
    np.testing.assert_allclose(triangle[:, 0], arrays["covariance_mm2"][0, :, 0, 0], rtol=1e-4)  # five digits
    assert lines[2]["points"].count(None) == lines[2]["covariance_mm2"].count(None) == 1
    one, two = (list(open_recording(tmp_path / name).frames) for name in ("run.jsonl", "run.npz"))
    np.testing.assert_allclose(one[0].points, two[0].points, atol=1e-9)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--blobs", "bright"], "--calibration is missing"),
        (["--calibration", "CAMERAS"], "state what the markers are"),
        (["--calibration", "CAMERAS", "--blobs", "bright", "--tags", "4x4_50"], "state what the markers are"),
        (["--calibration", "gone.toml", "--blobs", "bright"], "cannot be read"),
        (["--calibration", "CAMERAS", "--blobs", "bright", "--proximal", "left"], "--proximal 'left'"),
        (["--calibration", "CAMERAS", "--blobs", "bright", "--count", "15"], "at most 14 markers"),
        (["--calibrate"], "--square-mm is missing"),
    ],
)
def test_what_is_missing_is_reported_in_one_line(filmed, calibration, run, tmp_path, options, expected):
    given = [calibration if option == "CAMERAS" else option for option in options]
    outcome = run("track", *films(filmed), *given, "--out", tmp_path / "run.jsonl")
    assert outcome.status == 2
    assert len(outcome.errors) == 1
    assert expected in outcome.errors[0]
    assert not (tmp_path / "run.jsonl").exists()


def test_one_film_for_two_cameras_is_refused_unless_it_bears_a_camera_s_name(
    filmed, calibration, run, tmp_path
):
    other = tmp_path / "film.avi"
    other.write_bytes((filmed / "cam0.avi").read_bytes())
    common = ("--calibration", calibration, "--blobs", "bright", "--out", tmp_path / "run.jsonl")
    assert "2 cameras" in run("track", other, *common).errors[0]
    assert "does not determine the depth" in run("track", filmed / "cam0.avi", *common).errors[0]


def test_an_unknown_key_in_a_calibration_is_refused(filmed, calibration, run, tmp_path):
    path = tmp_path / "cameras.toml"
    path.write_text(calibration.read_text().replace("[[camera]]", "zoom = 2\n\n[[camera]]", 1))
    outcome = run(
        "track", *films(filmed), "--calibration", path, "--blobs", "bright", "--out", tmp_path / "r.npz"
    )
    assert outcome.status == 2
    assert "zoom" in outcome.errors[0]


def test_libraries_write_nothing_of_their_own_about_damaged_images_and_films(tmp_path):
    images = tmp_path / "images"
    images.mkdir()
    noise = np.random.default_rng(0).integers(0, 255, (200, 200, 3), dtype=np.uint8)
    for name in ("cut.png", "cut.jpg"):
        _, packed = cv2.imencode(name[-4:], noise)
        (images / name).write_bytes(packed.tobytes()[:5000])
    (tmp_path / "film.mp4").write_bytes(b"\0\0\0\x18ftypmp42" + bytes(range(256)) * 2000)
    for source in ("images", "film.mp4"):
        command = [*PROGRAM, "track", source, "--calibrate", "--square-mm", "30", "--out", "cameras.toml"]
        done = subprocess.run(command, check=False, capture_output=True, cwd=tmp_path, timeout=120)
        assert done.returncode == 2
        assert [line.split(b":")[0] for line in done.stderr.splitlines()] == [b"tssgeom"]
