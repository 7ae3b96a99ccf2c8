"""Objects of `calibrate --json` and `calibration.json`."""

from __future__ import annotations

from typing import NotRequired, TypedDict


class ChannelOf(TypedDict):
    """How well a channel is met."""

    name: str
    """Channel."""
    unit: str
    """Unit of the channel."""
    rms: float
    """Root mean square of measured less fitted, in `unit`."""
    readings: int
    """Readings [1]."""
    effective_readings: float
    """Independent readings that they count as [1]."""
    noise: float
    """Noise of the channel, in `unit`."""
    rms_over_noise: float
    """`rms` over `noise` [1]."""
    rms_over_range: float
    """`rms` over the range of the readings [1]."""
    whiteness_p: float
    """Probability of residuals as little white as these, if the model is right [1]."""


class EstimateOf(TypedDict):
    """A number of the rig."""

    value: float | None
    """Estimate, in `unit`; null where the run does not identify it."""
    ci95: list[float] | None
    """95 % interval, in `unit`."""
    unit: str
    """Unit of value and interval."""
    observable: bool
    """True where the run identifies it."""


class PlainEstimate(EstimateOf):
    """A number of a tendon on one route."""

    why: str | None
    """Why it is not identified."""
    at_bound: bool
    """True where the fit stops at a bound of the number."""
    nominal: float | None
    """Value in the rig before, in `unit`."""


class MachineEstimateOf(EstimateOf):
    """A number of a machine."""

    assumed95: list[float]
    """95 % interval that was assumed before the fit, in `unit`."""
    bounds: list[float | None]
    """What it is at least and at most with 97.5 % each, in `unit`, where it is not identified but beyond the
    middle of what was assumed; else null."""
    key: str | None
    """Key of the rig file; null where it has none."""


class HeldOut(TypedDict):
    """Misfit of a channel on cycles that are held out."""

    rms: float
    """On cycles that are held out, in `unit`."""
    fitted_rms: float
    """On cycles that are fitted, in `unit`."""
    unit: str
    """Unit of the channel."""


class Calibrated(TypedDict):
    """A tendon on one route."""

    run: str
    """File of the run."""
    shape: str
    """File of the shape."""
    rig: str | None
    """Rig file that is written; null where the fit fails its test."""
    passes: bool
    """True where the fit passes its test."""
    failures: list[str]
    """Why it fails."""
    length_m: float
    """Arc length of the route [m]."""
    total_angle_rad: float
    """Its curve angle Φ [rad]."""
    total_angle_se_rad: float
    """Standard error of Φ [rad]."""
    estimates: dict[str, PlainEstimate]
    """Numbers of the rig, by name."""
    channels: list[ChannelOf]
    """How well each channel is met."""
    warnings: list[str]
    """What is worth knowing about run and fit."""


class MachineCalibrated(TypedDict):
    """A machine: several runs, tendons, a joint, a segment, unknown numbers."""

    run: str
    """File of the first run."""
    runs: list[str]
    """Files of all runs."""
    shape: str | None
    """File of the first shape; null where the rig states the route."""
    rig: str | None
    """Rig file that is written; null where the fit fails its test."""
    passes: bool
    """True where the fit passes its test."""
    failures: list[str]
    """Why it fails."""
    estimates: dict[str, MachineEstimateOf]
    """Numbers of the rig, by name."""
    friction_angle: MachineEstimateOf
    """Product of friction and curve angle, which is known where neither factor is."""
    bends: list[MachineEstimateOf]
    """Shares of the angle in equal parts of a sheath; none where the rig or a shape has them."""
    tied: list[str]
    """Numbers that the runs only determine together."""
    held_out: dict[str, HeldOut]
    """Misfit on cycles that are held out, by channel."""
    channels: list[ChannelOf]
    """How well each channel is met."""
    warnings: list[str]
    """What is worth knowing about runs and fit."""


class FittedPiece(TypedDict):
    """A piece of a long log."""

    start_s: float
    """Time at which it begins [s]."""
    end_s: float
    """Time at which it ends [s]."""
    passes: bool
    """True where its fit passes its test."""
    failures: list[str]
    """Why it fails."""
    estimates: NotRequired[dict[str, MachineEstimateOf]]
    """Numbers of the rig, by name; left out, as the keys below, where there is no fit."""
    friction_angle: NotRequired[MachineEstimateOf]
    """Product of friction and curve angle."""
    channels: NotRequired[list[ChannelOf]]
    """How well each channel is met."""
    warnings: NotRequired[list[str]]
    """What is worth knowing about the piece."""


class PiecesCalibrated(TypedDict):
    """A long log, piece by piece, with `--every`."""

    run: str
    """File of the log."""
    shape: str | None
    """File of the first shape; null where the rig states the route."""
    rig: str | None
    """Rig file of the last piece that passes."""
    every_s: float
    """Length of a piece [s]."""
    passes: bool
    """True where a rig is written."""
    pieces: list[FittedPiece]
    """The pieces."""
