"""Objects of `check`, `verify` and `track` in JSON, and those of a stream that are no answers."""

from __future__ import annotations

from typing import NotRequired, TypedDict


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


class StatisticsOf(TypedDict):
    """Statistics of the last second, on stderr with `--stats`."""

    rate_hz: float
    """Answers a second [1/s]."""
    latency_p50_us: float | None
    """Median latency until the answer is sent; null without an answer [µs]."""
    latency_p99_us: float | None
    """99th percentile of it [µs]."""
    answered: int
    """Good frames since the start [1]."""
    rejected: int
    """Bad frames since the start [1]."""
    dropped: int
    """Frames that were dropped for newer ones, since the start [1]."""
    unsent: int
    """Lines that a reader could not take, since the start [1]."""
    view_lost: NotRequired[int]
    """Messages that the view could not take, with `--view` [1]."""
    record_lost: NotRequired[int]
    """Messages that the recording could not take, with `--record` [1]."""
    save_lost: NotRequired[int]
    """States that the disk could not take, with `--state` [1]."""
    rig_lost: NotRequired[int]
    """Rigs that the disk could not take, with `--write-rig` [1]."""
    stale: bool
    """True where no good frame has come for a while."""
    t: NotRequired[float]
    """Time of the last good frame, and so for the keys below [s]."""
    total_angle_rad: NotRequired[float]
    """Accumulated curve angle Φ [rad]."""
    tension_out_N: NotRequired[float]
    """Tension at the distal end [N]."""
    elongation_m: NotRequired[float]
    """Elongation [m]."""


class Closed(TypedDict):
    """The last line to a client that is cut off."""

    closed: str
    """Why it is cut off."""


class Checked(TypedDict):
    """A file."""

    file: str
    """The file, as it was given."""
    holds: str
    """`shape`, `recording`, `measured run`, `campaign`, `rig`, `mesh`, or
    `nothing that can be used`."""
    warnings: NotRequired[list[str]]
    """What may be wrong."""
    wrong: list[str]
    """What is wrong; empty where all can be used."""


class CheckedText(Checked):
    """A measured run, a rig or a mesh."""

    told: str
    """Content in one sentence."""
    read: NotRequired[list[str]]
    """How names and units of the file were read."""


class CheckedPoints(Checked):
    """A shape or a recording."""

    kind: str
    """Format."""
    unit: str
    """Unit of length in the file."""
    frames: int
    """Frames [1]."""
    points: list[int]
    """Smallest and largest number of points of a frame [1]."""
    points_not_seen: int
    """Missing points over all frames [1]."""
    stations: bool
    """True where known arc lengths are given."""
    measured: list[str]
    """Quantities that are measured beside the points."""
    read: list[str]
    """How names and units of the file were read."""
    duration_s: NotRequired[float]
    """Time from the first to the last frame of a recording [s]."""
    length_m: float
    """Arc length of the first usable frame [m]."""
    noise_m: float
    """Standard deviation of a coordinate in it; of a fibre that of its distal end [m]."""
    curvature_noise_per_m: NotRequired[float]
    """Standard deviation of a curvature of a fibre [1/m]."""
    curvature_noise_se_per_m: NotRequired[float]
    """Its standard error, 0 where it is stated [1/m]."""


class RunOfCampaign(TypedDict):
    """A run of a campaign."""

    name: str
    """Name of the run."""
    route: str
    """Name of its route."""
    samples: int
    """Samples [1]; of a machine those that are used, to which a long run is thinned."""
    duration_s: float
    """Time from the first to the last sample [s]."""
    measured: list[str]
    """Channels; each name states its unit."""
    held_out: bool
    """True where it is kept from the fit."""


class CheckedCampaign(Checked):
    """A campaign."""

    runs: list[RunOfCampaign]
    """Its runs."""
    length_m: dict[str, float]
    """Arc length of each route, by name [m]."""


class Verified(TypedDict):
    """A folder of a batch."""

    files: int
    """Files that were written [1]."""
    changed: list[str]
    """Files that are not as they were written."""
