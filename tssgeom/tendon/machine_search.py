"""Where the drives of a machine have to be for a target, from where it stands; docs/model.md (184), (342)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants import ROUNDING
from tssgeom.core.constants_tendon import SOLVER
from tssgeom.errors import SettingsError
from tssgeom.tendon.machine import Acts, Machine, MachineState, MachineTrace, carry_on
from tssgeom.tendon.machine_target import Following, outputs_of


@dataclass(frozen=True, slots=True)
class CommandSettings:
    """How commands are searched for."""

    first: float = 1e-3
    """First step of the search [rad] or [m]; chosen."""
    farthest: float = 100.0
    """Distance from which the target is out of reach [rad] or [m]; chosen: sixteen turns of a motor."""
    slope: float = 0.3
    """Share of a slope that may be left where a line search ends [1]; cited: between the 0.1 and 0.9 of
    Nocedal and Wright, Numerical Optimization, 2006, section 3.1."""


COMMAND = CommandSettings()


class Reached(NamedTuple):
    """What a search arrives at."""

    freedom: Vector
    """[k] Freedoms of the commands [rad] or [m]."""
    trace: MachineTrace
    state: MachineState
    reached: bool


@dataclass(frozen=True, slots=True)
class Sample:
    """One sample of a target, from where the machine stands."""

    machine: Machine
    state: MachineState
    balance: Vector
    """[m] f of (173)."""
    follows: Following
    base: Vector
    """[n] Where the drives are with all freedoms at 0 [m]."""
    span: float
    """[s]."""
    load: float
    """What acts on the first coordinate."""
    target: Vector
    """[d] Outputs as they are wanted."""

    def drives(self, freedom: Vector) -> Vector:
        """Return where the drives are [n] [m]."""
        return self.base + self.follows.modes @ freedom

    def at(self, drives: Vector) -> tuple[Vector, MachineTrace | None, MachineState]:
        """Return the outputs with the drives at [n] [m], NaN where there is no equilibrium."""
        acts = self._acts(drives)
        done, trace, state = carry_on(acts)
        if done == 0:
            return np.full(len(self.target), math.nan), None, self.state
        return outputs_of(self.follows, state), trace, state

    def going_to(self, drives: Vector) -> tuple[Vector, MachineTrace, MachineState]:
        """Do as `at`; raises SettingsError where the machine has no equilibrium there."""
        outputs, trace, state = self.at(drives)
        if trace is None:
            at = ", ".join(f"{1e3 * each:.4g}" for each in drives)
            raise SettingsError(f"the machine has no equilibrium with its drives at {at} mm")
        return outputs, trace, state

    def solved(self, near: Vector) -> Reached:
        """Return the freedoms that get to the target, from near ones, and whether they do."""
        outputs, trace, state = self.going_to(self.drives(near))
        if np.abs(outputs - self.target).max() <= SOLVER.accepted:
            return Reached(near, trace, state, True)
        freedom = self._along_one(near) if len(near) == 1 else self._balanced(near)
        outputs, trace, state = self.going_to(self.drives(freedom))
        miss = float(np.abs(outputs - self.target).max())
        return Reached(freedom, trace, state, miss <= 1e3 * SOLVER.accepted)

    def _acts(self, drives: Vector, held_at: Vector | None = None) -> Acts:
        """Return what acts on the machine, its end free, or held at coordinates [m]."""
        laws, count = self.machine.coordinates, self.machine.count
        m, moved = len(laws.stiffness), np.zeros((1, count))
        load = np.zeros((1, m))
        load[0, 0] = self.load
        if held_at is not None:
            moved = (laws.distal @ held_at)[None]
            laws = laws._replace(distal=np.zeros((count, m)), stiffness=np.ones(m))
        return Acts(
            *(self.machine, self.state, laws, np.zeros_like(laws.distal), self.balance),
            by_force=False,
            spans=np.array([self.span]),
            given=drives[None],
            moved=moved,
            load=load,
        )

    def _along_one(self, near: Vector) -> Vector:
        """Return the only freedom, by doubling steps and the Illinois method; docs/model.md (184)."""
        rising, best = self.follows.rising[0], near

        def miss(freedom: float) -> float:
            return float(rising @ (self.at(self.drives(np.array([freedom])))[0] - self.target))

        low = float(near[0])
        off = least = of_low = there = miss(low)
        way, step, high = math.copysign(1.0, -off), COMMAND.first, low
        for _ in range(SOLVER.trials):
            high = low + way * step
            there = miss(high)
            if math.isnan(there) or abs(high) > COMMAND.farthest:
                return best
            if abs(there) < abs(least) - SOLVER.accepted:
                best, least = np.array([high]), there
            if abs(there) <= SOLVER.accepted:
                return np.array([high])
            if there * off < 0.0:
                break
            low, of_low, step = high, there, 2.0 * step
        of_high, last = there, 0.0
        for _ in range(SOLVER.trials):
            middle = low + (high - low) * of_low / (of_low - of_high)
            there = miss(middle)
            if math.isnan(there) or middle in (low, high):
                break
            best = np.array([middle])
            if abs(there) <= SOLVER.accepted:
                break
            stays = there * last > 0.0  # the other end does: it counts half from then on
            if there * off > 0.0:
                low, of_low, of_high = middle, there, of_high * (0.5 if stays else 1.0)
            else:
                high, of_high, of_low = middle, there, of_low * (0.5 if stays else 1.0)
            last = there
        return best

    def _balanced(self, near: Vector) -> Vector:
        """Return freedoms at which the tendons hold an end that stands at the target; docs/model.md (342)."""
        follows, laws, machine = self.follows, self.machine.coordinates, self.machine
        held_at, unit = np.zeros(len(laws.stiffness)), 1.0
        if follows.tendons:
            wanted = pullable(self.target, follows.modes)
        else:
            at_rest, stiff = follows.free.T @ self.balance, float(laws.stiffness[0])
            wanted = pullable(at_rest + stiff * follows.free.T @ self.target, follows.modes)
            held_at = follows.free @ (wanted - at_rest) / stiff if stiff > 0.0 else self.target
            unit = stiff or machine.rig.end.radius_m

        def left(freedom: Vector) -> Vector:
            done, trace, _ = carry_on(self._acts(self.drives(freedom), held_at))
            pulled = follows.modes.T @ trace.ends[0, :, 1]
            return (pulled - wanted) / unit if done else np.full(len(wanted), math.nan)

        stretch = machine.rig.tendon.compliance_per_N * machine.routes[0].total_length
        slope = (follows.modes**2).sum(axis=0) / (stretch * unit)
        return stationary(left, near, np.diag(1.0 / slope))


def pullable(wanted: Vector, modes: Matrix) -> Vector:
    """Return the balance [2] nearest to a wanted one that tendons, which only pull, can hold; (342).

    A tendon that pulls with 1 N does it by its row of `modes` [n, 2].
    """
    for one, other in combinations(modes, 2):
        both = np.column_stack([one, other])
        if abs(np.linalg.det(both)) > ROUNDING.relative * np.linalg.norm(one) * np.linalg.norm(other):
            pulls = np.linalg.solve(both, wanted)
            if (pulls >= 0.0).all():
                return wanted
    alone = [max(float(one @ wanted) / float(one @ one), 0.0) * one for one in modes]
    return min(alone, key=lambda each: float(np.linalg.norm(each - wanted)))


def stationary(gradient: Callable[[Vector], Vector], start: Vector, inverse: Matrix) -> Vector:
    """Return where a convex function has no slope, by BFGS; where that is too far, the last point before.

    Parameters
    ----------
    gradient
        Its gradient at a point [k]; NaN where it has none.
    start
        Where to begin [k].
    inverse
        Guess of the inverse of its second derivatives [k, k].

    Notes
    -----
    Source: Nocedal and Wright, Numerical Optimization, 2006, (6.17), with line searches on the slope alone.
    """
    at, now, guess = start, gradient(start), inverse
    for _ in range(SOLVER.trials):
        if np.linalg.norm(now) <= SOLVER.accepted:
            break
        way = -inverse @ now
        if not way @ now < 0.0:
            inverse, way = guess, -guess @ now
        step, there = _searched(gradient, at, way, float(now @ way))
        if there is None:
            break
        change, moved = there - now, step * way
        at, now, curved = at + moved, there, float((there - now) @ moved)
        if curved > 0.0:
            turn = np.eye(len(at)) - np.outer(moved, change) / curved
            inverse = turn @ inverse @ turn.T + np.outer(moved, moved) / curved
    return at


def _searched(
    gradient: Callable[[Vector], Vector], at: Vector, way: Vector, slope: float
) -> tuple[float, Vector | None]:
    """Return a step along a way after which little of the slope is left, and the gradient there."""
    low, of_low, high, of_high, step = 0.0, slope, math.inf, math.nan, 1.0
    there = None
    for _ in range(SOLVER.trials):
        if step * np.linalg.norm(way) > COMMAND.farthest:
            return 0.0, None
        there = gradient(at + step * way)
        now = float(there @ way)
        if abs(now) <= COMMAND.slope * abs(slope):
            break
        if now < 0.0:
            low, of_low = step, now
        else:
            high, of_high = step, now
        if high == math.inf:
            step *= 2.0
        else:
            share = of_low / (of_low - of_high) if of_high == of_high else 0.5
            step = low + (high - low) * min(max(share, 0.1), 0.9)
    return step, there
