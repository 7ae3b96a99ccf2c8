"""Objects of `simulate --json`, `compensate --json` and `adapt.json`."""

from __future__ import annotations

from typing import NotRequired, TypedDict


class RunRanges(TypedDict):
    """Smallest and largest value over the run."""

    tension_in_N: list[float]
    """Proximal tension [N]."""
    tension_out_N: list[float]
    """Distal tension [N]."""
    elongation_m: list[float]
    """Elongation of the tendon in the sheath [m]."""
    displacement_in_m: list[float]
    """Movement of the drive [m]."""
    displacement_out_m: list[float]
    """Movement of the load [m]."""


class Simulated(TypedDict):
    """A tendon under a drive."""

    shape: str
    """Name of the route."""
    frames: int
    """Frames of the route that were used [1]."""
    rejected: int
    """Frames of the route that could not be used [1]."""
    run: str
    """Name of the run."""
    drive: str
    """Column that drives."""
    rows: int
    """Rows of the run [1]."""
    phases: dict[str, int]
    """Rows in each phase: `pull`, `pull_to_release`, `release`, `release_to_pull`, `hold` [1]."""
    range: RunRanges
    """Smallest and largest values."""
    files: list[str]
    """Files that are written."""


class MachineComputed(TypedDict):
    """A machine under a drive, or its drive under a target."""

    shape: str
    """Name of the route."""
    run: str
    """Name of the run."""
    drive: NotRequired[str]
    """Column that drives, of `simulate`."""
    target: NotRequired[str]
    """Column that is followed, of `compensate`."""
    rows: int
    """Rows of the run [1]."""
    range: dict[str, list[float]]
    """Smallest and largest value of each channel; its name states the unit."""
    files: list[str]
    """Files that are written."""


class CommandRanges(TypedDict):
    """Smallest and largest command."""

    displacement_in_m: list[float]
    """Position of the drive [m]."""
    tension_in_N: list[float]
    """Proximal tension [N]."""


class CutCommand(TypedDict):
    """A command that the limits of the drive cut."""

    time_s: float
    """Time in the run [s]."""
    limits: str
    """Limits that cut it."""
    displacement_reached_m: float
    """Movement of the load that is reached instead [m]."""
    tension_reached_N: float
    """Distal tension that is reached instead [N]."""


class Risk(TypedDict):
    """Targets that may be missed by more than the tolerance."""

    targets: int
    """Targets with a probability above 5 % [1]."""
    worst: float
    """Largest probability [1]."""
    time_s: float
    """Time of it [s]."""


class CommandFacts(TypedDict):
    """Errors, limits and tolerance of the commands of a run."""

    displacement_out_se_m: float
    """Largest standard error of the load's movement, the drive at the position [m]."""
    tension_out_se_N: float
    """Largest standard error of the distal tension, the drive at the position [N]."""
    displacement_out_se_by_tension_m: float
    """Largest standard error of the load's movement, the drive at the tension [m]."""
    tension_out_se_by_tension_N: float
    """Largest standard error of the distal tension, the drive at the tension [N]."""
    limited: list[CutCommand]
    """Commands that are cut."""
    waits: int
    """Commands that hold the drive inside the dead zone [1]."""
    out_of_tolerance: Risk | None
    """Targets that may be missed; null without `--tolerance-mm`."""


class Compensated(CommandFacts):
    """Commands that follow a target."""

    shape: str
    """Name of the route."""
    rejected: int
    """Frames of the route that could not be used [1]."""
    run: str
    """Name of the run."""
    target: str
    """Column that is followed."""
    rows: int
    """Rows of the run [1]."""
    range: CommandRanges
    """Smallest and largest commands."""
    files: list[str]
    """Files that are written."""


class NumberAt(TypedDict):
    """A followed number at a time."""

    time_s: float
    """Time in the run [s]."""
    value: float
    """Smoothed value, in the unit of its key."""
    se: float
    """Its standard error, in the unit of its key."""


class FollowedNumber(TypedDict):
    """A number of the rig that is followed."""

    key: str
    """Key of the rig file."""
    start: NumberAt
    """At the start of the run."""
    end: NumberAt
    """At its end."""
    smoothed_range: list[float]
    """Smallest and largest smoothed value, in the unit of the key."""


class AlertOf(TypedDict):
    """A disagreement between readings and model."""

    time_s: float
    """When it was certain [s]."""
    since_s: float
    """When it began [s]."""
    channel: str
    """Channel whose readings the model does not explain."""
    phase: str
    """What the drive did when it began: `pulling`, `releasing` or `hold`."""
    mechanism: str | None
    """What explains it best; null where nothing was compared."""
    where: str | None
    """On what the mechanism acts."""
    probability: float | None
    """Of the mechanism, among those that were tried [1]."""
    sentence: str | None
    """The mechanism with its size."""


class FollowedObject(TypedDict):
    """A rig that follows the readings of a run, with `--adapt`."""

    shape: str
    """Name of the route."""
    run: str
    """Name of the run."""
    drive: str
    """Column that drives."""
    rows: int
    """Rows of the run [1]."""
    rows_left_out: int
    """Rows without an equilibrium of the tendon [1]."""
    numbers: list[FollowedNumber]
    """Numbers that are followed."""
    alerts: list[AlertOf]
    """Disagreements."""
    files: list[str]
    """Files that are written."""
