"""Objects of `check --json` and `verify --json`."""

from __future__ import annotations

from typing import NotRequired, TypedDict


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
