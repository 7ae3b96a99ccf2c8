"""Objects of shapes: `analyse --json`, `result.json`, `batch --json`."""

from __future__ import annotations

from typing import NotRequired, TypedDict

import msgspec

from tssgeom.route.pieces import Arcs


class Segment(msgspec.Struct, frozen=True):
    """A piece of constant curvature."""

    length_m: float
    """Arc length of the piece [m]."""
    kappa_per_m: float
    """Its curvature [1/m]."""
    angle_rad: float
    """Its curve angle [rad]."""
    s_start_m: float
    """Arc length at which it begins [m]."""
    angle_se_rad: float
    """Standard error of the angle; of a straight piece with the bend that its points may hide [rad]."""

    @classmethod
    def of(cls, arcs: Arcs) -> list[Segment]:
        """Return the pieces of a route, proximal to distal."""
        columns = (arcs.length, arcs.kappa, arcs.angle, arcs.s_start, arcs.angle_se)
        return [cls(*row) for row in zip(*(column.tolist() for column in columns), strict=True)]


class Contact(TypedDict):
    """A stretch of the route that touches the lumen, or leaves it."""

    s_start_m: float
    """Arc length at which it begins [m]."""
    s_end_m: float
    """Arc length at which it ends [m]."""
    least_m: float
    """Least clearance on it, negative outside [m]."""


class ClearanceOf(TypedDict):
    """Clearance of the tube to the lumen."""

    lumen: str
    """File of the mesh."""
    tube_radius_m: float
    """Outer radius of the tube [m]."""
    least_m: float | None
    """Least clearance; null where the route passes no wall [m]."""
    least_at_m: float | None
    """Arc length of the least clearance [m]."""
    contacts: list[Contact]
    """Stretches that touch the wall."""
    outside: list[Contact]
    """Stretches outside the lumen."""
    beyond_ends_m: float
    """Length of the route beyond the open ends of the mesh [m]."""


class Ranges(TypedDict):
    """Smallest and largest value over all good frames."""

    length_m: list[float]
    """Arc length L [m]."""
    total_angle_rad: list[float]
    """Accumulated curve angle Φ [rad]."""
    total_angle_se_rad: list[float]
    """Standard error of Φ [rad]."""
    tension_in_N: list[float]
    """Proximal tension [N]."""
    tension_out_N: list[float]
    """Distal tension [N]."""
    tension_out_se_N: list[float]
    """Standard error of the distal tension [N]."""
    elongation_m: list[float]
    """Elongation [m]."""
    elongation_se_m: list[float]
    """Standard error of the elongation [m]."""


class ShapeObject(TypedDict):
    """One shape; of a recording its last good frame."""

    shape: str
    """Name of the shape."""
    points: int
    """Points that were used [1]."""
    length_m: float
    """Arc length L, the sum of those of the pieces [m]."""
    total_angle_rad: float
    """Accumulated curve angle Φ, the sum of those of the pieces [rad]."""
    total_angle_se_rad: float
    """Standard error of Φ [rad]."""
    noise_m: float
    """Standard deviation of a coordinate of the points [m]."""
    method: str
    """Estimator behind the pieces: `spline`, `arcs` or `tip`."""
    resolution_m: NotRequired[float]
    """Length below which the sensor cannot resolve a bend, where the rig states its source [m]."""
    segments: list[Segment]
    """Pieces of constant curvature, proximal to distal."""
    tension_in_N: float
    """Tension at the proximal end [N]."""
    tension_out_N: float
    """Tension at the distal end [N]."""
    tension_out_se_N: float
    """Standard error of that tension [N]."""
    elongation_m: float
    """Elongation δ above the pretensioned state [m]."""
    elongation_se_m: float
    """Standard error of δ [m]."""
    tension_in_assumed: NotRequired[bool]
    """True where the file brings no drive, so that T_in is that of `--tension-in`."""
    warnings: list[str]
    """What is worth knowing about the input."""
    frames: NotRequired[int]
    """Frames of a recording [1]."""
    rejected: NotRequired[int]
    """Frames of a recording that could not be used [1]."""
    time_s: NotRequired[float]
    """Time of the last good frame of a recording [s]."""
    range: NotRequired[Ranges]
    """Smallest and largest values of a recording."""
    clearance: NotRequired[ClearanceOf]
    """Clearance to the lumen, where there is a mesh."""
    lines: NotRequired[list[str]]
    """With `--same`, in the common route: the shapes that it is made of."""
    error_m: NotRequired[float]
    """With `--same`: standard deviation of the common error of a sensed line, across the route [m]."""
    error_length_m: NotRequired[float]
    """With `--same`: arc length over which that error changes [m]."""
