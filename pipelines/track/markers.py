"""Videos of markers to a recording of shapes."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.inputs import MOST_REPORTED
from pipelines.interruption import ending_this_step
from pipelines.terminal import CountedProgress, counted_progress, print_json, print_message, print_table
from tssgeom.errors import SettingsError
from tssgeom.io.formats.cameras import read_cameras
from tssgeom.io.results.recorded import recording_writer
from tssgeom.route.observations import MIN_POINTS
from tssgeom.stream import Frame
from tssgeom.vision.blobs import BlobAppearance, blob_finder
from tssgeom.vision.cameras import Camera, refuse_other_size
from tssgeom.vision.footage import Footage, open_footage
from tssgeom.vision.localisation import Alone
from tssgeom.vision.tags import CORNERS, tag_finder
from tssgeom.vision.track import Track, Wanted, track
from tssgeom.vision.triangulation import noise_across
from tssgeom.vision.views import Sightings, nothing


@dataclass(frozen=True, slots=True)
class ImageOptions:
    """The images, and the markers to detect in them."""

    family: str | None
    """Family of the tags, or None for blobs."""
    blobs: BlobAppearance
    rate: float | None
    """Frames each second, for images without a rate [1/s]."""
    most: int | None
    """Stop after so many frames."""


def image_options(
    family: str | None,
    appearance: str | None,
    areas: tuple[float, float],
    rate: float | None,
    most: int | None,
) -> ImageOptions:
    """Check the appearance of the markers.

    Raises SettingsError where neither tags nor blobs are given, or both.
    """
    if (family is None) == (appearance is None):
        raise SettingsError("state what the markers are: --tags FAMILY, or --blobs bright, dark or #RRGGBB")
    return ImageOptions(family, BlobAppearance(appearance or "bright", *areas), rate, most)


def marker_options(
    *,
    tags: bool,
    ids: str | None,
    count: int | None,
    proximal: str | None,
    plane_mm: float | None,
    tag_mm: float | None,
) -> Wanted:
    """Check how the markers are ordered, and what gives the depth for one camera.

    Raises SettingsError where a list of numbers is none, or a size is not positive.
    """
    if tag_mm is not None and not tag_mm > 0:
        raise SettingsError(f"--tag-mm is {tag_mm:g} mm: give a side > 0 mm")
    numbers = () if ids is None else tuple(int(number) for number in _numbers("--ids", ids, "4,7,2"))
    if len(set(numbers)) < len(numbers):
        raise SettingsError(f"--ids {ids}: a number is there twice: each tag is at one point of the route")
    pixel = None if proximal is None else _numbers("--proximal", proximal, "412,96")
    if pixel is not None and len(pixel) != 2:
        raise SettingsError(f"--proximal {proximal}: write one pixel, such as 412,96")
    side = None if tag_mm is None else 1e-3 * tag_mm
    alone = Alone(None if plane_mm is None else 1e-3 * plane_mm, side)
    return Wanted(tags, numbers, count, None if pixel is None else (pixel[0], pixel[1]), alone)


def _numbers(option: str, text: str, example: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError as error:
        raise SettingsError(
            f"{option} {text!r}: write numbers with commas between, such as {example}"
        ) from error


def run(
    videos: Sequence[str],
    calibration: Path | None,
    options: ImageOptions,
    markers: Wanted,
    *,
    out: Path,
    overlay: Path | None,
    picture: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Track markers and return the exit status.

    Raises SettingsError, ShapeError or SourceError where an input cannot be used, the order of the markers is
    ambiguous, or the disk refuses.
    """
    if calibration is None:
        raise SettingsError("--calibration is missing: make one with tssgeom track --calibrate")
    write = recording_writer(out)
    footage = open_footage(videos, options.rate)
    cameras = matched(read_cameras(calibration), footage)
    if (overlay or picture) is not None and footage.live:
        raise SettingsError(
            "--overlay and --picture need images that can be read twice: record the cameras first"
        )
    begin = time.perf_counter()
    detections = _detections(footage, cameras, options, quiet=quiet or as_json)
    middle = time.perf_counter()
    tracked = track(cameras, detections, markers)
    end = time.perf_counter()
    frames = _frames(tracked, footage.rate)
    write(out, frames, [one.covariance for one in tracked.frames])
    files = [out.as_posix()]
    if (overlay or picture) is not None:
        from pipelines.track.overlay import DetectedFootage, write_overlays, write_picture

        detected = DetectedFootage(footage, cameras, detections, tracked, frames, quiet or as_json)
        if overlay is not None:
            files += write_overlays(overlay, detected)
        if picture is not None:
            text = _markdown(_summary(cameras, footage, tracked, frames, files))
            files.append(write_picture(picture, detected, text))
    summary = _summary(cameras, footage, tracked, frames, files) | {
        "frames_per_s": {
            "detection": len(detections) / max(middle - begin, 1e-9),
            "geometry": len(detections) / max(end - middle, 1e-9),
        }
    }
    _print(summary, as_json=as_json, quiet=quiet)
    return 1 if summary["frames_too_few"] else 0


def matched(cameras: tuple[Camera, ...], footage: Footage) -> tuple[Camera, ...]:
    """Give each source its camera: by name where all names are known, else in order.

    Raises SettingsError where there are more sources than cameras, or one source instead of several without
    its name.
    """
    named = {camera.name: camera for camera in cameras}
    names = [source.name for source in footage.sources]
    if len(set(names)) == len(names) and all(name in named for name in names):
        return tuple(named[name] for name in names)
    if len(names) != len(cameras):
        raise SettingsError(
            f"{len(names)} sources ({', '.join(names)}) for {len(cameras)} cameras ({', '.join(named)}): "
            "give one for each camera in their order, or name them like the cameras"
        )
    return cameras


def _detections(
    footage: Footage, cameras: tuple[Camera, ...], options: ImageOptions, *, quiet: bool
) -> list[list[Sightings]]:
    """Detect the markers in every image; Ctrl-C ends the filming of a camera, and the frames so far count."""
    find = blob_finder(options.blobs) if options.family is None else tag_finder(options.family)
    corners = 1 if options.family is None else CORNERS
    detections = list[list[Sightings]]()
    with counted_progress(1, quiet=quiet) as progress, ending_this_step() if footage.live else nullcontext():
        progress.begin("detecting markers")
        for images in _limited(footage, options.most, progress):
            row = list[Sightings]()
            for image, camera, source in zip(images, cameras, footage.sources, strict=True):
                if image is not None and not detections:
                    refuse_other_size(camera, image, source.name)
                row.append(nothing(corners) if image is None else find(image))
            detections.append(row)
        progress.end("detecting markers")
    return detections


def _limited(
    footage: Footage, most: int | None, progress: CountedProgress
) -> Iterator[tuple[np.ndarray | None, ...]]:
    for number, images in enumerate(footage):
        if most is not None and number >= most:
            return
        yield images
        progress.frame(min(footage.count or number + 2, most or 10**9))


def _frames(tracked: Track, rate: float | None) -> list[Frame]:
    """Return the points as a recording has them; without a rate the frames are counted, one a second."""
    return [
        Frame(one.points, k / (rate or 1.0), noise=noise_across(one.points, one.covariance))
        for k, one in enumerate(tracked.frames)
    ]


def _summary(
    cameras: tuple[Camera, ...],
    footage: Footage,
    tracked: Track,
    frames: Sequence[Frame],
    files: Sequence[str],
) -> dict[str, Any]:
    located = np.array([np.isfinite(one.points[:, 0]) for one in tracked.frames])
    noise = [1e3 * frame.noise for frame in frames if frame.noise is not None]
    few = np.flatnonzero(located.sum(axis=1) < MIN_POINTS)
    counted = (
        ()
        if footage.rate or len(frames) == 1
        else ("no frame rate: the frames are counted, one a second; give --fps",)
    )
    return {
        "frames": len(frames),
        "markers": len(tracked.ids),
        "ids": list(tracked.ids),
        "seen": float(located.mean()),
        "frames_too_few": few.tolist(),
        "noise_mm": float(np.median(noise)) if noise else None,
        "pixel_noise_ratio": tracked.scale,
        "reprojection_px": {
            camera.name: None if np.isnan(error) else float(error)
            for camera, error in zip(cameras, tracked.reprojection, strict=True)
        },
        "warnings": [*footage.warnings, *counted, *tracked.warnings],
        "files": list(files),
    }


def _markdown(summary: dict[str, Any]) -> str:
    """Return the summary as markdown."""
    errors = [
        f"{name} {value:.2f} px" for name, value in summary["reprojection_px"].items() if value is not None
    ]
    noise = summary["noise_mm"]
    parts = [
        f"**{summary['markers']} markers** along the sheath in {summary['frames']} frames; "
        f"{100 * summary['seen']:.1f} % of them were located.",
        "" if noise is None else f"Noise of a coordinate across the route: **{noise:.2g} mm** (median).",
        f"Reprojection error of the points (rms): {', '.join(errors)}." if errors else "",
        *(f"⚠ {warning}" for warning in summary["warnings"]),
    ]
    return "\n\n".join(part for part in parts if part)


def _print(summary: dict[str, Any], *, as_json: bool, quiet: bool) -> None:
    few = summary["frames_too_few"]
    for frame in few[:MOST_REPORTED]:
        print_message(f"frame {frame}: fewer than {MIN_POINTS} markers were located: it cannot be used")
    if len(few) > MOST_REPORTED:
        print_message(f"{len(few) - MOST_REPORTED} more frames with fewer than {MIN_POINTS} markers")
    if as_json:
        print_json(summary)
    elif not quiet:
        _print_table(summary)


def _print_table(summary: dict[str, Any]) -> None:
    speed = summary["frames_per_s"]
    whole = 1.0 / (1.0 / speed["detection"] + 1.0 / speed["geometry"])
    errors = [
        f"{name} {value:.3f}" for name, value in summary["reprojection_px"].items() if value is not None
    ]
    noise = "" if summary["noise_mm"] is None else f"{summary['noise_mm']:.3f}"
    row = (
        summary["files"][0],
        str(summary["frames"]),
        str(summary["markers"]),
        f"{100 * summary['seen']:.1f}",
        noise,
        ", ".join(errors),
        f"{whole:.1f}",
    )
    heads = (
        "recording",
        "frames",
        "markers",
        "seen\n[%]",
        "noise\n[mm]",
        "reprojection\n[px]",
        "speed\n[frames/s]",
    )
    print_table("Markers along the sheath, proximal to distal", heads, [row], notes=summary["warnings"])
