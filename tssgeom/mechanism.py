"""What pulls the tendons of a rig, through which sheaths, and what they pull: drives, routes and ends.

Source: docs/model.md (171)-(176).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Literal, NamedTuple, get_args

import msgspec
import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Vector
from tssgeom.channel_names import numbered
from tssgeom.core.constants_tendon_rows import TABLE
from tssgeom.effects import AnyEffect, Channel, LoadLaw, SensorLaw
from tssgeom.errors import SettingsError, printable, require

HOLDS = 3 + TABLE.size  # derived: three numbers and a table hold a coordinate beside its stiffness


class DriveLimits(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Limits of the commands of a drive; a limit that is left out is none."""

    tension_N: float | None = None
    """Greatest proximal tension [N]."""
    displacement_m: tuple[float, float] | None = None
    """Least and greatest position of the drive, from the pretensioned state [m]."""
    speed_m_per_s: float | None = None
    """Greatest speed of the drive [m/s]."""

    def __post_init__(self) -> None:
        for name in ("tension_N", "speed_m_per_s"):
            if (value := getattr(self, name)) is not None:
                require(0.0 < value < math.inf, f"drive.limits.{name}", value, "give a finite value > 0")
        if self.displacement_m is not None:
            low, high = self.displacement_m
            if not (math.isfinite(low) and math.isfinite(high) and low <= 0.0 < high):
                raise SettingsError(
                    f"drive.limits.displacement_m is [{low:g}, {high:g}]: give the least position <= 0 m and "
                    "the greatest > 0 m; runs begin at 0"
                )


NO_LIMITS = DriveLimits()


class Drive(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What pulls the tendons: one tendon by itself, two on one pulley, or several each by itself."""

    kind: Literal["tendon", "pair", "loop", "tendons"] = "tendon"
    """`pair`: two tendons of which a turn of the pulley winds one up and lets the other out; `loop`: one
    cable with both ends on it, which is the same without slack; `tendons`: those of a segment, each with a
    drive of its own."""
    radius_m: float = 0.0
    """Radius of the pulley on which the motor winds [m]; 0 where there is none."""
    gear: float = 1.0
    """Turns of the motor for one of the pulley [1]."""
    coupling: float = 1.0
    """Of a pair: what the second tendon is let out over what the first is wound up [1]."""
    slack_m: float = 0.0
    """Of a pair: by how much the second tendon is too long at rest [m]."""
    play_rad: float = 0.0
    """Play between motor and pulley, at the motor [rad]; it starts engaged for positive motion."""
    friction_Nm: float = 0.0
    """Coulomb friction of the motor, which it feels beside the tendons [N·m]."""
    torque_constant_Nm_per_A: float = 0.0
    """Torque of the motor for a current [N·m/A]; 0 where not known."""
    lag_s: float = 0.0
    """By how much later the drive is recorded than what answers [s]; negative where it is earlier."""
    limits: DriveLimits = NO_LIMITS
    """Force, travel and speed that no command exceeds."""

    def __post_init__(self) -> None:
        for name in ("radius_m", "slack_m", "play_rad", "friction_Nm", "torque_constant_Nm_per_A"):
            value = getattr(self, name)
            require(0.0 <= value < math.inf, f"drive.{name}", value, "give a finite value >= 0")
        for name in ("gear", "coupling"):
            value = getattr(self, name)
            require(0.0 < value < math.inf, f"drive.{name}", value, "give a finite value > 0")
        require(math.isfinite(self.lag_s), "drive.lag_s", self.lag_s, "give a finite value")

    @property
    def arm(self) -> float:
        """How far a tendon moves for each radian of the motor [m]."""
        return self.radius_m / self.gear


class End(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the tendons pull: a spring, a weight, nothing that moves, a joint, or a segment that bends."""

    kind: Literal["spring", "weight", "blocked", "carried", "joint", "segment"] = "spring"
    """`spring` is that of `[load]`; `weight` hangs with the pretension; `blocked` does not move;
    `carried` moves with the drive, as both ends of a band on one frame that is moved round a drum."""
    radius_m: float = 0.0
    """Lever arm of the tendons on the joint, or their distance from the backbone [m]."""
    stiffness_Nm_per_rad: float = 0.0
    """Torque for each radian of the joint or of the bending [N·m/rad]."""
    gravity_Nm: float = 0.0
    """Greatest torque of the weight of what a joint carries [N·m]."""
    gravity_at_rad: float = 0.0
    """Angle between the joint at rest and where the weight has no moment [rad]."""
    hardening_Nm_per_rad3: float = 0.0
    """Torque of the joint's load for the cube of its angle, beside its stiffness [N·m/rad³]."""
    friction_Nm: float = 0.0
    """Coulomb friction of the joint itself, beside that of the tendons [N·m]."""
    play_rad: float = 0.0
    """Play between the joint and what measures its angle; a target is of what is measured [rad]."""
    tendon_angles_deg: tuple[float, ...] = ()
    """Of a segment: where its tendons lie round the backbone [deg]."""
    given: Literal["torque", "angle"] = "torque"
    """Of a joint whose angle and torque are both measured: which of them acts, the other answers."""
    length_m: float = 0.0
    """Of a segment: length of the backbone [m]."""
    marker_m: float = 0.0
    """Of a segment: how far the marker is beyond the tip [m]."""

    def __post_init__(self) -> None:
        names = ("radius_m", "stiffness_Nm_per_rad", "gravity_Nm", "play_rad", "length_m", "marker_m")
        for name in (*names, "friction_Nm", "hardening_Nm_per_rad3"):
            value = getattr(self, name)
            require(0.0 <= value < math.inf, f"end.{name}", value, "give a finite value >= 0")
        if self.kind in ("joint", "segment"):
            require(self.radius_m > 0.0, "end.radius_m", self.radius_m, "give the lever arm, > 0 m")
        if self.kind == "segment" and len(self.tendon_angles_deg) < 2:
            raise SettingsError(
                "end.tendon_angles_deg: a segment needs two angles [deg] or more, one a tendon"
            )
        for angle in self.tendon_angles_deg:
            require(math.isfinite(angle), "end.tendon_angles_deg", angle, "give finite angles [deg]")


class GivenRoute(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The route of a machine whose shape nobody senses, and what is wrong with a sensed one."""

    length_m: float | None = None
    """Length of each sheath [m]; left out, that of the shape."""
    angle_rad: float | None = None
    """Curve angle of each sheath [rad]; left out, that of the shape."""
    angle_gain: float = 1.0
    """True angle over the one that is given or sensed [1]."""
    bends: tuple[float, ...] = ()
    """Where the sheath bends: shares of the angle in equal parts of the length, from the proximal end, of any
    sum [1]; `[1]` is an even bend. Left out, those of the shape, or unknown."""

    def __post_init__(self) -> None:
        if self.bends:
            sound = min(self.bends) >= 0.0 and 0.0 < sum(self.bends) < math.inf
            require(sound, "the sum of route.bends", sum(self.bends), "give shares >= 0, one of them > 0")
            if self.length_m is None or self.angle_rad is None:
                raise SettingsError("route.bends: give route.length_m and route.angle_rad too")
        for name in ("length_m", "angle_rad", "angle_gain"):
            if (value := getattr(self, name)) is not None:
                sound = math.isfinite(value) and (value > 0.0 or (name == "angle_rad" and value == 0.0))
                require(sound, f"route.{name}", value, "give a finite value > 0")


class Coordinates(NamedTuple):
    """How the ends of n tendons move with the m coordinates of their end; docs/model.md (171)."""

    distal: Matrix
    """[n, m] Movement of each load towards its drive for 1 of each coordinate [m]."""
    stiffness: Vector
    """[m] Force that holds each coordinate."""
    holds: Matrix
    """[m, 40] What holds each beside its stiffness: the greatest moment of a weight, the angle at rest from
    where it has none, the force of a load that hardens over the cube of its coordinate, and a table of the
    core with the force of a law."""
    names: tuple[str, ...]
    """[m] Channels that read the coordinates."""
    friction: float = 0.0
    """Coulomb friction of the only coordinate; docs/model.md (195)."""


def tendon_count(drive: Drive, end: End) -> int:
    """Return how many tendons a rig has; raises SettingsError where drive and end do not go together."""
    count = {"tendon": 1, "pair": 2, "loop": 2}.get(drive.kind, len(end.tendon_angles_deg))
    if end.kind == "segment" and count != len(end.tendon_angles_deg):
        raise SettingsError(
            f"end.tendon_angles_deg has {len(end.tendon_angles_deg)} angles, drive.kind {drive.kind!r} "
            f"{count} tendons: "
            'give one angle a tendon, or drive.kind = "tendons"'
        )
    if drive.kind == "tendons" and end.kind != "segment":
        raise SettingsError('drive.kind "tendons" pulls a segment: give end.kind = "segment"')
    if count > 1 and end.kind in ("spring", "weight", "carried"):
        raise SettingsError(f'end.kind {end.kind!r} has one tendon: give end.kind = "joint" or "blocked"')
    return count


def coordinates(drive: Drive, end: End, load_stiffness: float, law: Vector | None = None) -> Coordinates:
    """Return what the end makes of the tendons' motion.

    `load_stiffness` is that of a spring [N/m], `law` a table of the core: torque over the angle of a joint.
    """
    n = tendon_count(drive, end)
    none = np.zeros((1, HOLDS))
    if end.kind == "joint":
        distal = end.radius_m * np.array([[1.0], [-1.0]][:n])
        weight = (end.gravity_Nm, end.gravity_at_rad, end.hardening_Nm_per_rad3)
        holds = np.concatenate([weight, np.zeros(TABLE.size) if law is None else law])[None, :]
        stiffness = np.array([end.stiffness_Nm_per_rad])
        return Coordinates(distal, stiffness, holds, ("joint_angle_rad",), end.friction_Nm)
    if end.kind == "segment":
        angles = np.radians(end.tendon_angles_deg)
        distal = end.radius_m * np.column_stack([np.cos(angles), np.sin(angles)])
        names = ("bending_x_rad", "bending_y_rad")
        return Coordinates(distal, np.full(2, end.stiffness_Nm_per_rad), np.zeros((2, HOLDS)), names)
    if end.kind in ("blocked", "carried"):
        return Coordinates(np.zeros((n, 1)), np.ones(1), none, ("",))
    stiffness = 0.0 if end.kind == "weight" else load_stiffness
    return Coordinates(np.ones((1, 1)), np.array([stiffness]), none, ("displacement_out_m",))


def held_by(holds: Matrix, at: Matrix) -> Matrix:
    """Return the forces [s, m] that hold coordinates where they are [s, m], by `Coordinates.holds`; (173)."""
    most, at_rest, cube, points = holds[:, :4].T
    force = most * (np.sin(at + at_rest) - np.sin(at_rest)) + cube * at**3
    for a in np.flatnonzero(points):
        force[:, a] += core.tabulated(holds[a, 3:], np.ascontiguousarray(at[:, a]))
    return force


def per_motor_angle(drive: Drive, count: int) -> Vector:
    """Return how far each of the drives moves for each radian of the motor [n] [m]."""
    if drive.kind == "tendons":  # each has a drive of its own
        return np.zeros(count)
    return drive.arm * np.array([1.0, -drive.coupling])[:count]


def tip(bending: Matrix, end: End) -> Matrix:
    """Return the marker [s, 3] of a segment of constant curvature, bent by [s, 2] [rad] [m]; (176)."""
    angle = np.hypot(*bending.T)
    small = angle < 1e-6
    divided = np.where(small, 1.0, angle)
    sideways = np.where(small, 0.5 * end.length_m, end.length_m * (1.0 - np.cos(divided)) / divided**2)
    sideways = sideways + end.marker_m * np.where(small, 1.0, np.sin(divided) / divided)
    along = end.length_m * np.where(small, 1.0, np.sin(divided) / divided) + end.marker_m * np.cos(angle)
    return np.column_stack([sideways[:, None] * bending, along])


OF_TENDON = ("tension_in_N", "tension_out_N", "displacement_in_m", "displacement_out_m")
OF_MOTOR, OF_CURRENT = ("motor_angle_rad", "motor_torque_Nm"), "motor_current_A"
OF_END = {
    "joint": ("joint_angle_rad", "joint_torque_Nm"),
    "segment": ("bending_x_rad", "bending_y_rad", "tip_x_m", "tip_y_m", "tip_z_m"),
}
"""Channels of a machine, the last by the kind of its end; `numbered` names those of several tendons.

A new channel is named here; what a machine computes, what it may answer in, and what a file may hold follow.
"""


def channels_of(drive: Drive, end: End) -> tuple[str, ...]:
    """Return the channels that a machine may compute, in the order of tables."""
    current = (OF_CURRENT,) if drive.torque_constant_Nm_per_A > 0.0 else ()
    tendons = _of_tendons(OF_TENDON, tendon_count(drive, end))
    return (*tendons, *_of_motor(drive), *current, *OF_END.get(end.kind, ()))


def answering(drive: Drive, end: End) -> tuple[str, ...]:
    """Return the channels that a machine may answer in, those of its end first."""
    count = tendon_count(drive, end)
    *ends, load = OF_TENDON
    of_end = OF_END.get(end.kind, (load,) if end.kind in ("spring", "weight") else ())
    alone = ("elongation_m",) if count == 1 else ()
    return (*of_end, *_of_motor(drive), *_of_tendons(ends, count), *alone)


def all_channels(most_tendons: int) -> tuple[str, ...]:
    """Return the channels of every machine with at most so many tendons."""
    of_ends = (name for names in OF_END.values() for name in names)
    return (*OF_MOTOR, OF_CURRENT, *of_ends, *_of_tendons(OF_TENDON, most_tendons))


def _of_motor(drive: Drive) -> tuple[str, ...]:
    return OF_MOTOR if drive.radius_m > 0.0 else ()


def _of_tendons(names: Iterable[str], count: int) -> Iterator[str]:
    return (channel for name in names for channel in numbered(name, count))


def is_machine(drive: Drive, end: End) -> bool:
    """Whether there is more than one tendon, or an end other than a spring."""
    return drive.kind != "tendon" or end.kind != "spring"


def require_effects(drive: Drive, end: End, effects: Iterable[AnyEffect]) -> None:
    """Refuse laws of what a rig does not have, with a SettingsError."""
    for each in effects:
        if isinstance(each, LoadLaw) and end.kind != "joint":
            raise SettingsError('effects: load_law acts on a joint, with end.kind = "joint"')
        if isinstance(each, SensorLaw):
            known = channels_of(drive, end) if is_machine(drive, end) else get_args(Channel)
            if each.channel not in known:
                names = ", ".join(known)
                raise SettingsError(f"effects.sensor_law: no channel {printable(each.channel)!r}: {names}")
