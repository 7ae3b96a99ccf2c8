"""Whole runs of machines: the channel that drives, what acts at the end, and what every sensor reads.

Source: docs/model.md (171)-(178).
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace as changed

from tssgeom.arrays import Matrix, Vector
from tssgeom.channel_names import numbered
from tssgeom.errors import FitError, SettingsError
from tssgeom.mechanism import HOLDS, Coordinates, per_motor_angle
from tssgeom.rig import Rig
from tssgeom.tendon.bars.sensors import play
from tssgeom.tendon.machine import (
    Acts,
    Machine,
    MachineState,
    MachineTrace,
    Start,
    begin,
    carry_on,
    carry_on_beside,
    held_tensions,
)
from tssgeom.tendon.machine_channels import read_channels, without_zero
from tssgeom.tendon.machine_history import (
    GIVEN_DRIVES,
    DriveName,
    MachineHistory,
    engaged_of,
    turned,
)


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


def current_notes(channels: Container[str], rig: Rig) -> tuple[str, ...]:
    """Return that a current is not used where there is one that no torque follows from."""
    unused = "motor_current_A" in channels and "motor_torque_Nm" not in channels
    if not unused or rig.drive.torque_constant_Nm_per_A > 0.0:
        return ()
    return ("motor_current_A is not used: give drive.torque_constant_Nm_per_A",)


class MachineRun(NamedTuple):
    """A whole run: what every channel would read, and the tension along the tendons."""

    channels: dict[str, Vector]
    """[s] By name."""
    tension: np.ndarray
    """[s, n, bars + 2] Tension of each bar where asked for, else no rows [N]."""
    history: MachineHistory
    """Where the run leaves the machine."""


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


class Simulation(NamedTuple):
    """A machine before a run, and what its channels need of the run beside what its tendons do."""

    acts: Acts
    run: Mapping[str, Vector]
    """What was measured, drives on the clock of what answers."""
    motor: Vector | None
    """[s] Angle of the motor, where it is given or sought [rad]."""
    engaged: Vector | None
    """[s] The same behind its play [rad]."""
    recent: Matrix | None
    """As in `MachineHistory`."""
    before: MachineHistory
    end_given: bool


def simulated(
    machine: Machine,
    run: Mapping[str, Vector],
    *,
    drive: DriveName | None = None,
    end_given: bool = False,
    start: Start | None = None,
    profile: bool = False,
    before: MachineHistory | None = None,
) -> MachineRun:
    """Do as `simulate_machine`, and return the tension along every tendon too where a `profile` is wanted.

    With what was `before` the run goes on from there: `start` and `drive` are those of its beginning.
    """
    about = simulation(machine, run, drive=drive, end_given=end_given, start=start, before=before)
    return _marched(about, profile=profile)


def simulated_channels(about: Simulation) -> dict[str, Vector]:
    """Return what every channel reads; raises FitError where there is no equilibrium."""
    return _marched(about, profile=False).channels


def simulated_beside(every: Sequence[Simulation]) -> list[dict[str, Vector] | None]:
    """Return the channels of a run, and of others to first order in how they differ from it; (298).

    They differ in their numbers alone. None where one has no finite answer, or the first no equilibrium.
    """
    done, traces = carry_on_beside([each.acts for each in every])
    return [
        _finished(about, *trace).channels
        if done == len(trace[0].coordinate) and np.isfinite(trace[0].ends).all()
        else None
        for about, trace in zip(every, traces, strict=True)
    ]


def simulation(
    machine: Machine,
    run: Mapping[str, Vector],
    *,
    drive: DriveName | None = None,
    end_given: bool = False,
    start: Start | None = None,
    before: MachineHistory | None = None,
) -> Simulation:
    """Return what acts on a machine in a run; arguments and errors as of `simulate_machine`."""
    run = with_torque(run, machine.rig)
    if before is None:
        before = begun(machine, drive or drive_of(run, machine.count), run["time_s"], start)
    name, rig, time = before.drive, machine.rig, run["time_s"]
    driven, recent = on_clock(run, before.recent, _driving(run, name, machine), rig.drive.lag_s)
    run = {**run, **driven}
    motor, engaged, given = _given(machine, run, before)
    moved, laws, load = _end(run, machine.coordinates, rig, end_given)
    if rig.end.kind == "carried":
        if name not in ("motor_angle_rad", "displacement_in"):
            raise SettingsError(
                f'end.kind is "carried": {name} cannot drive, give an angle or a displacement'
            )
        moved = given
    proximal = np.zeros_like(laws.distal)
    if name == "motor_torque_Nm":
        laws, proximal = _with_motor(laws, per_motor_angle(rig.drive, machine.count))
        load = np.column_stack([load, -without_zero(run, name, rig)])
    acts = Acts(
        machine,
        before.state,
        laws,
        proximal,
        laws.distal.T @ before.held[:, 1] - proximal.T @ before.held[:, 0],
        by_force=name == "tension_in",
        spans=np.diff(time, prepend=before.time),
        given=given,
        moved=moved,
        load=load,
    )
    return Simulation(acts, run, motor, engaged, recent, before, end_given)


def _marched(about: Simulation, *, profile: bool) -> MachineRun:
    done, trace, after = carry_on(about.acts, profile=profile)
    if done < len(trace.coordinate):
        at = about.run["time_s"][done]
        hint, rig = "thin the run less", about.acts.machine.rig
        if about.before.drive == "tension_in" and rig.end.kind == "weight":
            weight = rig.tendon.pretension_N
            hint = (
                f"T_in has to hold the weight of {weight:g} N, or give --tension-in as large, or a position"
            )
        raise FitError(f"there is no equilibrium of the machine at {at:g} s: {hint}")
    return _finished(about, trace, after)


def _finished(about: Simulation, trace: MachineTrace, after: MachineState) -> MachineRun:
    motor, engaged, before = about.motor, about.engaged, about.before
    if before.drive == "motor_torque_Nm":
        motor = engaged = trace.coordinate[:, -1]
    history = before._replace(state=after, time=float(about.run["time_s"][-1]), recent=about.recent)
    if motor is not None and engaged is not None:
        history = history._replace(motor=turned(motor, engaged, before.motor))
    channels, history = read_channels(
        about.acts.machine, about.run, trace, motor, history, before, end_given=about.end_given
    )
    return MachineRun(channels, trace.tension, history)


def begun(machine: Machine, drive: DriveName, time: Vector, start: Start | None = None) -> MachineHistory:
    """Return a machine before the first of some samples [s]."""
    held = held_tensions(machine, start)
    state, first = begin(machine, held), time[0]
    if drive == "motor_torque_Nm":
        state = state._replace(coordinate=np.append(state.coordinate, 0.0))
    begin_time = 2.0 * first - time[1] if len(time) > 1 else first - 1.0
    return MachineHistory(state, held[:, [0, -1]], drive, float(begin_time), float(first))


def _driving(run: Mapping[str, Vector], drive: DriveName, machine: Machine) -> tuple[str, ...]:
    """Return the channels that drive, all of which the run has."""
    names = drive_channels(drive, machine.count)
    if missing := [name for name in names if name not in run]:
        raise SettingsError(f"there is no {missing[0]}, which drove before: give it, or begin anew")
    return names


def _given(
    machine: Machine, run: Mapping[str, Vector], before: MachineHistory
) -> tuple[Vector | None, Vector | None, Matrix]:
    """Return what the drives do [s, n] [m] or [N], after the angle of a motor before and behind its play."""
    rig, name, arms = machine.rig, before.drive, per_motor_angle(machine.rig.drive, machine.count)
    if name.startswith("motor") and not arms.any():
        raise SettingsError(
            f"drive.radius_m is {rig.drive.radius_m:g}: {name} needs the pulley's radius, > 0 m"
        )
    if name == "motor_torque_Nm":
        return None, None, np.zeros((len(run["time_s"]), machine.count))
    if name == "motor_angle_rad":
        motor = without_zero(run, name, rig)
        engaged = play(motor, rig.drive.play_rad, engaged_of(before.motor))
        return motor, engaged, np.outer(engaged, arms)
    given = np.column_stack([without_zero(run, each, rig) for each in _driving(run, name, machine)])
    return None, None, np.maximum(given, 0.0) if name == "tension_in" else given


def _end(
    run: Mapping[str, Vector], motion: Coordinates, rig: Rig, end_given: bool
) -> tuple[Matrix, Coordinates, Matrix]:
    """Return how each load is moved [s, n] [m], the laws of the coordinates, and what acts on them [s, m]."""
    samples, (n, m) = len(run["time_s"]), motion.distal.shape
    moved, load = np.zeros((samples, n)), np.zeros((samples, m))
    if end_given:
        given = np.column_stack([without_zero(run, name, rig) for name in motion.names])
        free = Coordinates(np.zeros((n, m)), np.ones(m), np.zeros((m, HOLDS)), motion.names)
        return given @ motion.distal.T, free, load
    if rig.end.kind == "joint" and "joint_torque_Nm" in run:
        load[:, 0] = without_zero(run, "joint_torque_Nm", rig)
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
    holds = np.vstack([laws.holds, np.zeros((1, HOLDS))])
    return Coordinates(
        distal, np.append(laws.stiffness, 0.0), holds, (*laws.names, "motor_angle_rad")
    ), proximal


def on_clock(
    run: Mapping[str, Vector], before: Matrix | None, names: Sequence[str], lag: float
) -> tuple[dict[str, Vector], Matrix | None]:
    """Return drives on the clock of what answers, and what was recorded of them that acts later; (178).

    What is recorded too late is taken to stay.
    """
    if lag == 0.0:
        return {}, None
    recorded = np.column_stack([run["time_s"], *(run[name] for name in names)])
    if before is not None:
        recorded = np.vstack([before, recorded])
    at = run["time_s"] + lag
    driven = {name: np.interp(at, recorded[:, 0], recorded[:, i]) for i, name in enumerate(names, start=1)}
    acted = np.searchsorted(recorded[:, 0], at[-1], side="right")
    return driven, recorded[max(acted - 1, 0) :]


def with_pending(machine: Machine, history: MachineHistory, time: float) -> MachineHistory:
    """Return a machine once all has acted that its drive has recorded until a time [s]; (178)."""
    lag, recent = machine.rig.drive.lag_s, history.recent
    if recent is None or not (later := recent[:, 0] > time + lag).any():
        return history
    at_once = changed(machine.rig, drive=changed(machine.rig.drive, lag_s=0.0))
    run = dict(zip(drive_channels(history.drive, machine.count), recent[later, 1:].T, strict=True))
    run["time_s"] = recent[later, 0] - lag
    return simulated(replace(machine, rig=at_once), run, before=history._replace(recent=None)).history
