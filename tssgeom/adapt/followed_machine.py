"""The mean machine of a filter, and its rig, as streams carry them; docs/model.md (205)."""

from __future__ import annotations

import numpy as np

from tssgeom.adapt.followed_tendon import OnSensedRoute
from tssgeom.adapt.machine_filter import MachineFilter
from tssgeom.core.constants_tendon_rows import MEMORY
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.machine import Machine, MachineState, held_tensions, machine_of, routed
from tssgeom.tendon.machine_history import MachineHistory
from tssgeom.tendon.machine_stream import CarriedMachine


class FollowedMachine(OnSensedRoute):
    """What a stream carries of the filter of a machine: it is built anew only where it has changed."""

    def __init__(self, rig: Rig) -> None:
        super().__init__(rig)
        self._machine: Machine | None = None
        self._machine_of: tuple[Rig, Arcs] | None = None

    def state(self, now: MachineFilter, way: int, time: float) -> CarriedMachine:
        """Return the mean machine at a time [s]; `way` is that of its first tendon until it slides."""
        assert self.sensed is not None
        of = self.rig, self.sensed
        last = self._machine_of
        if self._machine is None or last is None or any(a is not b for a, b in zip(of, last, strict=True)):
            self._machine, self._machine_of = machine_of(self.rig, [routed(self.sensed, self.rig)]), of
        return CarriedMachine(self._machine, self.sensed, mean_history(now, self._machine, time), way)


def mean_history(now: MachineFilter, machine: Machine, time: float) -> MachineHistory:
    """Return where the mean of the members of a filter stands."""
    bars, at = len(machine.edge) + 1, now.now
    memory = at.memory.mean(axis=0).reshape(machine.count, -1)
    slip = memory[:, MEMORY.slip * bars : (MEMORY.slip + 1) * bars]
    np.rint(slip, out=slip)
    coordinate = at.coordinate.mean(axis=0)
    motor, joint, lags = now.sensors.with_block(at.block).means()
    held = held_tensions(machine)[:, [0, -1]]
    return MachineHistory(
        MachineState(memory, coordinate),
        held,
        now.drive,
        time,
        time,
        now.motor(motor),
        None if np.isnan(joint) else now.joint._replace(value=float(coordinate[0]), engaged=joint),
        lags,
    )
