"""What the channels of a run of a machine would read; docs/model.md (180), (298)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.errors import FitError
from tssgeom.identify.machine_run import MachineRun
from tssgeom.identify.turning import with_turns
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.machine import Machine, Start, machine_of, routed
from tssgeom.tendon.machine_simulation import (
    Simulation,
    drive_channels,
    simulated_beside,
    simulated_channels,
    simulation,
)


def predicted(
    run: MachineRun, rig: Rig, values: Mapping[tuple[str, str], float], bars: int
) -> dict[str, Vector]:
    """Return what each answering channel would have read [s]; `values` are those of the run, by kind, key."""
    return Machines(rig, bars).predicted(run, values)


class Machines:
    """A rig on the routes of runs, each made once."""

    def __init__(self, rig: Rig, bars: int) -> None:
        self.rig, self.bars, self._made = rig, bars, dict[tuple[object, ...], Machine]()

    def predicted(self, run: MachineRun, values: Mapping[tuple[str, str], float]) -> dict[str, Vector]:
        """Do as `predicted`."""
        return _read(run, values, simulated_channels(self.simulation(run, values)))

    def simulation(self, run: MachineRun, values: Mapping[tuple[str, str], float]) -> Simulation:
        """Return the machine before a run with its own numbers."""
        machine = self._on(run.routes, [values.get(("route", str(k)), 1.0) for k in range(len(run.routes))])
        shares = np.array([values.get(("history", str(which)), 0.0) for which in range(machine.count)])
        given = dict(run.given)
        if run.legs is not None:
            shifts = np.array([values.get(("turn", str(turn)), 0.0) for turn in range(len(run.legs.turns))])
            given[drive_channels(run.drive, run.tendons)[0]] = with_turns(run.legs, shifts)
        for (kind, channel), zero in values.items():
            if kind == "given zero":
                given[channel] = given[channel] - zero
        return simulation(machine, given, drive=run.drive, end_given=run.end_given, start=Start(shares))

    def _on(self, routes: Sequence[Arcs], scales: Sequence[float]) -> Machine:
        """Return the rig on some routes, their angles times a factor each."""
        which = tuple((arcs.length.tobytes(), arcs.angle.tobytes()) for arcs in routes), *scales
        if which not in self._made:
            scaled = [arcs.scaled(angle=by) for arcs, by in zip(routes, scales, strict=True)]
            self._made[which] = machine_of(self.rig, [routed(arcs, self.rig) for arcs in scaled], self.bars)
        return self._made[which]


def predicted_beside(
    run: MachineRun, every: Sequence[tuple[Simulation, Mapping[tuple[str, str], float]]]
) -> list[dict[str, Vector] | None]:
    """Return what each answering channel would have read with the numbers of the first, and beside it."""
    channels = simulated_beside([about for about, _ in every])
    pairs = zip(every, channels, strict=True)
    return [None if out is None else _read(run, values, out) for (_, values), out in pairs]


def _read(
    run: MachineRun, values: Mapping[tuple[str, str], float], channels: Mapping[str, Vector]
) -> dict[str, Vector]:
    """Return the channels that answer, with zeros and bends of a run."""
    read = {name: channels[name] + values.get(("zero", name), 0.0) for name in run.measured}
    for key, change in run.bends.items():
        if by := values.get(("bends", key), 0.0):
            read = {name: value + by * change[name] for name, value in read.items()}
    return read


def halved(most: int, least: int) -> Iterator[int]:
    """Yield most bars, half of them, and so on, to no fewer than twice the least; docs/model.md (300)."""
    while most >= 2 * least:
        yield most
        most //= 2


def finely_predicted(
    run: MachineRun, rig: Rig, values: Mapping[tuple[str, str], float], most: int, least: int
) -> dict[str, Vector]:
    """Return what `predicted` does with most bars, or half of them until there is an equilibrium."""
    for bars in halved(most, least):
        with suppress(FitError):
            return predicted(run, rig, values, bars)
    return predicted(run, rig, values, least)
