"""`tssgeom track`: videos of markers to a recording of shapes."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.console import Tracker, complain, say, show, tracking
from tssgeom.errors import SettingsError
from tssgeom.io.formats.cameras import read_cameras
from tssgeom.io.results.recorded import recording_writer
from tssgeom.route.observations import MIN_POINTS
from tssgeom.stream import Frame
from tssgeom.vision.across import noise_across
from tssgeom.vision.blobs import BlobAppearance, blob_finder
from tssgeom.vision.cameras import Camera, refuse_other_size
from tssgeom.vision.footage import Footage, open_footage
from tssgeom.vision.localisation import Alone
from tssgeom.vision.sightings import Sightings, nothing
from tssgeom.vision.tags import CORNERS, tag_finder
from tssgeom.vision.track import Track, Wanted, track

_MOST_TOLD = 5


@dataclass(frozen=True, slots=True)
class Asked:
    """What the images are and what to look for in them."""

    family: str | None
    """Family of the tags, or None for blobs."""
    blobs: BlobAppearance
    rate: float | None
    """Frames each second, for images that tell none [1/s]."""
    most: int | None
    """Stop after so many frames."""


def asked(
    family: str | None, look: str | None, areas: tuple[float, float], rate: float | None, most: int | None
) -> Asked:
    """Check what the markers look like.

    Raises
    ------
    SettingsError
        Where it is not said what they are.
    """
    if (family is None) == (look is None):
        raise SettingsError("say what the markers are: --tags FAMILY, or --blobs bright, dark or #RRGGBB")
    return Asked(family, BlobAppearance(look or "bright", *areas), rate, most)


def wanted(
    *,
    tags: bool,
    ids: str | None,
    count: int | None,
    proximal: str | None,
    plane_mm: float | None,
    tag_mm: float | None,
) -> Wanted:
    """Check how the markers are ordered, and what tells depth to one camera.

    Raises
    ------
    SettingsError
        Where a list of numbers is none, or a size is not positive.
    """
    if tag_mm is not None and not tag_mm > 0:
        raise SettingsError(f"--tag-mm is {tag_mm:g} mm: give a side > 0 mm")
    numbers = () if ids is None else tuple(int(number) for number in _numbers("--ids", ids, "4,7,2"))
    if len(set(numbers)) < len(numbers):
        raise SettingsError(f"--ids {ids}: a number is there twice: each tag is at one place of the route")
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
    made: Asked,
    markers: Wanted,
    *,
    out: Path,
    overlay: Path | None,
    picture: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Track markers and return the exit status.

    Raises
    ------
    SettingsError, ShapeError, SourceError
        Where an input cannot be used, the markers are not found in a clear order, or the disk refuses.
    """
    if calibration is None:
        raise SettingsError("--calibration is missing: make one with tssgeom track --calibrate")
    write = recording_writer(out)
    footage = open_footage(videos, made.rate)
    cameras = matched(read_cameras(calibration), footage)
    if (overlay or picture) is not None and footage.live:
        raise SettingsError(
            "--overlay and --picture need images that can be read twice: record the cameras first"
        )
    begin = time.perf_counter()
    seen = _detected(footage, cameras, made, quiet=quiet or as_json)
    middle = time.perf_counter()
    found = track(cameras, seen, markers)
    end = time.perf_counter()
    frames = _frames(found, footage.rate)
    write(out, frames, [one.covariance for one in found.frames])
    files = [out.as_posix()]
    if overlay is not None:
        from pipelines.track_overlay import write_overlays

        files += write_overlays(overlay, footage, cameras, seen, found, frames, quiet=quiet or as_json)
    if picture is not None:
        from pipelines.track_overlay import write_picture

        told = _words(_summary(cameras, footage, found, frames, files))
        quietly = quiet or as_json
        files.append(write_picture(picture, footage, cameras, seen, found, frames, told, quiet=quietly))
    summary = _summary(cameras, footage, found, frames, files) | {
        "frames_per_s": {
            "detection": len(seen) / max(middle - begin, 1e-9),
            "geometry": len(seen) / max(end - middle, 1e-9),
        }
    }
    _tell(summary, as_json=as_json, quiet=quiet)
    return 1 if summary["frames_too_few"] else 0


def matched(cameras: tuple[Camera, ...], footage: Footage) -> tuple[Camera, ...]:
    """Give each source its camera: by name where all names are known, else in order.

    Raises
    ------
    SettingsError
        Where there are more sources than cameras, or one source in place of several without its name.
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


def _detected(
    footage: Footage, cameras: tuple[Camera, ...], made: Asked, *, quiet: bool
) -> list[list[Sightings]]:
    """Find the markers in every image; Ctrl-C ends the filming of a camera, and what was seen counts."""
    find = blob_finder(made.blobs) if made.family is None else tag_finder(made.family)
    corners = 1 if made.family is None else CORNERS
    seen = list[list[Sightings]]()
    with tracking(1, quiet=quiet) as tracker, suppress(*([KeyboardInterrupt] if footage.live else [])):
        tracker.begin("looking for markers")
        for images in _limited(footage, made.most, tracker):
            row = list[Sightings]()
            for image, camera, source in zip(images, cameras, footage.sources, strict=True):
                if image is not None and not seen:
                    refuse_other_size(camera, image, source.name)
                row.append(nothing(corners) if image is None else find(image))
            seen.append(row)
        tracker.end("looking for markers")
    return seen


def _limited(footage: Footage, most: int | None, tracker: Tracker) -> Iterator[tuple[np.ndarray | None, ...]]:
    for number, images in enumerate(footage):
        if most is not None and number >= most:
            return
        yield images
        tracker.frame(min(footage.count or number + 2, most or 10**9))


def _frames(found: Track, rate: float | None) -> list[Frame]:
    """Return the points as a recording has them; without a rate the frames are counted, one a second."""
    return [
        Frame(one.points, k / (rate or 1.0), noise=noise_across(one.points, one.covariance))
        for k, one in enumerate(found.frames)
    ]


def _summary(
    cameras: tuple[Camera, ...], footage: Footage, found: Track, frames: Sequence[Frame], files: Sequence[str]
) -> dict[str, Any]:
    seen = np.array([np.isfinite(one.points[:, 0]) for one in found.frames])
    noise = [1e3 * frame.noise for frame in frames if frame.noise is not None]
    few = np.flatnonzero(seen.sum(axis=1) < MIN_POINTS)
    counted = (
        ()
        if footage.rate or len(frames) == 1
        else ("no frame rate: the frames are counted, one a second; give --fps",)
    )
    return {
        "frames": len(frames),
        "markers": len(found.ids),
        "ids": list(found.ids),
        "seen": float(seen.mean()),
        "frames_too_few": few.tolist(),
        "noise_mm": float(np.median(noise)) if noise else None,
        "pixel_noise_ratio": found.scale,
        "reprojection_px": {
            camera.name: None if np.isnan(off) else float(off)
            for camera, off in zip(cameras, found.reprojection, strict=True)
        },
        "warnings": [*footage.warnings, *counted, *found.warnings],
        "files": list(files),
    }


def _words(summary: dict[str, Any]) -> str:
    """Say what was found, as markdown."""
    off = [
        f"{name} {value:.2f} px" for name, value in summary["reprojection_px"].items() if value is not None
    ]
    noise = summary["noise_mm"]
    parts = [
        f"**{summary['markers']} markers** along the sheath in {summary['frames']} frames; "
        f"{100 * summary['seen']:.1f} % of them were placed.",
        "" if noise is None else f"Noise of a coordinate across the route: **{noise:.2g} mm** (median).",
        f"Distance from where each point should be seen (rms): {', '.join(off)}." if off else "",
        *(f"⚠ {warning}" for warning in summary["warnings"]),
    ]
    return "\n\n".join(part for part in parts if part)


def _tell(summary: dict[str, Any], *, as_json: bool, quiet: bool) -> None:
    few = summary["frames_too_few"]
    for frame in few[:_MOST_TOLD]:
        complain(f"frame {frame}: fewer than {MIN_POINTS} markers were placed: it cannot be used")
    if len(few) > _MOST_TOLD:
        complain(f"{len(few) - _MOST_TOLD} more frames with fewer than {MIN_POINTS} markers")
    if as_json:
        say(json.dumps(summary, indent=1, ensure_ascii=False, allow_nan=False))
    elif not quiet:
        _show(summary)


def _show(summary: dict[str, Any]) -> None:
    speed = summary["frames_per_s"]
    whole = 1.0 / (1.0 / speed["detection"] + 1.0 / speed["geometry"])
    off = [f"{name} {value:.3f}" for name, value in summary["reprojection_px"].items() if value is not None]
    noise = "" if summary["noise_mm"] is None else f"{summary['noise_mm']:.3f}"
    row = (
        summary["files"][0],
        str(summary["frames"]),
        str(summary["markers"]),
        f"{100 * summary['seen']:.1f}",
        noise,
        ", ".join(off),
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
    show("Markers along the sheath, proximal to distal", heads, [row], notes=summary["warnings"])
