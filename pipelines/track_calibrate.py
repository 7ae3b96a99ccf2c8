"""`tssgeom track --calibrate`: images of a board to a calibration file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from pipelines.console import say, show, tracking
from tssgeom.errors import SettingsError, ShapeError
from tssgeom.io.formats.cameras import write_calibration
from tssgeom.vision.boards import Board, BoardDetection, board_finder
from tssgeom.vision.calibration import calibrated
from tssgeom.vision.footage import Footage, open_footage
from tssgeom.vision.quality import Calibration

_MOST = 400
"""Of more frames than these, so many are searched for the board, evenly."""


def board_of(corners: str, square_mm: float | None, family: str | None, tag_mm: float | None) -> Board:
    """Return the board that the user describes.

    Raises
    ------
    SettingsError
        Where its corners or the size of its squares are missing or no numbers.
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

    Raises
    ------
    SettingsError, ShapeError, SourceError, FitError
        Where the images cannot be used, the boards do not tell the cameras, or the disk refuses.
    """
    if out.suffix.lower() not in {".toml", ".json"}:
        raise SettingsError(f"{out}: a calibration is written as .toml or .json: name --out so")
    footage = open_footage(videos)
    if footage.live:
        raise SettingsError("--calibrate needs images that were recorded: film the board first")
    names = _names(footage)
    seen, sizes = _searched(footage, board, quiet=quiet or as_json)
    found = calibrated(board, names, sizes, seen, board_frame)
    write_calibration(out, found)
    files = [out.as_posix()]
    if overlay is not None:
        from pipelines.track_overlay import write_board_overlays

        files += write_board_overlays(overlay, footage, names, seen)
    if as_json:
        say(json.dumps(_summary(found, files), indent=1, ensure_ascii=False, allow_nan=False))
    elif not quiet:
        _show(found, out)
    return 0


def _names(footage: Footage) -> list[str]:
    names = [source.name for source in footage.sources]
    if len(set(names)) == len(names):
        return names
    return [f"camera{k + 1}" for k in range(len(names))]


def _searched(
    footage: Footage, board: Board, *, quiet: bool
) -> tuple[list[list[BoardDetection | None]], list[tuple[int, int]]]:
    """Look for the board in every image, of long videos in some of them, evenly."""
    find = board_finder(board, len(footage.sources))
    every = max((footage.count or 0) // _MOST, 1)
    seen, sizes = list[list[BoardDetection | None]](), dict[int, tuple[int, int]]()
    with tracking(1, quiet=quiet) as tracker:
        tracker.begin("looking for the board")
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
            seen.append(row)
            tracker.frame(footage.count or k + 2)
        tracker.end("looking for the board")
    unread = [source.name for v, source in enumerate(footage.sources) if v not in sizes]
    if unread:
        raise ShapeError(f"{unread[0]}: no image could be read: check the files")
    return seen, [sizes[v] for v in range(len(footage.sources))]


def _summary(found: Calibration, files: Sequence[str]) -> dict[str, object]:
    cameras = [
        {
            "name": camera.name,
            "views": found.views[v],
            "reprojection_px": float(found.reprojection[v]),
            "covered": float(found.covered[v]),
            "focal_px": [float(camera.matrix[0, 0]), float(camera.matrix[1, 1])],
            "focal_sd_px": found.sd[v, :2].tolist(),
            "distortion": camera.distortion.tolist(),
            "place_m": camera.position.tolist(),
        }
        for v, camera in enumerate(found.cameras)
    ]
    return {
        "cameras": cameras,
        "corner_noise_px": found.noise,
        "point_sd_mm": 1e3 * found.point_sd,
        "warnings": list(found.warnings),
        "files": list(files),
    }


def _show(found: Calibration, out: Path) -> None:
    from tssgeom.view.wording import with_error

    rows = []
    for v, camera in enumerate(found.cameras):
        focal, sd = camera.matrix[0, 0], found.sd[v, 0]
        place = ", ".join(f"{1e3 * x:.1f}" for x in camera.position)
        rows.append(
            (
                camera.name,
                str(found.views[v]),
                f"{100 * found.covered[v]:.0f}",
                f"{found.reprojection[v]:.3f}",
                with_error(focal, sd, 1),
                place,
            )
        )
    heads = ("camera", "boards", "covered\n[%]", "reprojection\n[px]", "focal length\n[px]", "place\n[mm]")
    title = f"{out}: a corner is read to {found.noise:.3f} px"
    if found.point_sd:
        title += (
            f"; the calibration itself puts a point {1e3 * found.point_sd:.3f} mm off (s.d. of a coordinate)"
        )
    show(title, heads, rows, notes=found.warnings)
