"""Objects of `track --json`."""

from __future__ import annotations

from typing import TypedDict


class Speed(TypedDict):
    """Speed of the work."""

    detection: float
    """Of the detection of markers [frames/s]."""
    geometry: float
    """Of triangulation [frames/s]."""


class Tracked(TypedDict):
    """Markers along the sheath."""

    frames: int
    """Frames [1]."""
    markers: int
    """Markers [1]."""
    ids: list[int]
    """Their numbers, proximal to distal."""
    seen: float
    """Share of the markers that were located, over all frames [1]."""
    frames_too_few: list[int]
    """Frames with too few markers, counted from 0."""
    noise_mm: float | None
    """Median noise of a coordinate across the route; null where it is not known [mm]."""
    pixel_noise_ratio: float
    """Noise of a detection over that which is assumed [1]."""
    reprojection_px: dict[str, float | None]
    """Reprojection error (rms) of each camera [px]."""
    warnings: list[str]
    """What is worth knowing about the films."""
    files: list[str]
    """Files that are written."""
    frames_per_s: Speed
    """Speed of the work."""


class CameraOf(TypedDict):
    """A camera."""

    name: str
    """Name of the camera."""
    views: int
    """Boards that were detected [1]."""
    reprojection_px: float
    """Reprojection error (rms) [px]."""
    covered: float
    """Share of the image that the boards cover [1]."""
    focal_px: list[float]
    """Focal length along x and y [px]."""
    focal_sd_px: list[float]
    """Their standard deviations [px]."""
    distortion: list[float]
    """Coefficients of distortion, in the order of OpenCV [1]."""
    place_m: list[float]
    """Position of the camera [m]."""


class CamerasCalibrated(TypedDict):
    """Cameras, with `--calibrate`."""

    cameras: list[CameraOf]
    """The cameras."""
    corner_noise_px: float
    """Standard deviation of a corner [px]."""
    point_sd_mm: float
    """Standard deviation of a coordinate that the calibration itself causes [mm]."""
    warnings: list[str]
    """What is worth knowing about the images."""
    files: list[str]
    """Files that are written."""
