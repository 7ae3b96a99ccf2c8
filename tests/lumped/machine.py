"""Several tendons between one drive and one mechanism, each of them the chain of `simulate`.

In every step the unknowns of the mechanism (the angle of a joint, the bending of a segment) are searched for
by Newton's method with a line search: any value of them holds the far ends of the tendons, which the chain
then answers exactly, and what the tendons and the mechanism pull against each other has to vanish. It falls
as the unknowns grow, since every tendon pulls less the further its far end has come, so that there is one
solution; where a weight above a soft joint gives more, the search goes to one near the last. A motor of given
torque adds its angle outside of that, in the same way. Nothing is kept before all is in balance.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tests.lumped.changes import Change
from tests.lumped.march import Stepped
from tests.lumped.mechanism import Joint, Motor, Segment
from tests.lumped.physics import Distal, Drive, Physics
from tests.lumped.route import Path
from tests.lumped.simulate import (
    NoBalanceError,
    Run,
    celsius_of,
    displacement_by_force,
    grid_of,
    play,
    prepared,
    records_for,
    run_of,
)

CLOSED_N = 1e-8  # what may stay open, as a force at the lever arm
ROUNDED = 16 * np.finfo(float).eps  # of an angle, which a stuck fitting of 1e11 N/m multiplies
NEAR, FAR = 0.02, 10.0  # first step and farthest one where hardly anything holds the unknowns [rad]
ROUNDS, CUTS = 200, 60  # of Newton's method, of its line search
LEAST_PART = 1.0 / 4096.0  # of a step: twelve halvings


@dataclass(frozen=True, slots=True)
class MachineRun:
    """What a machine did at the F asked times; what it does not have is None."""

    times: np.ndarray
    """[F] s."""
    tendons: tuple[Run, ...]
    """Each tendon by itself."""
    motor_angle: np.ndarray | None
    """[F] rad."""
    motor_torque: np.ndarray | None
    """[F] From rest [N·m]."""
    joint_angle: np.ndarray | None
    """[F] rad."""
    joint_torque: np.ndarray | None
    """[F] Of the tendons on the joint, from rest [N·m]."""
    load_torque: np.ndarray | None
    """[F] What is left of it for the load: as given, or as it takes to hold the given angle [N·m]."""
    bending: np.ndarray | None
    """[F, 2] rad."""
    tip: np.ndarray | None
    """[F, 3] Of the marker [m]."""
    left_open: float
    """Greatest moment that was left out of balance [N·m]."""


class _Try(NamedTuple):
    """A machine held in one position."""

    unknown: np.ndarray  # [m] of the mechanism
    open: np.ndarray  # [m] N m, what the tendons pull more than the mechanism
    slope: np.ndarray  # [m, m] of that, by the unknowns
    ends: np.ndarray  # [n, 6] of the tendons, as in lumped.h


class NoStepError(Exception):
    """No balance within a step, which has to be shorter."""


def simulate_machine(
    tendons: Sequence[tuple[Path, Physics]],
    drive: Motor | Sequence[Drive],
    end: Joint | Segment,
    times: ArrayLike,
    max_step: float = 0.02,
    changes: Sequence[Change] = (),
    ends_only: bool = False,
) -> MachineRun:
    """Run from rest, where each tendon has its pretension all along, in substeps of at most `max_step` [s].

    `drive` is one motor for one or two tendons, or a drive for each of them. Backlash of a tendon goes with
    its own drive; a motor has its play instead. `changes` are those of every tendon;
    `ends_only` is as for `simulate`.

    Raises
    ------
    NoBalanceError
        Where the machine finds no equilibrium.
    """
    machine = _Machine(tendons, drive, end, changes)
    drives = [each.times for each in machine.drives]
    others = [path.times for path, _ in tendons] + [change.times for change in changes]
    if isinstance(end, Joint):
        others += [course[0] for course in (end.load, end.angle) if course is not None]
    grid, keep = grid_of(times, drives, others, max_step)
    return machine.run(grid, keep, max_step, ends_only)


class _Machine:
    def __init__(self, tendons, drive, end, changes) -> None:
        self.changes = changes
        self.paths, self.physics = [path for path, _ in tendons], [physics for _, physics in tendons]
        self.drive, self.end, self.motor = drive, end, drive if isinstance(drive, Motor) else None
        self.arms = end.arms(len(tendons))
        self.free = not (isinstance(end, Joint) and end.angle is not None)
        if self.motor is None:
            self.drives = list(drive)
        else:
            if any(physics.backlash_m for physics in self.physics):
                raise ValueError("backlash of a tendon beside a motor: give the motor a play")
            self.pulled = self.motor.arms(len(tendons))
            held = np.zeros(len(self.motor.times))
            self.drives = [
                Drive("displacement", self.motor.times, held, self.motor.temperature_C) for _ in tendons
            ]
        if len(self.drives) != len(tendons):
            raise ValueError(f"{len(tendons)} tendons, {len(self.drives)} drives: give as many")
        self.rest = np.array([physics.pretension_N for physics in self.physics])

    def run(self, grid, keep, max_step, ends_only) -> MachineRun:
        """Run over a grid and return what is kept."""
        given = [
            prepared(path, physics, drive, Distal("blocked"), grid, keep, max_step, self.changes)
            for path, physics, drive in zip(self.paths, self.physics, self.drives, strict=True)
        ]
        rows = [records_for(path, int(keep.sum()), ends_only) for path in self.paths]
        self.chains = [
            Stepped(parts, imposed, row) for (parts, imposed, _), row in zip(given, rows, strict=True)
        ]
        courses = self._imposed(grid)
        spans = np.diff(grid, prepend=grid[0] - max_step)
        unknown, pulley, left_open, states, steps = np.zeros(self.arms.shape[1]), 0.0, 0.0, [], 0
        for g, span in enumerate(spans):
            for tendon in self.chains:
                tendon.next(g)
            done, part = 0.0, 1.0
            while done < 1.0:
                after = min(done + part, 1.0)
                before = max(g - 1, 0)
                now = [float(s[before] + after * (s[g] - s[before])) for s in courses]
                drives = [tendon.part(after) for tendon in self.chains]
                try:
                    step = self._balance(drives, now, unknown, pulley, (after - done) * span)
                except NoStepError as error:
                    part *= 0.5
                    if part < LEAST_PART:
                        said = f"no balance of the machine at {grid[g]:.6g} s: {error}"
                        raise NoBalanceError(f"{said}; lower max_step, drive or load") from error
                    continue
                for tendon in self.chains:
                    tendon.keep((after - done) * span)
                (result, pulley), unknown, done = step, step[0].unknown, after
                left_open = max(left_open, float(np.abs(result.open).max(initial=0.0)))
                steps += 1
            if keep[g]:
                for tendon in self.chains:
                    tendon.record()
            states.append((pulley, *unknown))
        return self._result(grid, keep, np.array(states).T, given, rows, courses[2], left_open, steps)

    def _imposed(self, grid) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """[g] Angle of the pulley, torque of the motor, load and angle of the joint; 0 if not given."""
        none = np.zeros(len(grid))
        turned, torque = none, none
        if self.motor is not None:
            values = np.interp(grid, self.motor.times, self.motor.values)
            if self.motor.kind == "angle":
                turned = play(values, self.motor.play_rad)
            else:
                torque = values
        load, angle = (
            none if course is None else np.interp(grid, *course)
            for course in (getattr(self.end, "load", None), getattr(self.end, "angle", None))
        )
        return turned, torque, load, angle

    def _balance(self, drives, now, unknown, pulley, span) -> tuple[_Try, float]:
        """Return the machine in balance, and the angle of its pulley."""
        turned, torque, load, angle = now
        start = unknown if self.free else np.array([angle])
        if self.motor is None:
            return self._balanced(drives, start, load, span), 0.0
        if self.motor.kind == "angle":
            return self._balanced(self.pulled * turned, start, load, span), turned
        trials = [(pulley, start, np.zeros(len(start)))]  # angle, mechanism, how that follows the angle
        held: list[_Try] = []

        def with_pulley(at: np.ndarray) -> _Try:
            last, unknown, follows = trials[-1]
            held.append(self._balanced(self.pulled * at[0], unknown + follows * (at[0] - last), load, span))
            slope, ends = held[-1].slope, held[-1].ends
            rise = self.pulled**2 @ ends[:, 2]
            if self.free:
                follows = _against(slope, self.arms.T @ (ends[:, 4] * self.pulled))
                follows = np.where(np.isfinite(follows), follows, 0.0)
                rise += (self.pulled * ends[:, 3]) @ (self.arms @ follows)
            trials.append((at[0], held[-1].unknown, follows))
            more = torque - self.pulled @ (ends[:, 0] - self.rest)
            return _Try(at, np.array([more]), np.array([[-rise]]), ends)

        solved = newton(with_pulley, np.array([pulley]), CLOSED_N * self.motor.radius_m)
        return held[-1], float(solved.unknown[0])

    def _balanced(self, drives, start: np.ndarray, load: float, span: float) -> _Try:
        """Return the mechanism in balance while the drives are held."""

        def held(at: np.ndarray) -> _Try:
            ends = [
                tendon.attempt(float(drive), float(out), span)
                for tendon, drive, out in zip(self.chains, drives, self.arms @ at, strict=True)
            ]
            if any(each is None for each in ends):
                raise NoStepError("a tendon has none")
            ends = np.array(ends)
            torque, rise = self.end.torque(at)
            pull = self.arms.T @ (ends[:, 1] - self.rest)
            slope = self.arms.T @ (ends[:, 5, None] * self.arms) - rise
            return _Try(at, pull - torque - load, slope, ends)

        if not self.free:
            return held(start)._replace(open=np.zeros(0))
        return newton(held, start, CLOSED_N * np.abs(self.arms).max())

    def _result(self, grid, keep, states, given, rows, loads, left_open, steps) -> MachineRun:
        pulley, unknown = states[0], states[1:, keep].T
        runs = []
        for i, (path, physics, drive) in enumerate(zip(self.paths, self.physics, self.drives, strict=True)):
            parts, _, values = given[i]
            displayed = self.pulled[i] * pulley[keep] if self.motor is not None else values[keep]
            if drive.kind == "force":
                displayed = displacement_by_force(rows[i], parts, physics)
            effort = (steps, self.chains[i].passes)
            out = unknown @ self.arms[i]
            runs.append(
                run_of(grid[keep], displayed, out, rows[i], effort, path, celsius_of(drive, grid[keep]))
            )
        motor_angle = motor_torque = None
        if self.motor is not None:
            motor_angle = play(pulley, self.motor.play_rad, inverse=True)[keep]
            if self.motor.kind == "angle":
                motor_angle = np.interp(grid[keep], self.motor.times, self.motor.values)
            pulls = np.array([run.tension_in for run in runs]) - self.rest[:, None]
            motor_torque = self.pulled @ pulls
        common = (grid[keep], tuple(runs), motor_angle, motor_torque)
        if isinstance(self.end, Segment):
            return MachineRun(*common, None, None, None, unknown, self.end.tip(unknown), left_open)
        angle = unknown[:, 0]
        torque = self.arms[:, 0] @ (np.array([run.tension_out for run in runs]) - self.rest[:, None])
        load = loads[keep] if self.free else torque - self.end.torque(angle)[0]
        return MachineRun(*common, angle, torque, load, None, None, left_open)


def newton(held: Callable[[np.ndarray], _Try], start: np.ndarray, tolerance: float) -> _Try:
    """Return where nothing is open; what is open falls along every way. The last call is its own."""
    here = held(start)
    for _ in range(ROUNDS):
        rounding = ROUNDED * np.abs(here.slope) @ np.maximum(np.abs(here.unknown), 0.1)
        if np.all(np.abs(here.open) <= tolerance + rounding):
            return here
        way = _against(here.slope, here.open)
        if not np.abs(way).max() < FAR:  # slack all round: on to where something pulls
            way = here.open * (NEAR / np.abs(here.open).max())
        here = _along(held, here, way)
    raise NoStepError(f"{np.abs(here.open).max():.3g} N m stay open")


def _against(slope: np.ndarray, pull: np.ndarray) -> np.ndarray:
    """Return how far the unknowns move until they take up `pull`, infinitely where nothing holds them."""
    try:
        return -np.linalg.solve(slope, pull)
    except np.linalg.LinAlgError:
        return np.full(len(pull), np.inf)


def _along(held: Callable[[np.ndarray], _Try], here: _Try, way: np.ndarray) -> _Try:
    """Return a point where less is open along the way, not far beyond where nothing would be."""
    first = float(here.open @ way)
    if not first > 0.0:
        raise NoStepError("what is open does not fall")
    low, high, at_low, at_high, share = 0.0, None, first, 0.0, 1.0
    for _ in range(CUTS):
        try:
            there = held(here.unknown + share * way)
            rate = float(there.open @ way)
        except NoStepError:
            rate = -np.inf
        if abs(rate) <= 0.5 * first:
            return there
        if rate > 0.0:
            low, at_low = share, rate
        else:
            high, at_high = share, rate
        if high is None:
            share *= 2.0
        else:
            step = at_low / (at_low - at_high) if np.isfinite(at_high) else 0.5
            share = low + min(max(step, 0.1), 0.9) * (high - low)
    raise NoStepError("no balance on the way")
