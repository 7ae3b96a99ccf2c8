"""Cameras are calibrated from boards, to within the reported errors."""

from dataclasses import replace

import numpy as np
import pytest

from tests.scenes import board_images, board_poses, checkerboard, ring
from tssgeom.errors import SettingsError, ShapeError
from tssgeom.vision.boards import Board, BoardDetection, board_finder
from tssgeom.vision.bundle import CAMERA
from tssgeom.vision.calibration import calibrated

LENSES = ring(2)
PLOTTED = checkerboard()
BOARD = Board(PLOTTED.columns, PLOTTED.rows, PLOTTED.square)
SIZES = [(lens.width, lens.height) for lens in LENSES]


def inside(lens, pixels):
    return bool(((pixels > 4) & (pixels < np.array([lens.width, lens.height]) - 5)).all())


def detections_of(lenses, poses, noise, seed=0):
    """Corners as a detector gives them, with noise of its own, of boards that are wholly visible."""
    random, rows = np.random.default_rng(seed), []
    for axes, origin in poses:
        row = []
        for lens in lenses:
            pixels = lens.project(BOARD.corners @ axes.T + origin)
            noisy = pixels + noise * random.standard_normal(pixels.shape)
            row.append(BoardDetection(np.arange(len(pixels)), noisy) if inside(lens, pixels) else None)
        rows.append(row)
    return rows


def smaller(lens):
    """The same camera with fewer pixels, which are rendered faster."""
    focal, centre = (tuple(0.625 * x for x in pair) for pair in (lens.focal, lens.centre))
    return replace(lens, focal=focal, centre=centre, width=400, height=300)


def parameters(lens, first):
    """What a calibration in the frame of the first camera should estimate: lens and pose."""
    position = first.rotation @ (lens.position - first.position)
    return np.array([*lens.focal, *lens.centre, *lens.distortion]), position


def test_lenses_and_positions_are_estimated_to_within_their_errors():
    poses = board_poses(PLOTTED, 24)
    result = calibrated(BOARD, ["a", "b"], SIZES, detections_of(LENSES, poses, 0.1))
    assert result.noise == pytest.approx(0.1, rel=0.05)  # 4000 coordinates determine it to 1 %
    for v, lens in enumerate(LENSES):
        camera = result.cameras[v]
        truth, position = parameters(lens, LENSES[0])
        stated = np.array([*np.diag(camera.matrix)[:2], *camera.matrix[:2, 2], *camera.distortion])
        sd = result.sd[v, :9]
        free = sd > 0
        assert np.abs((stated - truth)[free] / sd[free]).max() < 4.0  # of sixteen numbers, chance 1 in 1000
        assert np.linalg.norm(camera.position - position) < 2e-3  # of a distance of half a metre


def test_the_covariance_is_that_of_repeated_calibrations():
    poses = board_poses(PLOTTED, 9)
    many = [
        calibrated(BOARD, ["a", "b"], SIZES, detections_of(LENSES, poses, 0.2, seed)) for seed in range(12)
    ]
    focal = np.array([[one.cameras[1].matrix[0, 0], one.cameras[1].shift[0] * 1e3] for one in many])
    stated = np.array([one.sd[1, [0, CAMERA - 3]] * [1.0, 1e3] for one in many]).mean(axis=0)
    # 12 values determine their spread to 21 %
    assert np.abs(np.log(focal.std(axis=0, ddof=1) / stated)).max() < 0.6


def test_rendered_boards_calibrate_both_cameras():
    lenses = [smaller(lens) for lens in LENSES]
    poses = [
        pose
        for pose in board_poses(PLOTTED, 16)
        if all(inside(lens, lens.project(BOARD.corners @ pose[0].T + pose[1])) for lens in lenses)
    ]
    poses, find = poses[:6], board_finder(BOARD, 2)
    views = [board_images(lens, PLOTTED, poses, v) for v, lens in enumerate(lenses)]
    detections = [[find(view[k]) for view in views] for k in range(len(poses))]
    result = calibrated(BOARD, ["a", "b"], [(400, 300)] * 2, detections)
    assert max(result.reprojection) < 0.25
    baseline = np.linalg.norm(result.cameras[1].position)
    assert baseline == pytest.approx(np.linalg.norm(LENSES[1].position - LENSES[0].position), rel=3e-3)


def test_a_board_frame_is_the_plane_of_the_common_frame():
    poses = board_poses(PLOTTED, 12)
    detections = detections_of(LENSES, poses, 0.0)
    frame = next(k for k, row in enumerate(detections) if all(row))
    result = calibrated(BOARD, ["a", "b"], SIZES, detections, board_frame=frame)
    axes, origin = poses[frame]
    for camera, lens in zip(result.cameras, LENSES, strict=True):
        np.testing.assert_allclose(camera.position, axes.T @ (lens.position - origin), atol=1e-6)


def test_a_view_in_which_the_board_was_misread_is_left_out():
    poses = board_poses(PLOTTED, 16)
    detections = detections_of(LENSES, poses, 0.1)
    frame = next(k for k, row in enumerate(detections) if all(row))
    good = detections[frame][0]
    detections[frame][0] = BoardDetection(good.corners, good.pixels[::-1].copy())
    detections[frame][0].pixels[:5] += 9.0
    result = calibrated(BOARD, ["a", "b"], SIZES, detections)
    assert result.noise < 0.12


def test_a_checkerboard_that_is_the_same_upside_down_is_refused_for_two_cameras():
    with pytest.raises(SettingsError, match="upside down"):
        board_finder(Board(8, 6, 0.02), 2)


def test_a_camera_that_sees_no_board_with_the_others_is_refused():
    detections = [
        [one, None] if k % 2 else [None, two]
        for k, (one, two) in enumerate(detections_of(LENSES, board_poses(PLOTTED, 24), 0.1))
    ]
    with pytest.raises(ShapeError, match="no board together"):
        calibrated(BOARD, ["a", "b"], SIZES, detections)


def test_too_few_boards_are_refused():
    with pytest.raises(ShapeError, match="at least 4 poses"):
        calibrated(BOARD, ["a", "b"], SIZES, detections_of(LENSES, board_poses(PLOTTED, 2), 0.1))
