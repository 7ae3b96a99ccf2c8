"""What differs between following one tendon and a machine: readings, filters, states, mechanisms."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import msgspec
import numpy as np

from tssgeom.adapt.diagnosis import OF_TENDON, Explanation, Means, explained
from tssgeom.adapt.followed import followed_numbers
from tssgeom.adapt.followed_machine import FollowedMachine
from tssgeom.adapt.followed_tendon import FollowedTendon, memory_on
from tssgeom.adapt.machine_diagnosis import OF_MACHINE
from tssgeom.adapt.machine_filter import MachineFilter
from tssgeom.adapt.machine_readings import channels_read
from tssgeom.adapt.readings import CHANNELS, Moment
from tssgeom.adapt.rig_filter import RigFilter
from tssgeom.adapt.saved import SavedFilter, captured
from tssgeom.channel_names import quantity_of, unit_of
from tssgeom.mechanism import tendon_count
from tssgeom.plausibility.limits import LIMITS
from tssgeom.rig import Rig, Sensor
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.machine_simulation import drive_channels, drive_of, with_torque
from tssgeom.tendon.machine_stream import CarriedMachine
from tssgeom.tendon.state import TendonState


class AssumedNoise(NamedTuple):
    """Noise of a channel by its unit. Chosen: as of coarse load cells and encoders of a laboratory."""

    m: float = 2e-5
    """Of a position or an elongation [m]."""
    rad: float = 1e-3
    """Of an angle [rad]."""
    Nm: float = 1e-3
    """Of a torque [N·m]."""
    A: float = 0.01
    """Of a current [A]."""

    @property
    def N(self) -> float:  # noqa: N802 - the unit
        """Of a tension [N]."""
        return LIMITS.weakest_N


_ASSUMED = AssumedNoise()


@dataclass(slots=True)
class _Followed:
    """What is followed."""

    rig: Rig
    """As its file has it."""
    channels: tuple[str, ...] = ()
    noisy: tuple[str, ...] = ()
    """Channels that have a noise."""
    measured: tuple[str, ...] = ()
    """Channels that the first frame measured, of a machine but for its drive."""
    means: ClassVar[Means]

    def with_noise(self) -> tuple[Rig, frozenset[str]]:
        """Return the rig with a noise of each channel, and the channels for which it is assumed."""
        return with_noise(self.rig, self.noisy)

    def captured(self, now: Any, sensed: Arcs, coldest: float) -> SavedFilter:
        """Return what a filter needs to go on."""
        return captured(now, self.with_noise()[0], sensed, self.measured, coldest)

    def explained(
        self, start: Any, moments: Sequence[Moment], since: float
    ) -> Iterator[tuple[Explanation, ...] | None]:
        """Yield None after each slice of work, and at last what explains a disagreement."""
        return explained(start, moments, since, self.means)


@dataclass(slots=True)
class OfTendon(_Followed):
    """One tendon is followed."""

    channels: tuple[str, ...] = CHANNELS
    noisy: tuple[str, ...] = (*CHANNELS, "displacement_in_m")
    means: ClassVar[Means] = OF_TENDON

    def carried(self) -> FollowedTendon:
        """Return what streams carry."""
        return FollowedTendon(self.rig)

    def begin(self, arcs: Arcs, readings: Any, state: object, seed: int) -> RigFilter:
        """Return the filter of the first frame, with the history of the tendon."""
        given = (readings.tension_in is not None and not readings.commanded, readings.tension_out is not None)
        self.measured = tuple(name for name, is_given in zip(CHANNELS, given, strict=False) if is_given)
        rig = self.with_noise()[0]
        now = RigFilter(rig, followed_numbers(rig, self.measured), arcs, seed=seed)
        before = memory_on(state, arcs, self.rig) if isinstance(state, TendonState) else None
        if before is not None:
            now.go_on(*before)
        return now

    def usable(self, readings: Any, muted: set[str]) -> Any:
        """Return readings without the position of a drive whose sensor is at fault."""
        if "displacement_in_m" in muted and readings.tension_in is not None:
            return readings._replace(displacement_in=None)
        return readings

    def given(self, readings: Any) -> frozenset[str]:
        """Return the channels that were measured."""
        values = readings._asdict()
        return frozenset(name for name in self.noisy if values[quantity_of(name)] is not None)

    def drive(self, readings: Any) -> float:
        """Return where the drive was [m] or [N]."""
        return readings.displacement_in or readings.tension_in or 0.0

    def stated(self, rig: Rig) -> Rig:
        """Return a rig with what its file states of the sensors."""
        return msgspec.structs.replace(rig, sensors=self.rig.sensors)


@dataclass(slots=True)
class OfMachine(_Followed):
    """A machine is followed."""

    means: ClassVar[Means] = OF_MACHINE

    def __post_init__(self) -> None:
        self.channels = self.noisy = channels_read(self.rig)

    def carried(self) -> FollowedMachine:
        """Return what streams carry."""
        return FollowedMachine(self.rig)

    def begin(self, arcs: Arcs, readings: Any, state: object, seed: int) -> MachineFilter:
        """Return the filter of the first frame, with the history of the machine."""
        rig, history = self.with_noise()[0], state.history if isinstance(state, CarriedMachine) else None
        values = with_torque({name: np.array([one]) for name, one in readings.values.items()}, rig)
        drive = drive_of(values, tendon_count(rig.drive, rig.end)) if history is None else history.drive
        driving = drive_channels(drive, tendon_count(rig.drive, rig.end))
        self.measured = tuple(name for name in self.channels if name in values and name not in driving)
        now = MachineFilter(rig, followed_numbers(rig, self.measured), arcs, drive, seed=seed)
        if history is not None:
            now.go_on(history)
        return now

    def usable(self, readings: Any, muted: set[str]) -> Any:
        """Return the readings: a machine has one drive."""
        return readings

    def given(self, readings: Any) -> frozenset[str]:
        """Return the channels that were measured."""
        return frozenset(readings.values)

    def drive(self, readings: Any) -> float:
        """Return where the drive was, of several the first, in its unit."""
        names = (
            name for name in readings.values if name.startswith(("motor_", "displacement_in", "tension_in"))
        )
        return readings.values[next(names)]

    def stated(self, rig: Rig) -> Rig:
        """Return a rig with the noise of its file, and with the zeros and gains that are followed."""
        followed = {
            name: msgspec.structs.replace(self.rig.sensors.get(name, Sensor()), zero=one.zero, gain=one.gain)
            for name, one in rig.sensors.items()
        }
        kept = {name: one for name, one in followed.items() if name in self.rig.sensors or one != Sensor()}
        return msgspec.structs.replace(rig, sensors=kept)


def kind_of(rig: Rig) -> OfTendon | OfMachine:
    """Return what a rig needs to be followed."""
    return OfMachine(rig) if rig.is_machine else OfTendon(rig)


def remarks(kind: OfTendon | OfMachine, readings: Any) -> tuple[str, ...]:
    """Name each channel that was measured and whose noise is assumed."""
    assumed = sorted(kind.with_noise()[1] & kind.given(readings))
    return tuple(
        f"sensors.{name}.noise is not stated: {assumed_noise(name):g} {unit_of(name)} is assumed"
        for name in assumed
    )


def assumed_noise(channel: str) -> float:
    """Return the noise that is assumed of a channel, in its unit."""
    return getattr(_ASSUMED, unit_of(channel))


def with_noise(rig: Rig, channels: Iterable[str]) -> tuple[Rig, frozenset[str]]:
    """Return a rig with a noise for each channel, and the channels for which it is assumed."""
    stated = rig.sensors
    lacking = {
        name for name in channels if name not in stated or not (stated[name].noise or stated[name].resolution)
    }
    assumed = {
        name: msgspec.structs.replace(stated.get(name, Sensor()), noise=assumed_noise(name))
        for name in lacking
    }
    return msgspec.structs.replace(rig, sensors={**stated, **assumed}), frozenset(lacking)
