"""The next runs of a machine: what its drives may do, designed for what its runs leave open.

Source: docs/discovery.md, "Designed experiments"; docs/model.md (117), (314), (345).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.errors import TssgeomError
from tssgeom.identify.candidate_models import Left
from tssgeom.identify.expected_evidence import Information, shrink, step_of
from tssgeom.identify.experiment_search import EFFORT, Goal, sketches
from tssgeom.identify.machine_candidates import (
    MachineCandidate,
    PredictedRun,
    candidates_of,
    information_of_run,
    intervals,
    predicted_run,
    sigma_of,
)
from tssgeom.identify.machine_evidence import FittedModel
from tssgeom.identify.machine_finding import MachineWork
from tssgeom.identify.machine_prediction import Machines
from tssgeom.identify.machine_problem import fitted_rows
from tssgeom.identify.machine_run import MachineRun, turns_of
from tssgeom.identify.outcomes import Contrast
from tssgeom.identify.proposal import Asked, NarrowedInterval, Proposal, ProposedRun
from tssgeom.identify.proposal_words import run_proposed, sentence
from tssgeom.identify.run_limits import RunLimits, forbidding, top_speed, within_limits
from tssgeom.identify.selection import separable_from
from tssgeom.identify.verdict import parameter, plain
from tssgeom.identify.waveform import (
    Course,
    Range,
    Reach,
    Waveform,
    course_of,
    random_waveform,
    varied_waveform,
    with_ways,
)
from tssgeom.tendon.machine_simulation import drive_channels, simulated_channels
from tssgeom.threads import single_threaded


class Drives:
    """What the drives of the next run may do, and the run that they make."""

    def __init__(self, model: FittedModel, runs: Sequence[MachineRun], stated: Mapping[str, float]) -> None:
        template = runs[0]
        self.model, self.runs = model, runs
        self.channels = drive_channels(template.drive, template.tendons)
        self.by_force = template.drive in ("tension_in", "motor_torque_Nm")
        self.metres = model.rig.drive.arm if template.drive.startswith("motor") else 1.0
        routes = model.on_known_routes(template).routes
        none = np.zeros(0, dtype=bool)
        self.template = replace(template, name="proposed", routes=routes, legs=None, bends={}, held_out=none)
        self.machines = Machines(model.rig, model.problem.bars)
        time = [run.given["time_s"] for run in runs]
        reached = [self._reached(run) for run in runs]
        interval = min(float(np.median(np.diff(each))) for each in time)
        self.limits: RunLimits = within_limits(
            reached, model.rig, stated, interval, max(len(each) for each in time)
        )
        self.range = self._range(reached)

    def waveform(self, rng: np.random.Generator) -> Waveform:
        """Return a waveform at random."""
        made = random_waveform(rng)
        return with_ways(made, rng) if isinstance(self.range, Reach) else made

    def run(self, course: Course) -> MachineRun | None:
        """Return a run as the model has it; None where it goes beyond a limit or has no equilibrium."""
        level = {name: np.full(len(course.time), np.mean(each)) for name, each in self.template.given.items()}
        driven = dict(zip(self.channels, np.ascontiguousarray(course.drive.T), strict=True))
        given = {**level, "time_s": course.time, **driven}
        held = np.zeros(len(course.time), dtype=bool)
        run = replace(self.template, given=given, held_out=held)
        try:
            channels = simulated_channels(self.machines.simulation(run, {}))
        except TssgeomError:
            return None
        measured = {name: channels[name] for name in self.template.measured}
        return replace(run, measured=measured) if self._allowed(course.time, channels) else None

    def _allowed(self, time: Vector, channels: Mapping[str, Vector]) -> bool:
        """Whether a run stays within the limits; a drive by position has its course within those of it."""
        tension, limits = _tensions(channels), self.limits
        within = (
            tension.max() <= EFFORT.over * limits.tension_N
            and tension.min() >= limits.least_tension_N / EFFORT.over
        )
        if not (within and self.by_force):
            return bool(within)
        moved = self._moved(channels)
        return bool(
            1e3 * np.abs(moved).max() <= EFFORT.over * limits.travel_mm
            and 1e3 * max(top_speed(time, each) for each in moved.T) <= EFFORT.over * limits.speed_mm_per_s
        )

    def _moved(self, channels: Mapping[str, Vector]) -> Matrix:
        """Return how far the drives have gone [n, drives] [m]."""
        if self.by_force:
            drive = "displacement_in" if self.template.drive == "tension_in" else "motor_angle_rad"
            return self.metres * _columns(channels, drive_channels(drive, self.template.tendons))
        driven = _columns(channels, self.channels)
        return self.metres * (driven - driven[0])

    def _reached(self, run: MachineRun) -> dict[str, float]:
        """Return the extremes of one run by `KEYS`, by the model where they are not measured."""
        time = run.given["time_s"]
        known = replace(run, routes=self.model.on_known_routes(run).routes, bends={})
        channels = simulated_channels(self.machines.simulation(known, {}))
        tension, moved = _tensions(channels), self._moved(channels if self.by_force else run.given)
        return {
            "tension_N": float(tension.max()),
            "least_tension_N": float(tension.min()),
            "speed_mm_per_s": 1e3 * max(top_speed(time, each) for each in moved.T),
            "travel_mm": 1e3 * float(np.abs(moved).max()),
            "least_mm": 1e3 * float(moved.min()),
            "duration_s": float(time[-1] - time[0]),
        }

    def _range(self, reached: Sequence[Mapping[str, float]]) -> Range | Reach:
        """Return how far and how fast the drives may go."""
        limits = self.limits
        long = {"duration": limits.duration_s, "interval": limits.interval_s, "samples": limits.samples}
        if self.by_force or len(self.channels) > 1:
            start, points = self._points(reached)
            return Reach(start, points, speed=self._rate(reached), **long)
        both = 2.0 * min(each["least_mm"] for each in reached) < -max(each["travel_mm"] for each in reached)
        high, speed = (1e-3 * each / self.metres for each in (limits.travel_mm, limits.speed_mm_per_s))
        return Range(0.0, -high if both else 0.0, high, speed=speed, **long)

    def _points(self, reached: Sequence[Mapping[str, float]]) -> tuple[Vector, Matrix]:
        """Return where the drives begin, and [points, drives] where they were when one turned.

        They are farther from it, or nearer, as limits that are stated allow; docs/model.md (345).
        """
        by_tension = self.template.drive == "tension_in"
        rest = self.model.rig.tendon.pretension_N if self.by_force else 0.0
        start = np.full(len(self.channels), rest if by_tension else 0.0)
        points = np.concatenate([_turning(_columns(run.given, self.channels)) for run in self.runs])
        key = "tension_N" if self.by_force else "travel_mm"
        most = max(each[key] for each in reached)
        points = start + (points - start) * (self.limits.values[key] - rest) / (most - rest)
        return start, np.maximum(points, self.limits.least_tension_N) if by_tension else points

    def _rate(self, reached: Sequence[Mapping[str, float]]) -> float:
        """Return how fast a drive may change, in its unit over s: of forces what made the limit of speed."""
        if not self.by_force:
            return 1e-3 * self.limits.speed_mm_per_s / self.metres
        rate = max(
            top_speed(run.given["time_s"], run.given[each]) for run in self.runs for each in self.channels
        )
        return rate * self.limits.speed_mm_per_s / max(each["speed_mm_per_s"] for each in reached)


def _columns(run: Mapping[str, Vector], names: Sequence[str]) -> Matrix:
    return np.column_stack([run[name] for name in names])


def _turning(drives: Matrix) -> Matrix:
    """Return the samples [points, drives] at which any of some drives [n, drives] turns."""
    return drives[np.unique(np.concatenate([turns_of(each) for each in drives.T]))]


def _tensions(channels: Mapping[str, Vector]) -> Vector:
    """Return the proximal tensions of all tendons, one after the other [N]."""
    return np.concatenate([each for name, each in channels.items() if name.startswith("tension_in_")])


def proposed_of_machine(work: MachineWork, asked: Asked, seed: int) -> Proposal:
    """Design the next experiments of a machine.

    Parameters
    ----------
    work
        What the steps of the workflow left.
    asked
        How many experiments, and within which limits.
    seed
        The same seed gives the same experiments.

    Raises
    ------
    SettingsError
        Where a limit is unknown, or the limits forbid every run.
    """
    with single_threaded():  # matrices are small
        return _proposed(work, asked, np.random.default_rng(seed))


def _proposed(work: MachineWork, asked: Asked, rng: np.random.Generator) -> Proposal:
    candidates = candidates_of(work)
    first, template = candidates[0].model, work.fitted[0]
    drives = Drives(first, (*work.fitted, *work.kept), asked.limits)
    which = _widest(candidates[0]) if len(candidates) == 1 else 0
    goal = Goal(Left(tuple(candidates), separable_from(), {}), which)
    made, total = list[ProposedRun](), None
    for k in range(asked.runs):
        best = _best(drives, goal, total, rng)
        total = best.added if total is None else total.plus(best.added)
        made.append(_run(f"run_{k + 1}", best, goal, total, (drives.channels, template.name)))
    assert total is not None
    narrowed = None if goal.separates else _narrowed(goal, total)
    limits = drives.limits
    names = tuple(candidate.name for candidate in candidates)
    return Proposal(
        sentence(goal, total, narrowed), names, limits.values, limits.stated, tuple(made), narrowed, ""
    )


@dataclass(frozen=True, slots=True)
class _Designed:
    """One run that may be proposed."""

    waveform: Waveform
    course: Course
    run: MachineRun
    sigma: Mapping[str, float]
    predicted: tuple[PredictedRun, ...]
    """Of each model."""
    added: Information
    score: float


def _best(
    drives: Drives, goal: Goal[MachineCandidate], total: Information | None, rng: np.random.Generator
) -> _Designed:
    """Return the best run of some random ones, changed as long as that makes it better."""

    def tried(_: int) -> _Designed | None:
        return _designed(drives, goal, total, drives.waveform(rng))

    sketched = list(sketches(tried, round(EFFORT.elsewhere * EFFORT.sketched)))
    if not sketched:
        raise forbidding(drives.limits)
    best = max(sketched, key=lambda one: one.score)
    for _ in range(EFFORT.improved):
        near = _designed(drives, goal, total, varied_waveform(best.waveform, rng))
        if near is not None and near.score > best.score:
            best = near
    return best


def _designed(
    drives: Drives, goal: Goal[MachineCandidate], total: Information | None, waveform: Waveform
) -> _Designed | None:
    """Return a run and what it is worth; None where it is beyond a limit, or a model has no equilibrium."""
    course = course_of(waveform, drives.range)
    run = None if course is None else drives.run(course)
    if course is None or run is None:
        return None
    sigma = sigma_of(goal.models[0].model, run)
    every = [predicted_run(candidate, run, sigma) for candidate in goal.models]
    predicted = tuple(each for each in every if each is not None)
    if len(predicted) < len(every):
        return None
    added = information_of_run(predicted, goal.models)
    score = goal.score(added if total is None else total.plus(added))
    return _Designed(waveform, course, run, sigma, predicted, added, score)


def _run(
    name: str,
    best: _Designed,
    goal: Goal[MachineCandidate],
    total: Information,
    drive: tuple[tuple[str, ...], str],
) -> ProposedRun:
    """Return a run as it is reported; `drive` has its channels, and a run on the same routes."""
    (channels, like), models, course = drive, goal.models, best.course
    names = [each for _, each, _ in fitted_rows([best.run], held_out=None) if each in best.sigma]

    def by_channel(flat: Vector) -> dict[str, Vector]:
        """Return whitened rows as channels [SI]."""
        parts = np.split(flat, len(names))
        return {each: best.sigma[each] * part for each, part in zip(names, parts, strict=True)}

    pairs = [_contrast(best, goal, total, k, by_channel) for k in range(1, len(models))]
    sigma = {each: np.full(len(course.time), best.sigma[each]) for each in names}
    return run_proposed(
        name,
        (f"as in {like}", like, None),
        channels,
        course,
        goal,
        total,
        None if goal.separates else _narrowed(goal, total),
        pairs,
        [by_channel(one.flat) for one in best.predicted],
        sigma,
    )


def _contrast(
    best: _Designed,
    goal: Goal[MachineCandidate],
    total: Information,
    k: int,
    by_channel: Callable[[Vector], dict[str, Vector]],
) -> Contrast:
    """Return a model held against the first, the other one refitted to what is taken for true."""
    pair = (k, 0) if goal.models[k].may_be_true else (0, k)
    true, other = best.predicted[pair[0]], best.predicted[pair[1]]
    off = true.flat - other.flat - other.slope @ step_of(total, goal.models, pair)
    own = np.linalg.solve(np.eye(other.own.shape[1]) + other.own.T @ other.own, other.own.T @ off)
    left = off - other.own @ own
    return Contrast(*pair, by_channel(left), by_channel(true.flat - left))


def _widest(candidate: MachineCandidate) -> int:
    """Return which number has the widest interval for its size."""
    return int(np.argmax([half / max(abs(value), 1e-300) for _, value, half in intervals(candidate)]))


def _narrowed(goal: Goal[MachineCandidate], total: Information) -> NarrowedInterval:
    candidate, k = goal.models[0], goal.which
    number, value, half = intervals(candidate)[k]
    part, _, own = number.name.rpartition(": ")
    name = f"{parameter(own)} of {plain(part)}" if part else own
    return NarrowedInterval(name, value, number.unit, half, shrink(total, candidate, 0, k) * half)
