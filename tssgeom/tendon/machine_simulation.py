"""Whole runs of machines: the channel that drives, what acts at the end, and what every sensor reads.

Source: docs/model.md (171)-(178).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple, get_args

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Vector
from tssgeom.errors import FitError, SettingsError
from tssgeom.mechanism import Coordinates, numbered, per_motor_angle, tip
from tssgeom.rig import Rig, Sensor
from tssgeom.tendon.machine import Machine, Start, begin, carry_on, held_tensions, play

DriveName = Literal["motor_angle_rad", "displacement_in", "tension_in", "motor_torque_Nm"]
GIVEN_DRIVES: tuple[DriveName, ...] = get_args(DriveName)
"""What may drive a machine; the first that a run has does. The middle ones are channels of each tendon."""
_STILL = 1e-9  # rad that count as no motion of a motor; derived: beyond rounding, below any encoder's step


def drive_of(run: Mapping[str, Vector], count: int) -> DriveName:
    """Return which channel drives: the first of `GIVEN_DRIVES` that the run has.

    Raises
    ------
    SettingsError
        Where it has none.
    """
    for name in GIVEN_DRIVES:
        if all(channel in run for channel in drive_channels(name, count)):
            return name
    known = ", ".join(channel for name in GIVEN_DRIVES for channel in drive_channels(name, count))
    raise SettingsError(f"the run has no drive: give one of {known}")


def drive_channels(drive: str, count: int) -> tuple[str, ...]:
    """Return the channels of a drive, one for each tendon unless one motor drives all."""
    unit = {"displacement_in": "m", "tension_in": "N"}.get(drive)
    return (drive,) if unit is None else tuple(numbered(f"{drive}_{unit}", count))


def with_torque(run: Mapping[str, Vector], rig: Rig) -> Mapping[str, Vector]:
    """Return a run with the torque of its motor where the current determines it."""
    constant = rig.drive.torque_constant_Nm_per_A
    if constant == 0.0 or "motor_current_A" not in run or "motor_torque_Nm" in run:
        return run
    return {**run, "motor_torque_Nm": constant * run["motor_current_A"]}


class MachineRun(NamedTuple):
    """A whole run: what every channel would read, and the tension along the tendons."""

    channels: dict[str, Vector]
    """[s] By name."""
    tension: np.ndarray
    """[s, n, bars + 2] Tension of each bar where asked for, else no rows [N]."""


def simulate_machine(
    machine: Machine,
    run: Mapping[str, Vector],
    *,
    drive: DriveName | None = None,
    end_given: bool = False,
    start: Start | None = None,
) -> dict[str, Vector]:
    """Take a machine through a run, and return what every channel would read.

    Parameters
    ----------
    machine
        The rig on its routes.
    run
        Columns: `time_s` [s], the drive, and what acts at the end: `joint_torque_Nm` against the joint [N·m].
    drive
        The channel that is given; without it the first of `GIVEN_DRIVES`.
    end_given
        Whether `joint_angle_rad` is given too, so that the torque is an outcome.
    start
        Where the tendons stand when the run begins; without it at rest.

    Raises
    ------
    SettingsError
        Where the run has no drive, or the rig not what it needs.
    FitError
        Where there is no equilibrium.
    """
    return simulated(machine, run, drive=drive, end_given=end_given, start=start).channels


def simulated(
    machine: Machine,
    run: Mapping[str, Vector],
    *,
    drive: DriveName | None = None,
    end_given: bool = False,
    start: Start | None = None,
    profile: bool = False,
) -> MachineRun:
    """Do as `simulate_machine`, and return the tension along every tendon too where a `profile` is wanted."""
    n, motion, rig = machine.count, machine.coordinates, machine.rig
    run = with_torque(run, rig)
    name = drive or drive_of(run, n)
    time = run["time_s"]
    run = {**run, **{each: _as_driven(run, each, rig.drive.lag_s) for each in drive_channels(name, n)}}
    spans = np.diff(time, prepend=2.0 * time[0] - time[1] if len(time) > 1 else time[0] - 1.0)
    arms = per_motor_angle(rig.drive, n)
    if name.startswith("motor") and not arms.any():
        raise SettingsError(
            f"drive.radius_m is {rig.drive.radius_m:g}: {name} needs the pulley's radius, > 0 m"
        )
    motor = _with_zero(run, "motor_angle_rad", rig)
    given, by_force = np.zeros((len(time), n)), name == "tension_in"
    if name == "motor_angle_rad":
        given = np.outer(play(motor, rig.drive.play_rad), arms)
    elif name != "motor_torque_Nm":
        given = np.column_stack([_with_zero(run, channel, rig) for channel in drive_channels(name, n)])
    if by_force:
        given = np.maximum(given, 0.0)
    held = held_tensions(machine, start)
    state = begin(machine, held)
    moved, laws, load = _end(run, motion, rig, end_given)
    if rig.end.kind == "carried":
        if name not in ("motor_angle_rad", "displacement_in"):
            raise SettingsError(
                f'end.kind is "carried": {name} cannot drive, give an angle or a displacement'
            )
        moved = given
    proximal = np.zeros_like(laws.distal)
    if name == "motor_torque_Nm":
        laws, proximal = _with_motor(laws, arms)
        load = np.column_stack([load, -_with_zero(run, name, rig)])
        state = state._replace(coordinate=np.append(state.coordinate, 0.0))
    done, trace, _ = carry_on(
        machine,
        state,
        laws,
        proximal,
        laws.distal.T @ held[:, -1] - proximal.T @ held[:, 0],
        by_force=by_force,
        spans=spans,
        given=given,
        moved=moved,
        load=load,
        profile=profile,
    )
    if done < len(time):
        raise FitError(f"there is no equilibrium of the machine at {time[done]:g} s: thin the run less")
    if name == "motor_torque_Nm":
        motor = trace.coordinate[:, -1]
    turned = motor if name.startswith("motor") else None
    balance = motion.distal.T @ held[:, -1] if end_given else None
    channels = _channels(machine, run, trace.ends, trace.coordinate, turned, balance)
    return MachineRun(channels, trace.tension)


def _end(
    run: Mapping[str, Vector], motion: Coordinates, rig: Rig, end_given: bool
) -> tuple[Matrix, Coordinates, Matrix]:
    """Return how each load is moved [s, n] [m], the laws of the coordinates, and what acts on them [s, m]."""
    samples, (n, m) = len(run["time_s"]), motion.distal.shape
    moved, load = np.zeros((samples, n)), np.zeros((samples, m))
    if end_given:
        given = np.column_stack([_with_zero(run, name, rig) for name in motion.names])
        free = Coordinates(np.zeros((n, m)), np.ones(m), np.zeros((m, 2)), motion.names)
        return given @ motion.distal.T, free, load
    if rig.end.kind == "joint" and "joint_torque_Nm" in run:
        load[:, 0] = _with_zero(run, "joint_torque_Nm", rig)
    return moved, motion, load


def _with_motor(laws: Coordinates, arms: Vector) -> tuple[Coordinates, Matrix]:
    """Add the angle of a motor whose torque is given to the coordinates."""
    n, m = laws.distal.shape
    if laws.friction > 0.0:
        raise SettingsError(
            f"end.friction_Nm is {laws.friction:g}: friction of a joint acts where an angle, displacement "
            "or tension drives, not a torque"
        )
    proximal = np.column_stack([np.zeros((n, m)), arms])
    distal = np.column_stack([laws.distal, np.zeros(n)])
    gravity = np.vstack([laws.gravity, np.zeros((1, 2))])
    return Coordinates(
        distal, np.append(laws.stiffness, 0.0), gravity, (*laws.names, "motor_angle_rad")
    ), proximal


def _channels(
    machine: Machine,
    run: Mapping[str, Vector],
    ends: np.ndarray,
    where: Matrix,
    motor: Vector | None,
    balance: Vector | None,
) -> dict[str, Vector]:
    """Return what each channel reads, zeros, gains and lags of its sensor included; docs/model.md (178).

    `balance` [m] is f of (173) where the coordinates are given, so that what acts on them is an outcome.
    """
    n, rig, motion = machine.count, machine.rig, machine.coordinates
    out = dict[str, Vector]()
    for row, name in enumerate(("tension_in_N", "tension_out_N", "displacement_in_m", "displacement_out_m")):
        for which, channel in enumerate(numbered(name, n)):
            out[channel] = ends[:, which, row]
    if n == 1:
        out["elongation_m"] = out["displacement_in_m"] - out["displacement_out_m"]
    if motor is not None:
        out["motor_angle_rad"] = motor
        arms = per_motor_angle(rig.drive, n)
        pulled = ends[:, :, 0] @ arms
        if rig.end.kind == "carried":
            pulled = pulled - ends[:, :, 1] @ arms
        out["motor_torque_Nm"] = pulled + rig.drive.friction_Nm * direction(motor)
        if rig.drive.torque_constant_Nm_per_A > 0.0:
            out["motor_current_A"] = out["motor_torque_Nm"] / rig.drive.torque_constant_Nm_per_A
    if balance is not None:
        angles = np.column_stack([_with_zero(run, name, rig) for name in motion.names])
        turn = angles + motion.gravity[:, 1]
        weight = motion.gravity[:, 0] * (np.sin(turn) - np.sin(motion.gravity[:, 1]))
        torque = ends[:, :, 1] @ motion.distal - balance - angles * motion.stiffness - weight
        if motion.friction > 0.0:
            torque = torque - motion.friction * direction(angles[:, 0])[:, None]
    else:
        angles, torque = where[:, : motion.distal.shape[1]], None
    if rig.end.kind == "joint":
        out["joint_angle_rad"] = play(angles[:, 0], rig.end.play_rad)
        if torque is not None:
            out["joint_torque_Nm"] = torque[:, 0]
    if rig.end.kind == "segment":
        out["bending_x_rad"], out["bending_y_rad"] = angles.T
        out["tip_x_m"], out["tip_y_m"], out["tip_z_m"] = tip(angles, rig.end).T
    spans = np.diff(run["time_s"], prepend=run["time_s"][0])
    return {name: _read(values, rig.sensors.get(name), spans) for name, values in out.items()}


def direction(values: Vector) -> Vector:
    """Return which way a motor went last at each sample [s]: 1, −1, or 0 before its first motion."""
    steps = np.diff(values, prepend=values[0])
    way = np.where(np.abs(steps) > _STILL, np.sign(steps), 0.0)
    last = np.maximum.accumulate(np.where(way != 0.0, np.arange(len(way)), 0))
    return way[last]


def _as_driven(run: Mapping[str, Vector], channel: str, lag: float) -> Vector:
    """Return a drive on the clock of what answers; the last of a late record is taken to stay; (178)."""
    return np.interp(run["time_s"] + lag, run["time_s"], run[channel]) if lag else run[channel]


def _with_zero(run: Mapping[str, Vector], channel: str, rig: Rig) -> Vector:
    """Return a channel without its zero and gain; nothing where the run does not have it."""
    if channel not in run:
        return np.zeros(len(run["time_s"]))
    values, sensor = run[channel], rig.sensors.get(channel)
    return values if sensor is None else (values - sensor.zero) / sensor.gain


def _read(values: Vector, sensor: Sensor | None, spans: Vector) -> Vector:
    if sensor is None:
        return values
    if sensor.lag_s > 0.0:
        values = core.lagged(np.ascontiguousarray(values), spans, sensor.lag_s, values[0], values[0])
    return sensor.gain * values + sensor.zero
