"""Tendons that pull one mechanism together: pairs, loops, joints and segments; docs/model.md (171)-(178)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.core.constants_tendon_rows import LAW, PLANT
from tssgeom.effects.laws import OF_JOINT, table
from tssgeom.errors import SettingsError
from tssgeom.mechanism import Coordinates, coordinates
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import discretise, equal_edges
from tssgeom.tendon.bars.model import check_compliance, setup_of
from tssgeom.tendon.bars.plant import Memory, Plant, crept, memory_of, plant
from tssgeom.tendon.state import HALVINGS

BARS = 16
"""Bars of each tendon, the outermost ones halved: a held end is known to half of the last bar."""


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
    setup = replace(setup_of(rig), load_friction_N=0.0)  # a joint has its own
    law = next((table(each) for each in setup.curves if each.table == OF_JOINT), None)
    motion = coordinates(rig.drive, rig.end, rig.load.stiffness_N_per_m, law)
    count = len(motion.distal)
    if len(routes) not in (1, count):
        raise SettingsError(f"{len(routes)} routes for {count} tendons: give one for all, or one each")
    check_compliance(rig.tendon.compliance_per_N)
    edge = equal_edges(bars, HALVINGS, HALVINGS)
    plants = []
    for arcs in routes:
        made = plant(setup, arcs, edge)
        soft = made.rows[LAW.soft]
        inside, outside = float(soft[1:-1].sum()), np.array([soft[1], soft[-2]])
        share = inside / (inside + float(outside.sum()))  # the bars at both ends are not longer for it
        soft[1:-1] *= share
        soft[0] = setup.series_in_m_per_N + share * outside[0]
        soft[-1] = setup.series_out_m_per_N + share * outside[1]
        made.rows[LAW.rest] = made.stretch(float(setup.pretension))
        made.set(PLANT.load, math.inf)
        made.set(PLANT.swift, 0.0)
        plants.append(made)
    alike = count // len(routes)  # tendons on each route
    return Machine(rig, tuple(routes) * alike, edge, tuple(plants) * alike, motion)


class MachineState(NamedTuple):
    """Where the tendons and the coordinates of a machine stand."""

    memory: Matrix
    """[n, …] Memory of each tendon, as the core keeps it."""
    coordinate: Vector
    """[m] Coordinates of its end [rad] or [m]."""


class MachineTrace(NamedTuple):
    """What a machine did in some samples."""

    ends: np.ndarray
    """[s, n, 4] T_in, T_out [N], x_in, x_out [m] of each tendon."""
    coordinate: Matrix
    """[s, m] Coordinates [rad] or [m]."""
    tension: np.ndarray
    """[s, n, bars + 2] Tension of each bar where asked for, else no rows [N]."""


def begin(machine: Machine, held: Matrix) -> MachineState:
    """Return a machine at the beginning of a run, with the tensions `held` [n, bars + 2] [N]."""
    return MachineState(_memories(machine, held), np.zeros(len(machine.coordinates.stiffness)))


class Acts(NamedTuple):
    """A machine before some samples, and what acts on it in them; docs/model.md (171)."""

    machine: Machine
    state: MachineState
    laws: Coordinates
    proximal: Matrix
    """[n, m] How far each drive moves with each coordinate."""
    balance: Vector
    """[m] f of (173)."""
    by_force: bool
    spans: Vector
    """[s] Time since the sample before [s]."""
    given: Matrix
    """[s, n] What the drives do [m] or [N]."""
    moved: Matrix
    """[s, n] What moves the loads besides [m]."""
    load: Matrix
    """[s, m] What acts on the coordinates."""


def carry_on(acts: Acts, *, profile: bool = False) -> tuple[int, MachineTrace, MachineState]:
    """Take a machine through some samples; returns how many could be, what it did, and where it stands."""
    machine, laws, samples = acts.machine, acts.laws, len(acts.spans)
    done, memory, where, ends, tension = core.march_machine(
        len(machine.edge),
        np.array([each.block for each in machine.plants]),
        acts.state.memory,
        acts.proximal,
        laws.distal,
        laws.stiffness,
        laws.holds,
        np.full(len(laws.stiffness), laws.friction),
        acts.balance,
        acts.state.coordinate,
        acts.by_force,
        acts.spans,
        acts.given,
        acts.moved,
        acts.load,
        np.zeros(samples),
        samples if profile else 0,
    )
    trace = MachineTrace(
        ends.reshape(samples, machine.count, 4),
        where,
        tension.reshape(len(tension), machine.count, len(machine.edge) + 1),
    )
    return done, trace, MachineState(memory, where[-1])


def carry_on_beside(every: Sequence[Acts]) -> tuple[int, list[tuple[MachineTrace, MachineState]]]:
    """Take a machine through some samples as `carry_on`, and others that differ little beside it; (298).

    Returns how many samples the first could be taken through, and what each did, to first order in how it
    differs from the first; NaN where it has no finite answer.
    """
    first, count = every[0], len(every)
    machine, samples, m = first.machine, len(first.spans), len(first.laws.stiffness)
    blocks = {id(each.machine): _blocks(each.machine) for each in every}

    def rows(values: Iterable[Matrix]) -> Matrix:
        return np.array([each.ravel() for each in values])

    done, memory, where, ends = core.march_beside(
        machine.count,
        len(machine.edge),
        np.array([blocks[id(each.machine)] for each in every]),
        rows(each.state.memory for each in every),
        rows(each.proximal for each in every),
        rows(each.laws.distal for each in every),
        np.array([each.laws.stiffness for each in every]),
        rows(each.laws.holds for each in every),
        np.array([each.laws.friction for each in every]),
        np.array([each.balance for each in every]),
        np.array([each.state.coordinate for each in every]),
        first.by_force,
        first.spans,
        rows(each.given for each in every),
        rows(each.moved for each in every),
        rows(each.load for each in every),
        np.zeros(samples),
    )
    where, none = where.reshape(count, samples, m), np.zeros((0, machine.count, len(machine.edge) + 1))
    ends, memory = ends.reshape(count, samples, machine.count, 4), memory.reshape(count, machine.count, -1)
    return done, [
        (MachineTrace(ends[j], where[j], none), MachineState(memory[j], where[j, -1])) for j in range(count)
    ]


def _blocks(machine: Machine) -> Vector:
    return np.concatenate([each.block for each in machine.plants])


def routed(arcs: Arcs, rig: Rig) -> Arcs:
    """Return a route with the length and angle of the rig file, which have no error there."""
    given = rig.route
    if given.bends:
        return route_of_rig(rig).scaled(angle=given.angle_gain)
    if given.length_m is None and given.angle_rad is None:
        return arcs.scaled(angle=given.angle_gain)
    if given.angle_rad is not None and arcs.total_angle == 0.0:
        arcs = replace(arcs, angle=read_only(arcs.length / arcs.total_length))
    length = 1.0 if given.length_m is None else given.length_m / arcs.total_length
    angle = 1.0 if given.angle_rad is None else given.angle_rad / arcs.total_angle
    arcs = arcs.scaled(length, angle * given.angle_gain)
    sensed = np.repeat((given.length_m is None, given.angle_rad is None), len(arcs.length))
    shared = (arcs.form_variance, arcs.model_variance) if given.angle_rad is None else (0.0, 0.0)
    covariance = read_only(arcs.covariance * np.outer(sensed, sensed))
    return replace(arcs, covariance=covariance, form_variance=shared[0], model_variance=shared[1])


def route_of_rig(rig: Rig) -> Arcs:
    """Return the route that the rig gives by itself: bends where it says, or an even one.

    Raises
    ------
    SettingsError
        Where it gives no length or no angle.
    """
    length, angle = rig.route.length_m, rig.route.angle_rad
    if length is None or angle is None:
        raise SettingsError("no shape: give one, or route.length_m and route.angle_rad in the rig")
    share = np.array(rig.route.bends or (1.0,))
    return Arcs.exact(np.full(len(share), length / len(share)), angle * share / share.sum())


def on_routes(machine: Machine, state: MachineState, routes: Sequence[Arcs]) -> tuple[Machine, MachineState]:
    """Move a machine to other routes: each bar keeps its tension, or its slack; docs/model.md (218)."""
    moved = machine_of(machine.rig, routes, len(machine.edge) - 1 - 2 * HALVINGS)
    memory = state.memory.copy()
    shift_rests(memory, machine, moved)
    return moved, state._replace(memory=memory)


def shift_rests(memory: Matrix, before: Machine, now: Machine) -> None:
    """Let memories [n, …] of tendons keep their tensions on the routes of another machine; (218)."""
    for row, one, other in zip(memory, before.plants, now.plants, strict=True):
        each = Memory(row)
        each.rest[:] += other.stretch(each.tension) - other.rows[LAW.rest]
        each.rest[:] -= one.stretch(each.tension) - one.rows[LAW.rest]


def held_tensions(machine: Machine, start: Start | None = None) -> Matrix:
    """Return the tension of every bar when a run begins [n, bars + 2] [N]; docs/model.md (177).

    Without `start` no friction holds the tendons.
    """
    rig, rows, start = machine.rig, [], start or at_rest(machine.count)
    angles = dict[int, Vector]()
    for which, arcs in enumerate(machine.routes):
        if id(arcs) not in angles:
            inside = discretise(machine.edge, arcs).mean_angle
            angles[id(arcs)] = np.concatenate(([0.0], inside, [arcs.total_angle]))
        angle = angles[id(arcs)]
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
        rows.append(memory_of(tension, rest=rest, **crept(each, tension)).block)
    return np.array(rows)
