"""Images of a board to a calibration file of cameras."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pipelines.terminal import counted_progress, print_json, print_table
from tssgeom.errors import SettingsError, ShapeError
from tssgeom.io.formats.cameras import write_calibration
from tssgeom.io.results.keys.commands import CameraOf, CamerasCalibrated
from tssgeom.vision.boards import Board, BoardDetection, board_finder
from tssgeom.vision.calibration import calibrated
from tssgeom.vision.footage import Footage, open_footage
from tssgeom.vision.quality import Calibration

_MOST_SEARCHED = 400
"""Frames that are searched for the board, evenly spread [1]; chosen: more poses add little."""


def board_of(corners: str, square_mm: float | None, family: str | None, tag_mm: float | None) -> Board:
    """Return the board that the user describes.

    Raises SettingsError where its corners or the size of its squares are missing or no numbers.
    """
    columns, _, rows = corners.lower().partition("x")
    if not (columns.isdecimal() and rows.isdecimal()):
        raise SettingsError(f"--board {corners!r}: write the inner corners along and across, such as 9x6")
    if square_mm is None:
        raise SettingsError(
            "--square-mm is missing: measure the side of a square, it sets the scale of everything"
        )
    if family is not None and tag_mm is None:
        raise SettingsError("--tag-mm is missing: measure the side of the tags on the ChArUco board")
    return Board(int(columns), int(rows), 1e-3 * square_mm, family, 1e-3 * (tag_mm or 0.0))


def run(
    videos: Sequence[str],
    board: Board,
    *,
    out: Path,
    board_frame: int | None,
    overlay: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Calibrate cameras, write the file and return the exit status.

    Raises SettingsError, ShapeError, SourceError or FitError where the images cannot be used, the boards do
    not determine the cameras, or the disk refuses.
    """
    if out.suffix.lower() not in {".toml", ".json"}:
        raise SettingsError(f"{out}: a calibration is written as .toml or .json: name --out so")
    footage = open_footage(videos)
    if footage.live:
        raise SettingsError("--calibrate needs images that were recorded: film the board first")
    names = _names(footage)
    detections, sizes = _detections(footage, board, quiet=quiet or as_json)
    calibration = calibrated(board, names, sizes, detections, board_frame)
    write_calibration(out, calibration)
    files = [out.as_posix()]
    if overlay is not None:
        from pipelines.track.overlay import write_board_overlays

        files += write_board_overlays(overlay, footage, names, detections)
    if as_json:
        print_json(_summary(calibration, files))
    elif not quiet:
        _print_table(calibration, out)
    return 0


def _names(footage: Footage) -> list[str]:
    names = [source.name for source in footage.sources]
    if len(set(names)) == len(names):
        return names
    return [f"camera{k + 1}" for k in range(len(names))]


def _detections(
    footage: Footage, board: Board, *, quiet: bool
) -> tuple[list[list[BoardDetection | None]], list[tuple[int, int]]]:
    """Detect the board in every image; of long videos in some, evenly spread. Return the image sizes too."""
    find = board_finder(board, len(footage.sources))
    every = max((footage.count or 0) // _MOST_SEARCHED, 1)
    detections, sizes = list[list[BoardDetection | None]](), dict[int, tuple[int, int]]()
    with counted_progress(1, quiet=quiet) as progress:
        progress.begin("detecting the board")
        for k, images in enumerate(footage):
            row = list[BoardDetection | None]([None] * len(images))
            for v, image in enumerate(images):
                if image is None:
                    continue
                size = image.shape[1], image.shape[0]
                if sizes.setdefault(v, size) != size:
                    raise ShapeError(
                        f"{footage.sources[v].name}: image {k} is {size[0]} x {size[1]} px, those before "
                        f"{sizes[v][0]} x {sizes[v][1]}: give images of one size"
                    )
                if k % every == 0:
                    row[v] = find(image)
            detections.append(row)
            progress.frame(footage.count or k + 2)
        progress.end("detecting the board")
    unread = [source.name for v, source in enumerate(footage.sources) if v not in sizes]
    if unread:
        raise ShapeError(f"{unread[0]}: no image could be read: check the files")
    return detections, [sizes[v] for v in range(len(footage.sources))]


def _summary(calibration: Calibration, files: Sequence[str]) -> CamerasCalibrated:
    cameras: list[CameraOf] = [
        {
            "name": camera.name,
            "views": calibration.views[v],
            "reprojection_px": float(calibration.reprojection[v]),
            "covered": float(calibration.covered[v]),
            "focal_px": [float(camera.matrix[0, 0]), float(camera.matrix[1, 1])],
            "focal_sd_px": calibration.sd[v, :2].tolist(),
            "distortion": camera.distortion.tolist(),
            "place_m": camera.position.tolist(),
        }
        for v, camera in enumerate(calibration.cameras)
    ]
    return {
        "cameras": cameras,
        "corner_noise_px": calibration.noise,
        "point_sd_mm": 1e3 * calibration.point_sd,
        "warnings": list(calibration.warnings),
        "files": list(files),
    }


def _print_table(calibration: Calibration, out: Path) -> None:
    from tssgeom.view.wording import with_error

    rows = []
    for v, camera in enumerate(calibration.cameras):
        focal, sd = camera.matrix[0, 0], calibration.sd[v, 0]
        position = ", ".join(f"{1e3 * x:.1f}" for x in camera.position)
        rows.append(
            (
                camera.name,
                str(calibration.views[v]),
                f"{100 * calibration.covered[v]:.0f}",
                f"{calibration.reprojection[v]:.3f}",
                with_error(focal, sd, 1),
                position,
            )
        )
    heads = ("camera", "boards", "covered\n[%]", "reprojection\n[px]", "focal length\n[px]", "position\n[mm]")
    title = f"{out}: a corner is read to {calibration.noise:.3f} px"
    if calibration.point_sd:
        error = f"{1e3 * calibration.point_sd:.3f} mm"
        title += f"; the calibration itself puts a point {error} off (s.d. of a coordinate)"
    print_table(title, heads, rows, notes=calibration.warnings)
