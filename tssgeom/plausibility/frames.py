"""The rules on frames, commands and rigs: cheap, as each frame of a stream has to pass them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tssgeom.arrays import Points
from tssgeom.core.constants import CHANCE
from tssgeom.effects import HiddenBend, SensorLaw, named
from tssgeom.errors import SettingsError
from tssgeom.plausibility.kinds import Remark
from tssgeom.plausibility.limits import LIMITS
from tssgeom.plausibility.rules import remark, warnings_of
from tssgeom.rig import Rig, Sensor

_DRIVE = "tension_in_N"
_AVERAGED = 20  # frames over which the usual time between frames is averaged; chosen


class Sensed(Protocol):
    """What the rules read of a frame; docs/formats.md has the units."""

    @property
    def points(self) -> Points:
        """Sensed points [m]."""
        ...

    @property
    def time(self) -> float:
        """Time [s]."""
        ...

    @property
    def tension_in(self) -> float | None:
        """T_in [N]."""
        ...

    @property
    def tension_out(self) -> float | None:
        """T_out [N]."""
        ...

    @property
    def displacement_in(self) -> float | None:
        """Position of the drive [m]."""
        ...

    @property
    def elongation(self) -> float | None:
        """Elongation [m]."""
        ...

    @property
    def displacement_target(self) -> float | None:
        """Position of the load that is wanted [m]."""
        ...

    @property
    def tension_out_target(self) -> float | None:
        """Distal tension that is wanted [N]."""
        ...

    @property
    def temperature(self) -> float | None:
        """Temperature [°C]."""
        ...

    @property
    def noise(self) -> float | None:
        """Stated noise of a coordinate [m]."""
        ...


def strain_remarks(rig: Rig, length: float, tension: float) -> list[Remark]:
    """Return where a rig, the length of a route [m] and a tension [N] can hardly belong to each other."""
    remarks = [
        remark(
            "hidden_bend_beyond", "frame", f"hidden_bend at {effect.at_m:g} m on a route of {length:.3g} m"
        )
        for effect in rig.effects
        if isinstance(effect, HiddenBend) and effect.at_m > length
    ]
    strain = rig.tendon.compliance_per_N * tension
    if strain > LIMITS.largest_strain:
        would = f"{tension:g} N would stretch the tendon by {100.0 * strain:.3g}%"
        remarks.append(remark("strain", "frame", would))
    return remarks


def given_route_remarks(rig: Rig, length: float, angle: float, angle_se: float) -> Iterator[Remark]:
    """Yield whether a rig gives another route than a shape of this length [m] and angle [rad] has."""
    given, error = rig.route, LIMITS.usual_error
    if given.length_m is not None and given.length_m < (1.0 - error) * length:
        what = f"route.length_m is {given.length_m:g} m and the shape has {length:.3g} m"
        yield remark("given_route", "frame", what)
    turn = given.angle_rad
    if turn is not None and abs(angle - turn) > error * max(turn, angle) + CHANCE.clear * angle_se:
        yield remark(
            "given_route", "frame", f"route.angle_rad is {turn:g} and the shape turns {angle:.3g} rad"
        )


def frame_remarks(frame: Sensed, length: float) -> Iterator[Remark]:
    """Yield what is wrong with the readings of one frame on a route of this length [m]."""
    if (warmth := frame.temperature) is not None:
        if not -LIMITS.warmest_C <= warmth <= LIMITS.hottest_C:
            yield remark("temperature", "frame", f"temperature_C is {warmth:g} °C")
        elif warmth > LIMITS.warmest_C:
            yield remark("warm", "frame", f"temperature_C is {warmth:g} °C")
    if (position := frame.displacement_in) is not None and abs(position) > LIMITS.largest_stroke * length:
        where = f"displacement_in_m is {position:g} m on a route of {length:.3g} m"
        yield remark("stroke", "frame", where)
    if (stretch := frame.elongation) is not None and abs(stretch) > LIMITS.largest_strain * length:
        yield remark("stretch_unit", "frame", f"elongation_m is {stretch:g} m on a route of {length:.3g} m")
    if (noise := frame.noise) is not None and noise > LIMITS.largest_noise * length:
        yield remark("noise_unit", "frame", f"noise_m is {noise:g} m on a route of {length:.3g} m")


def frame_warnings(
    frame: Sensed, rig: Rig, length: float, tension: float, others: Iterable[Remark] = ()
) -> tuple[str, ...]:
    """Return what is to be known of a frame on a route of a length [m] under its greatest tension [N].

    Raises SettingsError where its readings, or the strain of the tendon, cannot be, or there are two targets.
    """
    require_one_target(frame.displacement_target, frame.tension_out_target)
    remarks = [*frame_remarks(frame, length), *others, *strain_remarks(rig, length, tension)]
    return tuple(warnings_of(None, remarks)) if remarks else ()


def command_remarks(rig: Rig, length: float, tension: float, displacement: float) -> Iterator[Remark]:
    """Yield what is wrong with a command: the tension [N] or the position [m] that a drive is to take."""
    strain, scale = rig.tendon.compliance_per_N * tension, rig.sensors.get(_DRIVE, Sensor()).full_scale
    needs = f"the target needs {tension:.4g} N at the proximal end"
    if strain > LIMITS.largest_strain:
        yield remark("strain", "command", f"{needs}, which would stretch the tendon by {100.0 * strain:.3g}%")
    if scale and tension > scale:
        rule = "full_scale" if tension > LIMITS.gross * scale else "beyond_scale"
        yield remark(rule, "command", f"{needs}, and the full scale of {_DRIVE} is {scale:g} N")
    if abs(displacement) > LIMITS.largest_stroke * length:
        moves = f"the target needs a move of {displacement:.4g} m on a route of {length:.3g} m"
        yield remark("stroke", "command", moves)


def require_command(rig: Rig, length: float, tension: float, displacement: float) -> None:
    """Refuse a command that no drive should get; raises SettingsError where a rule refuses it."""
    warnings_of(None, command_remarks(rig, length, tension, displacement))


def require_one_target(displacement: float | None, tension_out: float | None) -> None:
    """Refuse a target movement [m] beside a target tension [N] of the distal end.

    Raises SettingsError where both are given.
    """
    if displacement is not None and tension_out is not None:
        raise SettingsError(
            f"two targets, displacement_target_m {displacement:g} and tension_out_target_N "
            f"{tension_out:g}: give one"
        )


def rig_remarks(rig: Rig) -> Iterator[Remark]:
    """Yield what is wrong with the numbers of a rig beside each other."""
    if rig.friction.coefficient > LIMITS.most_rig_friction:
        yield remark("rig_friction", "rig", f"friction.coefficient is {rig.friction.coefficient:g}")
    tension = max(LIMITS.judged_N, rig.tendon.pretension_N)
    strain = rig.tendon.compliance_per_N * tension
    if strain > LIMITS.usual_strain:
        yield remark("rig_strain", "rig", f"{tension:g} N would stretch the tendon by {100.0 * strain:.3g}%")
    for name, sensor in rig.sensors.items():
        worst, scale = max(sensor.noise, sensor.resolution), sensor.full_scale
        if 0.0 < scale < worst:
            yield remark(
                "rig_sensor", "rig", f"sensors.{name} resolves {worst:g} and its full scale is {scale:g}"
            )
        elif name.startswith("tension") and 0.0 < scale < rig.tendon.pretension_N:
            pretension = f"the pretension is {rig.tendon.pretension_N:g} N"
            yield remark(
                "rig_sensor", "rig", f"the full scale of sensors.{name} is {scale:g} N and {pretension}"
            )


def unused_parts(rig: Rig, *, fitted: bool) -> Iterator[str]:
    """Yield what a rig states that does not act, be it `fitted` or not, a sentence each."""
    if rig.is_machine:
        of_sensors = [
            each for each in rig.effects if each.hook == "observation" and not isinstance(each, SensorLaw)
        ]
        if of_sensors:
            known = "give zero, gain and lag_s in [sensors.NAME], and end.play_rad"
            yield f"effects of sensors do not act on a machine ({named(of_sensors)}): {known}"
    elif not fitted and (rig.route.length_m is not None or rig.route.angle_rad is not None):
        yield "[route] length_m and angle_rad count without a shape: of one tendon a sensed one counts first"


@dataclass(slots=True)
class FrameWatch:
    """What the frames of one stream break together; it holds a few numbers, however long the stream is."""

    frames: int = 0
    latest: float = math.nan
    """Time of the last frame [s]."""
    interval: float = 0.0
    """Usual time between frames [s]."""
    highest: float = 0.0
    """Greatest T_in so far [N]."""
    points: Points | None = None
    """Points of the last frame [m]."""
    repeated: int = 0
    """Frames that repeated the points of the one before."""
    varied: bool = False
    """Whether points differed from frame to frame before."""

    def take(self, frame: Sensed, *, in_order: bool = True) -> tuple[str, ...]:
        """Take in the next good frame, and return its warnings; its points may be in any order."""
        step, self.latest = frame.time - self.latest, frame.time
        before, self.points = self.points, frame.points
        self.frames += 1
        remarks: tuple[Remark, ...] = ()
        if step > 0.0:
            remarks += self._clock(step)
        if before is not None and not _differ(before, frame.points):
            remarks += self._repeat()
        elif before is not None:
            self.varied, self.repeated = True, 0
            if in_order and step > 0.0 and _leaps(before, frame.points, LIMITS.fastest_m_per_s * step):
                leap = f"half of the points moved faster than {LIMITS.fastest_m_per_s:g} m/s"
                remarks += (remark("frame_leap", "frame", leap),)
        if (pull := frame.tension_in) is not None:
            if pull > self.highest:
                self.highest = pull
            if (distal := frame.tension_out) is not None:
                remarks += self._distal(distal)
        return tuple(each.text for each in remarks) if remarks else ()

    def leave_clock(self) -> None:
        """Compare the time of the next frame with none before it: it is on another clock."""
        self.latest = math.nan

    def _clock(self, step: float) -> tuple[Remark, ...]:
        if self.frames > _AVERAGED and step > LIMITS.pause * self.interval:
            late = f"the frame comes {step:.3g} s after the last one, usual are {self.interval:.2g} s"
            return (remark("frame_time_jump", "frame", late),)
        self.interval += (step - self.interval) / min(self.frames - 1, _AVERAGED)
        return ()

    def _repeat(self) -> tuple[Remark, ...]:
        self.repeated += 1
        if not self.varied or self.repeated % LIMITS.frozen_frames:
            return ()
        return (
            remark("frozen_frames", "frame", f"{self.repeated} frames repeat the points of the one before"),
        )

    def _distal(self, distal: float) -> tuple[Remark, ...]:
        if distal < -max(LIMITS.negative * self.highest, LIMITS.weakest_N):
            return (remark("negative_tension", "frame", f"tension_out_N is {distal:.3g} N"),)
        if distal > (1.0 + LIMITS.slight) * self.highest + LIMITS.weakest_N:
            above = f"tension_out_N is {distal:.3g} N and tension_in_N was at most {self.highest:.3g} N"
            return (remark("tension_excess", "frame", above),)
        return ()


def _differ(one: Points, other: Points) -> bool:
    """Whether two frames have different points; one coordinate is compared first, as it mostly differs."""
    if one is other or not len(one) + len(other):  # without points the route is that of the rig
        return False
    if one.shape != other.shape or one.item(one.size // 2) != other.item(one.size // 2):
        return True
    return not np.array_equal(one, other, equal_nan=True)


def _leaps(one: Points, other: Points, most: float) -> bool:
    """Whether half of the points, as many as before, have a coordinate that changed by more than this [m]."""
    if one.shape != other.shape:
        return False
    return 2 * int(np.count_nonzero((np.abs(other - one) > most).any(axis=1))) > len(one)
