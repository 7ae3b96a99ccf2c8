"""Which mechanism explains best what a machine disagrees in; docs/model.md (207)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from tssgeom.adapt.diagnosis import DIAGNOSIS, Means
from tssgeom.adapt.followed_machine import mean_history
from tssgeom.adapt.hypotheses import (
    TRIED,
    Hypothesis,
    Numbering,
    friction_changed,
    hidden_bends,
    numbering,
    sensed_angle_changed,
    turned,
)
from tssgeom.adapt.machine_filter import MachineFilter
from tssgeom.adapt.moments import RUN, RunFromHere, grown
from tssgeom.adapt.readings import Moment, noise_variance
from tssgeom.arrays import Matrix
from tssgeom.plausibility.limits import LIMITS
from tssgeom.rig import Rig, Sensor
from tssgeom.tendon.machine import machine_of, routed
from tssgeom.tendon.machine_simulation import simulated


class MachineFromHere(RunFromHere):
    """The last seconds of a machine, for models with other numbers.

    Parameters
    ----------
    sound, after
        As of `RunFromHere`.
    """

    def __init__(self, sound: MachineFilter, after: Sequence[Moment]) -> None:
        rig = sound.rig_now()
        machine = machine_of(rig, [routed(after[-1].arcs, rig)])
        self._history = mean_history(sound, machine, sound.time)
        self._by_angle = rig.end.given == "angle"
        super().__init__(sound, after, sound.drives, sound.channels, RUN.most_of_machine)

    def _predicted(self, rig: Rig, drive: Matrix) -> np.ndarray:
        machine = machine_of(rig, [routed(self._arcs, rig)])
        values = [one.readings.values for one in self._chosen]
        run = {"time_s": self._times} | dict(zip(self.drives, drive, strict=True))
        for name in ("joint_torque_Nm", "joint_angle_rad"):
            if all(name in one for one in values):
                run[name] = np.array([one[name] for one in values])
        end_given = rig.end.given == "angle" and "joint_angle_rad" in run
        channels = simulated(machine, run, end_given=end_given, before=self._history).channels
        none = np.full(len(self._times), math.nan)
        return np.array([channels.get(name, none) for name in self._channels])

    def _driven(self, readings: Any) -> Sequence[float]:
        return [readings.values[name] for name in self.drives]

    def _read(self, readings: Any, muted: set[str]) -> Sequence[float]:
        unused = {*muted, *self.drives, *(("joint_angle_rad",) if self._by_angle else ())}
        read = ((name, readings.values.get(name, math.nan)) for name in self._channels)
        return [math.nan if name in unused else value for name, value in read]


def machine_hypotheses(sound: MachineFilter, moments: Sequence[Moment], since: float) -> Iterator[Hypothesis]:
    """Yield the mechanisms that are tried on the filter of a machine that was sound until then."""
    rig, number = sound.rig_now(), numbering(sound)
    compliance, pretension = rig.tendon.compliance_per_N, rig.tendon.pretension_N
    length = sound.cut.total_length
    yield friction_changed(rig, number)
    if turned(moments, since):
        yield sensed_angle_changed(rig, number, "tendons")
    yield Hypothesis(
        "strain_over_time",
        "along the tendons",
        (
            number("tendon.compliance_per_N", compliance, 0.5 * compliance, 1e-6),
            number("tendon.pretension_N", pretension, TRIED.length / (compliance * length), 0.0),
        ),
        f"1/EA went from {compliance:.3g} to {{:.3g}} 1/N, the pretension to {{:.3g}} N",
        rig,
    )
    yield from hidden_bends(rig, number, length)
    by_motor = sound.drive == "motor_angle_rad"
    yield Hypothesis(
        "play_at_drive",
        "drive",
        (
            number("drive.play_rad", rig.drive.play_rad, 0.1, 0.0)
            if by_motor
            else number("backlash.width_m", 0.0, 1e-3, 0.0),
        ),
        f"play of {{:.2g}} {'rad' if by_motor else 'm'} at the drive",
        rig,
    )
    for channel in _measured(sound, moments):
        yield from _of_sensor(channel, rig, number)


def _of_sensor(channel: str, rig: Rig, number: Numbering) -> Iterator[Hypothesis]:
    size = TRIED.zero_noises * math.sqrt(noise_variance(rig.sensors.get(channel)))
    sensor = rig.sensors.get(channel, Sensor())
    zero = f"sensors.{channel}.zero"
    yield Hypothesis(
        "sensor",
        channel,
        (number(zero, sensor.zero, size, hourly=size),),
        f"the zero of {channel} is {{:+.3g}}",
        rig,
    )
    yield Hypothesis(
        "sensor",
        channel,
        (number(f"sensors.{channel}.gain", sensor.gain, 0.5, 0.1), number(zero, sensor.zero, 5.0 * size)),
        f"{channel} reads {{:.2g}} of its value and {{:+.3g}} more",
        rig,
        TRIED.imitators_last,
        mutes=True,
    )


def _measured(sound: MachineFilter, moments: Sequence[Moment]) -> list[str]:
    """Return the channels that are read and used, but for the drives and what acts on the joint."""
    unused = {*sound.muted, *sound.drives}
    unused.add("joint_angle_rad" if sound.rig.end.given == "angle" else "joint_torque_Nm")
    return [
        name
        for name in sound.channels
        if name not in unused and any(name in one.readings.values for one in moments)
    ]


def _stopped(sound: MachineFilter, after: Sequence[Moment]) -> tuple[str, str] | None:
    """Return the sensor that stands while the model says that it moves, or the drive while others move."""
    late = grown(after)
    if len(late) < LIMITS.fewest_rows:
        return None
    names = [*sound.drives, *_measured(sound, late)]
    read = np.array([[one.readings.values.get(name, math.nan) for name in names] for one in late]).T
    noise = np.array([math.sqrt(noise_variance(sound.rig.sensors.get(name))) for name in names])
    moved = np.ptp(read, axis=1) / noise
    still = moved <= DIAGNOSIS.still
    drives = len(sound.drives)
    for i in np.flatnonzero(still):
        others = moved[drives:] if i < drives else moved[:drives]
        if len(others) and others.max() > DIAGNOSIS.moved * (1.0 if i < drives else DIAGNOSIS.still):
            by = names[int(np.nanargmax(np.where(still, -1.0, moved)))]
            return names[i], f"{names[i]} stands at {read[i, -1]:.4g} while {by} moves"
    return None


OF_MACHINE = Means(MachineFromHere, machine_hypotheses, _stopped, lambda run, where: where not in run.drives)
