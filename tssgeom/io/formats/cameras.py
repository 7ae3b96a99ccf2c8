"""Calibration files: cameras in one frame, with the standard deviation of each number; TOML or JSON."""

from __future__ import annotations

import math
from pathlib import Path

import msgspec
import numpy as np
import tomli_w

from tssgeom.atomic import write_text
from tssgeom.errors import SettingsError
from tssgeom.io.formats.paths import SETTINGS_BYTES, bytes_of
from tssgeom.toml_keys import with_short_keys
from tssgeom.vision.cameras import DISTORTIONS, Camera
from tssgeom.vision.quality import Calibration

Pair = tuple[float, float]
Triple = tuple[float, float, float]
Five = tuple[float, float, float, float, float]


class Uncertain(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Standard deviations of the numbers of one camera."""

    focal_px: Pair
    """Of the focal length along x and y [px]."""
    centre_px: Pair
    """Of the principal point [px]."""
    distortion: Five
    """Of the coefficients of distortion [1]."""
    turn_rad: Triple
    """Of the rotation vector [rad]."""
    shift_m: Triple
    """Of the shift [m]."""


class CameraFile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One camera as it is written."""

    name: str
    """Name of the camera."""
    size_px: tuple[int, int]
    """Width and height of an image [px]."""
    focal_px: Pair
    """Focal length along x and y [px]."""
    centre_px: Pair
    """Principal point [px]."""
    distortion: Five = (0.0, 0.0, 0.0, 0.0, 0.0)
    """Coefficients k1, k2, p1, p2, k3 [1]."""
    turn_rad: Triple = (0.0, 0.0, 0.0)
    """Rotation vector from the common frame into the camera's [rad]."""
    shift_m: Triple = (0.0, 0.0, 0.0)
    """Position of the common origin in the camera's frame [m]."""
    reprojection_px: float | None = None
    """Reprojection error (rms) [px]."""
    views: int | None = None
    """Boards that were detected [1]."""
    covered: float | None = None
    """Share of the image that the boards cover [1]."""
    sd: Uncertain | None = None
    """Standard deviations of the numbers above."""

    def __post_init__(self) -> None:
        numbers = (*self.focal_px, *self.centre_px, *self.distortion, *self.turn_rad, *self.shift_m)
        if not all(map(math.isfinite, numbers)):
            raise SettingsError(f"camera {self.name!r} has a number that is not finite: calibrate again")
        if min(self.size_px) < 1 or min(self.focal_px) <= 0:
            raise SettingsError(f"camera {self.name!r} has a size or focal length <= 0 px: calibrate again")


class CalibrationFile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All cameras as they are written."""

    camera: list[CameraFile]
    """The cameras."""
    corner_noise_px: float | None = None
    """Standard deviation of a corner [px]."""
    point_sd_mm: float | None = None
    """Standard deviation of a coordinate that the calibration itself causes [mm]."""


def read_cameras(path: Path) -> tuple[Camera, ...]:
    """Read the cameras of a calibration file.

    Raises SettingsError where the file holds an unknown key, a value out of bounds, or no camera; SourceError
    where it cannot be read.
    """
    content = bytes_of(path, SETTINGS_BYTES, "check --calibration")
    try:
        if path.suffix.lower() == ".json":
            held = msgspec.json.decode(content, type=CalibrationFile)
        else:
            held = msgspec.toml.decode(with_short_keys(content), type=CalibrationFile)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise SettingsError(f"{path}: {error}: write it with tssgeom track --calibrate") from error
    if not held.camera:
        raise SettingsError(f"{path}: no camera in it: write it with tssgeom track --calibrate")
    names = [one.name for one in held.camera]
    if len(set(names)) < len(names):
        raise SettingsError(f"{path}: two cameras have one name: give each its own")
    return tuple(_camera(one) for one in held.camera)


def _camera(one: CameraFile) -> Camera:
    (fx, fy), (cx, cy) = one.focal_px, one.centre_px
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    numbers = (np.array(values) for values in (one.distortion, one.turn_rad, one.shift_m))
    return Camera(one.name, *one.size_px, matrix, *numbers)


def write_calibration(path: Path, calibration: Calibration) -> None:
    """Write a calibration, which `read_cameras` reads back; TOML, or JSON where the ending is that.

    Raises SourceError where the disk refuses.
    """
    held = CalibrationFile(
        camera=[_written(calibration, v) for v in range(len(calibration.cameras))],
        corner_noise_px=calibration.noise,
        point_sd_mm=1e3 * calibration.point_sd,
    )
    if path.suffix.lower() == ".json":
        write_text(path, msgspec.json.format(msgspec.json.encode(held), indent=1).decode() + "\n")
        return
    comment = (
        f"# Lengths in m, angles in rad; distortion is {', '.join(DISTORTIONS)}; sd: standard deviations.\n\n"
    )
    tables = msgspec.to_builtins(held)
    cameras = tables.pop("camera")
    write_text(path, comment + tomli_w.dumps({**tables, "camera": cameras}))


def _written(calibration: Calibration, v: int) -> CameraFile:
    camera, sd = calibration.cameras[v], calibration.sd[v].tolist()
    matrix = camera.matrix
    return CameraFile(
        name=camera.name,
        size_px=(camera.width, camera.height),
        focal_px=(float(matrix[0, 0]), float(matrix[1, 1])),
        centre_px=(float(matrix[0, 2]), float(matrix[1, 2])),
        distortion=tuple(camera.distortion.tolist()),
        turn_rad=tuple(camera.turn.tolist()),
        shift_m=tuple(camera.shift.tolist()),
        reprojection_px=float(calibration.reprojection[v]),
        views=calibration.views[v],
        covered=float(calibration.covered[v]),
        sd=Uncertain(
            focal_px=tuple(sd[:2]),
            centre_px=tuple(sd[2:4]),
            distortion=tuple(sd[4:9]),
            turn_rad=tuple(sd[9:12]),
            shift_m=tuple(sd[12:]),
        ),
    )
