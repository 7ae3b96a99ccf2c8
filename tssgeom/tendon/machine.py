"""Tendons that pull one mechanism together: pairs, loops, joints and segments; docs/model.md (171)-(178)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants_tendon_rows import LAW, PLANT
from tssgeom.errors import FitError, SettingsError
from tssgeom.mechanism import Coordinates, coordinates, numbered, per_motor_angle, tip
from tssgeom.rig import Rig, Sensor
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import discretise, equal_edges
from tssgeom.tendon.bars.model import check_compliance, setup_of
from tssgeom.tendon.bars.plant import Plant, memory_of, plant

BARS, HALVINGS = 16, 4
"""Bars of each tendon, the outermost ones halved so often: a held end is known to half of the last bar."""
GIVEN_DRIVES = ("motor_angle_rad", "displacement_in", "tension_in", "motor_torque_Nm")
"""What may drive a machine; the first that a run has does. The middle ones are channels of each tendon."""
_STILL = 1e-9  # rad that count as no motion of a motor; derived: beyond rounding, below any encoder's step
DriveName = Literal["motor_angle_rad", "displacement_in", "tension_in", "motor_torque_Nm"]


@dataclass(frozen=True, slots=True)
class Machine:
    """A rig with n tendons, each on its route."""

    rig: Rig
    routes: tuple[Arcs, ...]
    edge: Vector
    """[bars + 1] Where each tendon is cut, as fractions of its length [1]."""
    plants: tuple[Plant, ...]
    coordinates: Coordinates

    @property
    def count(self) -> int:
        """Number of tendons, n."""
        return len(self.routes)


class Start(NamedTuple):
    """Where a machine stands when a run begins; docs/model.md (177)."""

    history: Vector
    """[n] Share of the friction that holds each tendon at the start: 1 as after a pull, −1 as after a
    release, 0 none [1]."""


def at_rest(count: int) -> Start:
    """Return the start of tendons that no friction holds."""
    return Start(np.zeros(count))


def machine_of(rig: Rig, routes: Sequence[Arcs], bars: int = BARS) -> Machine:
    """Return a rig on its routes: one for all tendons, or one each.

    Raises
    ------
    SettingsError
        Where drive, end and routes do not go together, or the tendon does not stretch.
    """
    motion = coordinates(rig.drive, rig.end, rig.load.stiffness_N_per_m)
    count = len(motion.distal)
    if len(routes) not in (1, count):
        raise SettingsError(f"{len(routes)} routes for {count} tendons: give one for all, or one each")
    each = tuple(routes) * (count if len(routes) == 1 else 1)
    check_compliance(rig.tendon.compliance_per_N)
    edge = equal_edges(bars, HALVINGS, HALVINGS)
    setup = setup_of(rig)
    plants = []
    for arcs in each:
        made = plant(setup, arcs, edge)
        soft = made.rows[LAW.soft]
        inside, outside = float(soft[1:-1].sum()), np.array([soft[1], soft[-2]])
        share = inside / (inside + float(outside.sum()))  # the bars at both ends are not longer for it
        soft[1:-1] *= share
        soft[0] = setup.series_in_m_per_N + share * outside[0]
        soft[-1] = setup.series_out_m_per_N + share * outside[1]
        made.rows[LAW.rest] = made.stretch(float(setup.pretension))
        made.block[PLANT.load - len(PLANT)] = math.inf
        made.block[PLANT.swift - len(PLANT)] = 0.0
        plants.append(made)
    return Machine(rig, each, edge, tuple(plants), motion)


def drive_of(run: Mapping[str, Vector], count: int) -> DriveName:
    """Return which channel drives: the first of `GIVEN_DRIVES` that the run has.

    Raises
    ------
    SettingsError
        Where it has none.
    """
    for name in ("motor_angle_rad", "displacement_in", "tension_in", "motor_torque_Nm"):
        if all(channel in run for channel in drive_channels(name, count)):
            return name
    known = ", ".join(channel for name in GIVEN_DRIVES for channel in drive_channels(name, count))
    raise SettingsError(f"the run has no drive: give one of {known}")


def drive_channels(drive: str, count: int) -> tuple[str, ...]:
    """Return the channels of a drive, one for each tendon unless one motor drives all."""
    unit = {"displacement_in": "m", "tension_in": "N"}.get(drive)
    return (drive,) if unit is None else tuple(numbered(f"{drive}_{unit}", count))


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
        Where no equilibrium was found.
    """
    n, motion, rig = machine.count, machine.coordinates, machine.rig
    name = drive or drive_of(run, n)
    time = run["time_s"]
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
    held = held_tensions(machine, start or at_rest(n))
    memories = _memories(machine, held)
    moved, laws, load = _end(run, motion, rig, end_given)
    proximal = np.zeros_like(laws.distal)
    if name == "motor_torque_Nm":
        torque = _with_zero(run, name, rig)
        laws, proximal = _with_motor(laws, arms)
        load = np.column_stack([load, -torque])
    balance = laws.distal.T @ held[:, -1] - proximal.T @ held[:, 0]
    block = np.array([each.block for each in machine.plants])
    done, _, where, ends = core.march_machine(
        len(machine.edge),
        block,
        memories,
        proximal,
        laws.distal,
        laws.stiffness,
        laws.gravity,
        balance,
        np.zeros(len(laws.stiffness)),
        by_force,
        spans,
        given,
        moved,
        load,
        np.zeros(len(time)),
    )
    if done < len(time):
        raise FitError(f"no equilibrium of the machine was found at {time[done]:g} s: thin the run less")
    ends = ends.reshape(len(time), n, 4)
    if name == "motor_torque_Nm":
        motor = where[:, -1]
    return _channels(machine, run, ends, where, motor if name.startswith("motor") else None, end_given)


def play(values: Vector, width: float) -> Vector:
    """Return what a play leaves of a motion [s], engaged for positive motion at the start; (59)."""
    if width <= 0.0:
        return values
    passed, at = np.empty_like(values), float(values[0])
    for i, value in enumerate(values.tolist()):
        at = min(max(at, value), value + width)
        passed[i] = at
    return passed


def held_tensions(machine: Machine, start: Start) -> Matrix:
    """Return the tension of every bar when a run begins [n, bars + 2] [N]; docs/model.md (177)."""
    rig, rows = machine.rig, []
    for which, arcs in enumerate(machine.routes):
        angle = np.concatenate(([0.0], discretise(machine.edge, arcs).mean_angle, [arcs.total_angle]))
        by_friction = rig.friction.coefficient * start.history[which] * (0.5 * arcs.total_angle - angle)
        slack = which == 1 and rig.drive.slack_m > 0.0
        rows.append(
            0.0 * by_friction if slack else machine.plants[0].number(PLANT.pretension) * np.exp(by_friction)
        )
    return np.array(rows)


def _memories(machine: Machine, held: Matrix) -> Matrix:
    rows = []
    for which, (each, tension) in enumerate(zip(machine.plants, held, strict=True)):
        rest = each.stretch(tension) - each.rows[LAW.rest]
        if which == 1:
            rest[0] -= machine.rig.drive.slack_m
        rows.append(memory_of(tension, rest=rest, creep=each.rows[LAW.creep_soft] * tension).block)
    return np.array(rows)


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
    end_given: bool,
) -> dict[str, Vector]:
    """Return what each channel reads, zeros, gains and lags of its sensor included; docs/model.md (178)."""
    n, rig, motion = machine.count, machine.rig, machine.coordinates
    out = dict[str, Vector]()
    for row, name in enumerate(("tension_in_N", "tension_out_N", "displacement_in_m", "displacement_out_m")):
        for which, channel in enumerate(numbered(name, n)):
            out[channel] = ends[:, which, row]
    if motor is not None:
        out["motor_angle_rad"] = motor
        pulled = (ends[:, :, 0] - ends[0:1, :, 0] * 0.0) @ per_motor_angle(rig.drive, n)
        out["motor_torque_Nm"] = pulled + rig.drive.friction_Nm * direction(motor)
        if rig.drive.torque_constant_Nm_per_A > 0.0:
            out["motor_current_A"] = out["motor_torque_Nm"] / rig.drive.torque_constant_Nm_per_A
    if end_given:
        angles = np.column_stack([_with_zero(run, name, rig) for name in motion.names])
        turn = angles + motion.gravity[:, 1]
        weight = motion.gravity[:, 0] * (np.sin(turn) - np.sin(motion.gravity[:, 1]))
        balance = motion.distal.T @ held_tensions(machine, at_rest(n))[:, -1]
        torque = ends[:, :, 1] @ motion.distal - balance - angles * motion.stiffness - weight
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


def _with_zero(run: Mapping[str, Vector], channel: str, rig: Rig) -> Vector:
    """Return what a channel says without its zero and gain; nothing where the run does not have it."""
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
