"""`tssgeom track`: its options here; `markers` makes a recording, `boards` a calibration, `overlay` pictures.

What it needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipelines.options import Json, Quiet
from pipelines.terminal import without_lines_of_libraries


@without_lines_of_libraries()
def track(
    videos: Annotated[
        list[str],
        typer.Argument(
            help="A video, a folder of images or the number of a camera for each camera, in step."
        ),
    ],
    out: Annotated[
        Path, typer.Option("--out", help="Recording (.jsonl, .npz), or with --calibrate .toml or .json.")
    ],
    calibration: Annotated[
        Path | None, typer.Option("--calibration", help="Calibration file of the cameras.")
    ] = None,
    tags: Annotated[
        str | None, typer.Option("--tags", help="Family of the tags, such as 4x4_50 or apriltag_36h11.")
    ] = None,
    blobs: Annotated[
        str | None, typer.Option("--blobs", help="Plain markers: bright, dark, or a colour #RRGGBB.")
    ] = None,
    ids: Annotated[
        str | None, typer.Option("--ids", help="Tags from proximal to distal, 4,7,2; rising by default.")
    ] = None,
    count: Annotated[int | None, typer.Option("--count", min=4, help="Number of blobs.")] = None,
    proximal: Annotated[
        str | None, typer.Option("--proximal", help="X,Y: pixel of the first camera near the proximal end.")
    ] = None,
    area_px: Annotated[
        tuple[float, float], typer.Option("--area-px", help="Smallest and largest area of a blob in px².")
    ] = (6.0, 5000.0),
    fps: Annotated[
        float | None, typer.Option("--fps", help="Frames each second, where the source has no rate.")
    ] = None,
    frames: Annotated[int | None, typer.Option("--frames", min=1, help="Stop after so many frames.")] = None,
    plane_mm: Annotated[
        float | None,
        typer.Option("--plane-mm", help="For one camera: height z of the plane of the route, in mm."),
    ] = None,
    tag_mm: Annotated[
        float | None,
        typer.Option("--tag-mm", help="Side of the tags: for one camera, or a ChArUco board, in mm."),
    ] = None,
    overlay: Annotated[
        Path | None, typer.Option("--overlay", help="Folder for images with the detected markers.")
    ] = None,
    picture: Annotated[
        Path | None, typer.Option("--picture", help="Rerun recording (.rrd) of images and markers.")
    ] = None,
    calibrate: Annotated[
        bool, typer.Option("--calibrate", help="Calibrate the cameras from images of a board instead.")
    ] = False,
    board: Annotated[
        str, typer.Option("--board", help="Inner corners of the board, columns x rows.")
    ] = "9x6",
    square_mm: Annotated[
        float | None, typer.Option("--square-mm", help="Side of a square of the board, in mm.")
    ] = None,
    board_frame: Annotated[
        int | None, typer.Option("--board-frame", min=0, help="Frame whose board is the plane z = 0.")
    ] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Turn videos of markers into a recording, or with --calibrate images of a board into cameras.

    With --calibrate, --tags names the family of a ChArUco board; without it the board is a checkerboard.
    """
    if calibrate:
        from pipelines.track import boards

        described = boards.board_of(board, square_mm, tags, tag_mm)
        status = boards.run(
            videos, described, out=out, board_frame=board_frame, overlay=overlay, as_json=as_json, quiet=quiet
        )
        raise typer.Exit(status)
    from pipelines.track import markers

    images = markers.image_options(tags, blobs, area_px, fps, frames)
    order = markers.marker_options(
        tags=tags is not None, ids=ids, count=count, proximal=proximal, plane_mm=plane_mm, tag_mm=tag_mm
    )
    status = markers.run(
        videos,
        calibration,
        images,
        order,
        out=out,
        overlay=overlay,
        picture=picture,
        as_json=as_json,
        quiet=quiet,
    )
    raise typer.Exit(status)
