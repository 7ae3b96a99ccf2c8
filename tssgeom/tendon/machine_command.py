"""The drives that bring the end of a machine where it is wanted, its history kept; docs/model.md (184)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants_tendon import SOLVER
from tssgeom.core.constants_tendon_rows import HELD
from tssgeom.errors import SettingsError
from tssgeom.mechanism import NO_LIMITS, per_motor_angle
from tssgeom.rig import Rig
from tssgeom.tendon.bars.plant import Memory
from tssgeom.tendon.bars.sensors import behind_play
from tssgeom.tendon.command import DEAD_ZONE
from tssgeom.tendon.machine import Machine, MachineState, MachineTrace, begin, held_tensions
from tssgeom.tendon.machine_history import MachineHistory, Turning
from tssgeom.tendon.machine_limits import within_limits
from tssgeom.tendon.machine_search import COMMAND, Sample
from tssgeom.tendon.machine_target import Following, following, outputs_of

MayWait = Callable[[Vector, Vector], bool]
"""Says of outputs that miss their targets by [d], the inputs held at [c], whether they may stay there."""


class NextCommand(NamedTuple):
    """What the drives have to do for one target, and what then happens."""

    inputs: Vector
    """[c] Angle of the motor [rad], or position of each drive [m]."""
    engaged: float | None
    """Angle of the motor behind its play [rad]; None without a motor."""
    outputs: Vector
    """[d] What sensors of the outputs get to, a joint's behind the play of the end."""
    reached: bool
    """Whether the drives can reach the target; limits and policy may keep them from it."""
    trace: MachineTrace
    state: MachineState
    limited: str = ""
    """Limits of the drive that cut it, by their keys in `[drive] limits`."""
    waits: bool = False
    """Whether the drives are held inside the dead zone."""


class MachineCommands(NamedTuple):
    """What the drives have to do, and what then happens."""

    follows: Following
    inputs: Matrix
    """[s, c] Angle of the motor [rad], or position of each drive [m]."""
    outputs: Matrix
    """[s, d] What the end does."""
    ends: np.ndarray
    """[s, n, 4] T_in, T_out [N], x_in, x_out [m] of each tendon."""
    reached: np.ndarray
    """[s] Whether the end gets where it is wanted."""
    limited: tuple[str, ...]
    """[s] Limits of the drive that cut the command."""
    waits: np.ndarray
    """[s] Whether the drives are held inside the dead zone."""


def command_machine(
    machine: Machine,
    time: Vector,
    targets: Mapping[str, Vector],
    load: Vector | None = None,
    may_wait: Sequence[MayWait] = (),
) -> MachineCommands:
    """Return what brings the end of a machine where it is wanted; docs/model.md (184), (341).

    Parameters
    ----------
    machine
        One tendon or a pair on a motor, or tendons with a drive each.
    time
        [s] Increasing [s].
    targets
        [s] By the channel that follows: of a joint `joint_angle_rad`, of a segment `bending_x_rad` and
        `bending_y_rad`, of a blocked end `tension_out_1_N` and so on, of a weight `displacement_out_m`.
    load
        [s] Torque against a joint [N·m]; none where left out.
    may_wait
        [s] Say whether drives inside the dead zone may be held there; it is crossed at once where left out.

    Raises
    ------
    SettingsError
        Where nothing of that follows a target in the rig.
    """
    follows = following(machine.rig, targets)
    none = np.zeros(len(time))
    wanted = np.column_stack([targets.get(each, none) for each in follows.outputs])
    resisting = none if load is None else load
    held = held_tensions(machine)
    spans = np.diff(time, prepend=2.0 * time[0] - time[1] if len(time) > 1 else time[0] - 1.0)
    state, begun = begin(machine, held), float(time[0] - spans[0])
    rest = Turning(0.0, 0.0, 0.0) if follows.by_motor else None
    at = MachineHistory(state, held[:, [0, -1]], follows.drive, begun, float(time[0]), rest)
    done = list[NextCommand]()
    for k in range(len(time)):
        span = float(spans[k])
        now = next_command(
            *(machine, at, follows, span, float(resisting[k]), wanted[k], span if k else 0.0),
            may_wait=may_wait[k] if may_wait else None,
        )
        motor = None if now.engaged is None else Turning(float(now.inputs[0]), 0.0, now.engaged)
        joint = Turning(float(now.state.coordinate[0]), 0.0, float(now.outputs[0]))
        at = at._replace(state=now.state, time=float(time[k]), motor=motor, joint=joint)
        done.append(now)
    return MachineCommands(
        follows,
        np.array([one.inputs for one in done]),
        np.array([one.outputs for one in done]),
        np.array([one.trace.ends[0] for one in done]),
        np.array([one.reached for one in done]),
        tuple(one.limited for one in done),
        np.array([one.waits for one in done]),
    )


def next_command(
    machine: Machine,
    history: MachineHistory,
    follows: Following,
    span: float,
    load: float,
    target: Vector,
    elapsed: float,
    may_wait: MayWait | None = None,
) -> NextCommand:
    """Return what brings the end where it is wanted, from where a machine stands; docs/model.md (184), (219).

    Parameters
    ----------
    machine, history
        The machine, and where it stands.
    follows
        What follows the target, and what is commanded.
    span
        How long the step lasts [s].
    load
        What acts against a joint [N·m].
    target
        [d] Where the outputs are wanted.
    elapsed
        Time since the drives were where they are [s], for the limit of their speed.
    may_wait
        Says whether drives inside the dead zone may be held there.

    Raises
    ------
    SettingsError
        Where another quantity than a position drove before.
    """
    if history.drive not in ("motor_angle_rad", "displacement_in"):
        given = "motor_angle_rad or displacement_in" if follows.by_motor else "displacement_in"
        raise SettingsError(f"{history.drive} drives: a target needs {given} instead")
    drives = _Drives(machine.rig, follows, history)
    balance = machine.coordinates.distal.T @ history.held[:, 1]
    end = _EndPlay(machine.rig, history)
    at = Sample(*(machine, history.state, balance, follows, drives.base, span, load), end.inner(target))
    near = drives.near
    freedom, trace, state, reached = at.solved(near)
    moves = bool((freedom != near).any())
    if moves and may_wait is not None and _is_dead(at, drives, freedom):
        outputs, held, stays = at.going_to(at.drives(near))
        if may_wait(end.read(outputs) - target, drives.was):
            return NextCommand(
                *(drives.was, drives.engaged(drives.was), end.read(outputs), reached, held, stays), waits=True
            )
    inputs, limited = drives.inputs(freedom), ""
    outputs = outputs_of(follows, state)
    if machine.rig.drive.limits != NO_LIMITS:
        inputs, limited = drives.within_limits(at, inputs, freedom, elapsed)
    if limited:
        outputs, trace, state = at.going_to(drives.moved(inputs))
    return NextCommand(inputs, drives.engaged(inputs), end.read(outputs), reached, trace, state, limited)


class _Drives:
    """The drives of a machine as a history left them: one motor behind its play, or one for each tendon."""

    def __init__(self, rig: Rig, follows: Following, history: MachineHistory) -> None:
        self._follows, self._width = follows, rig.drive.play_rad if follows.by_motor else 0.0
        stood = np.array([float(Memory(row).drive[HELD.drive]) for row in history.state.memory])
        self.base = np.zeros(len(stood))
        """[n] What the drives have beside their freedoms [m]."""
        if not follows.by_motor:
            self.near: Vector = np.asarray(np.linalg.pinv(follows.modes) @ stood, float)
            """[k] Freedoms where the drives are."""
            self.base, self.was = stood - follows.modes @ self.near, stood
            """[c] Inputs where the drives are."""
            return
        arm, before = float(per_motor_angle(rig.drive, len(stood))[0]), history.motor
        self.near = np.array([stood[0] / arm if before is None else before.engaged])
        self.was = self.near if before is None else np.array([before.value])

    def inputs(self, freedom: Vector) -> Vector:
        """Return the inputs [c] that have freedoms [k]."""
        if not self._follows.by_motor:
            return self.base + self._follows.modes @ freedom
        if freedom[0] == self.near[0]:
            return self.was
        return freedom - self._width * (freedom < self.near)

    def engaged(self, inputs: Vector) -> float | None:
        """Return the angle of the motor behind its play with inputs [c] [rad]; None without a motor."""
        if not self._follows.by_motor:
            return None
        return float(behind_play(inputs[0], self._width, self.near[0]))

    def moved(self, inputs: Vector) -> Vector:
        """Return where the drives are with inputs [c]: [n] [m]."""
        engaged = self.engaged(inputs)
        return inputs if engaged is None else self._follows.modes[:, 0] * engaged

    def within_limits(
        self, at: Sample, inputs: Vector, freedom: Vector, elapsed: float
    ) -> tuple[Vector, str]:
        """Return the inputs [c] that keep to the limits of the drives, and the names of what cuts them."""
        rows, of_motor = self._follows.modes, self._follows.by_motor

        def inputs_of(free: Vector) -> Vector:
            return free if of_motor else self.base + rows @ free

        def pull(free: Vector) -> float:
            trace = at.at(self.moved(inputs_of(free)))[1]
            return math.inf if trace is None else float(trace.ends[0, :, 0].max())

        limits = at.machine.rig.drive.limits
        if of_motor:  # its angle itself is limited, by the first drive
            wanted, was, rows, base = inputs, self.was, rows[:1], self.base[:1]
        else:
            wanted, was, base = freedom, self.near, self.base
        kept, cut = within_limits(limits, wanted, was, rows, base, elapsed, pull)
        return (inputs_of(kept) if cut else inputs), cut

    def crosses_play(self, freedom: Vector) -> bool:
        """Whether the motor has some of its play to cross on its way to a freedom."""
        if not self._follows.by_motor:
            return False
        near, way = float(self.near[0]), math.copysign(1.0, freedom[0] - self.near[0])
        return way * (near - float(self.was[0])) + max(-way, 0.0) * self._width > SOLVER.accepted


class _EndPlay:
    """The play between a joint and its sensor, as a history left it; docs/model.md (59)."""

    def __init__(self, rig: Rig, history: MachineHistory) -> None:
        self._width = rig.end.play_rad if rig.end.kind == "joint" else 0.0
        self._joint = float(history.state.coordinate[0])
        self._engaged = self._joint if history.joint is None else history.joint.engaged

    def read(self, outputs: Vector) -> Vector:
        """Return what sensors read of outputs."""
        if self._width == 0.0:
            return outputs
        return behind_play(outputs[:1], self._width, self._engaged)

    def inner(self, target: Vector) -> Vector:
        """Return where the joint has to be for a reading [rad]."""
        if self._width == 0.0:
            return target
        if abs(target[0] - self._engaged) <= SOLVER.accepted:
            return np.array([self._joint])
        return target - self._width * (target < self._engaged)


def _is_dead(at: Sample, drives: _Drives, freedom: Vector) -> bool:
    """Whether the end does not follow the drives towards freedoms at first, or has a play to cross."""
    if drives.crosses_play(freedom):
        return True
    way, near = freedom - drives.near, drives.near
    step = min(COMMAND.first / float(np.linalg.norm(way)), 1.0) * way
    by = at.at(at.drives(near + step))[0] - at.at(at.drives(near))[0]
    return not np.linalg.norm(by) > max(DEAD_ZONE * np.linalg.norm(at.follows.free @ step), SOLVER.accepted)
