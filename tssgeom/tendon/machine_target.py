"""What of a machine follows a target, and which drives are commanded for it; docs/model.md (341)."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import lru_cache
from typing import Literal, NamedTuple, TypeVar

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.channel_names import marked, numbered
from tssgeom.core.constants import ROUNDING
from tssgeom.errors import SettingsError
from tssgeom.mechanism import Drive, End, coordinates, per_motor_angle, tendon_count, tip
from tssgeom.rig import Rig
from tssgeom.tendon.bars.plant import Memory
from tssgeom.tendon.machine import MachineState
from tssgeom.tendon.machine_history import DriveName

_Value = TypeVar("_Value")
Role = Literal["target", "command", "reached", "se"]
_OF_ONE_TENDON = {
    ("displacement_out_m", "target"): "displacement_target_m",
    ("displacement_out_m", "reached"): "displacement_reached_m",
    ("tension_out_N", "reached"): "tension_reached_N",
    ("displacement_in_m", "command"): "displacement_command_m",
}
"""Names that one tendon on a spring has for the same."""


class Following(NamedTuple):
    """What follows a target, and what is commanded for that; docs/model.md (341)."""

    outputs: tuple[str, ...]
    """[d] Channels that are wanted somewhere."""
    inputs: tuple[str, ...]
    """[c] Channels that are commanded: the angle of a motor, or the position of each drive."""
    modes: Matrix
    """[n, k] How far each drive moves with 1 of each freedom of the commands [m]."""
    free: Matrix
    """[d, k] How far the outputs move with 1 of each where nothing stretches or rubs; 0 of tensions."""
    rising: Matrix
    """[k, d] Combinations of the outputs that rise with each freedom [1]."""
    tendons: tuple[int, ...] = ()
    """[d] Which tendon each output is the tension of; empty of other outputs."""

    @property
    def by_motor(self) -> bool:
        """Whether a motor turns all drives."""
        return self.inputs == ("motor_angle_rad",)

    @property
    def drive(self) -> DriveName:
        """What drives by the inputs."""
        return "motor_angle_rad" if self.by_motor else "displacement_in"


def following(rig: Rig, wanted: Collection[str]) -> Following:
    """Return what follows a target in a rig; docs/model.md (341).

    Parameters
    ----------
    rig
        The machine.
    wanted
        Channels that have a target.

    Returns
    -------
    Following
        Outputs and inputs, and how they move together.

    Raises
    ------
    SettingsError
        Where nothing of that follows a target in the rig.
    """
    return _following(rig.drive, rig.end, frozenset(wanted))


@lru_cache(maxsize=16)  # a stream asks twice a frame, always the same
def _following(drive: Drive, end: End, wanted: frozenset[str]) -> Following:
    count = tendon_count(drive, end)
    arms = per_motor_angle(drive, count)
    outputs = _outputs(drive, end)
    if not outputs or (end.kind == "joint" and not arms.any()):
        raise SettingsError(
            f'of end.kind = "{end.kind}" with drive.kind = "{drive.kind}" nothing follows a target: a joint '
            "does where a motor turns it (drive.radius_m > 0), and a segment, a blocked end or a weight"
        )
    if not any(each in wanted for each in outputs):
        raise SettingsError(f"no target: give {' or '.join(outputs)}")
    inputs = _inputs(drive, end)
    distal = coordinates(drive, end, 0.0).distal
    absent = [each for each in outputs if each not in wanted]
    if end.kind == "segment" and absent and len(_rows_of(distal).T) == len(outputs):
        raise SettingsError(
            f"{absent[0]} has no target: the tendons bend it too, so give a target, such as 0"
        )
    if end.kind == "blocked":
        tendons = tuple(k for k, each in enumerate(outputs) if each in wanted)
        outputs = tuple(outputs[k] for k in tendons)
        if arms.any() and len(outputs) > 1:
            raise SettingsError(f"one motor, and targets of {' and '.join(outputs)}: give one of them")
        if not arms.any() and len(outputs) < count:
            raise SettingsError(f"each drive needs a target: {', '.join(outputs)} is not enough")
        modes = arms[:, None] if arms.any() else np.eye(count)
        free = np.zeros((len(outputs), modes.shape[1]))
        return Following(outputs, inputs, modes, free, np.sign(modes[list(tendons)]).T, tendons)
    modes = arms[:, None] if arms.any() else distal @ _rows_of(distal)
    free = np.linalg.pinv(distal) @ modes
    rising = free.T / np.maximum(np.linalg.norm(free, axis=0)[:, None], ROUNDING.relative)
    return Following(outputs, inputs, modes, free, rising)


def _rows_of(distal: Matrix) -> Matrix:
    """Return orthonormal directions [m, k] in which tendons move the coordinates of their end."""
    _, sizes, directions = np.linalg.svd(distal)
    rank = int((sizes > ROUNDING.relative * sizes[0]).sum())
    if rank == len(directions):
        return np.eye(rank)
    rows = directions[:rank]
    return (rows * np.sign(rows[np.arange(rank), np.abs(rows).argmax(axis=1)])[:, None]).T


def wanted_of(follows: Following, targets: Mapping[str, float]) -> Vector:
    """Return where the outputs are wanted [d]; one that the tendons cannot bend may be left out, and is 0."""
    return np.array([targets.get(each, 0.0) for each in follows.outputs])


def outputs_of(follows: Following, state: MachineState) -> Vector:
    """Return the outputs [d] of a machine that stands somewhere."""
    if follows.tendons:
        return np.array([float(Memory(state.memory[k]).tension[-1]) for k in follows.tendons])
    return state.coordinate[: len(follows.outputs)]


def possible_outputs(rig: Rig) -> tuple[str, ...]:
    """Return the channels of a machine that may follow a target."""
    return _outputs(rig.drive, rig.end)


def _outputs(drive: Drive, end: End) -> tuple[str, ...]:
    if end.kind == "blocked":
        return tuple(numbered("tension_out_N", tendon_count(drive, end)))
    return {
        "joint": ("joint_angle_rad",),
        "segment": ("bending_x_rad", "bending_y_rad"),
        "weight": ("displacement_out_m",),
    }.get(end.kind, ())


def possible_inputs(rig: Rig) -> tuple[str, ...]:
    """Return the channels that are commanded in a machine: the motor's, or each drive's."""
    return _inputs(rig.drive, rig.end)


def _inputs(drive: Drive, end: End) -> tuple[str, ...]:
    count = tendon_count(drive, end)
    by_motor = per_motor_angle(drive, count).any()
    return ("motor_angle_rad",) if by_motor else tuple(numbered("displacement_in_m", count))


def name_of(channel: str, role: Role) -> str:
    """Return the name of the target, command, reached value or standard error of a channel."""
    return _OF_ONE_TENDON.get((channel, role), marked(channel, role))


def without_targets(readings: Mapping[str, _Value], rig: Rig) -> tuple[dict[str, _Value], dict[str, _Value]]:
    """Return the readings that are measured, and the targets among them by the channel that follows each."""
    names = {name_of(each, "target"): each for each in possible_outputs(rig)}
    targets = {names[name]: value for name, value in readings.items() if name in names}
    return {name: value for name, value in readings.items() if name not in names}, targets


def lever(rig: Rig, target: Vector) -> Matrix:
    """Return how far the end moves with 1 of each output near a target [d, d] [m].

    A joint moves at its lever arm, the marker of a segment across itself where the length of the backbone is
    given, else the tendons at their distance from it. A blocked end, which moves nowhere, has 1 N for 1 N.
    """
    if rig.end.kind in ("weight", "blocked"):
        return np.eye(len(target))
    if rig.end.kind == "joint" or rig.end.length_m + rig.end.marker_m == 0.0:
        return rig.end.radius_m * np.eye(len(target))
    step = ROUNDING.relative ** (1.0 / 3.0)
    slopes = [tip(target + by, rig.end) - tip(target - by, rig.end) for by in step * np.eye(2)[:, None]]
    return np.asarray(np.linalg.qr(np.vstack(slopes).T / (2.0 * step)).R)
