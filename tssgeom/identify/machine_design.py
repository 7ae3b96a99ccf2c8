"""The next runs of a machine, designed for what its runs leave open.

Source: docs/discovery.md, "Designed experiments"; docs/model.md (117), (314).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Vector
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
from tssgeom.identify.machine_drives import Drives
from tssgeom.identify.machine_finding import MachineWork
from tssgeom.identify.machine_problem import fitted_rows
from tssgeom.identify.machine_run import MachineRun
from tssgeom.identify.outcomes import Contrast, outcome
from tssgeom.identify.proposal import Asked, NarrowedInterval, Proposal, ProposedRun
from tssgeom.identify.proposal_words import expected_of, sentence, why
from tssgeom.identify.run_limits import forbidding
from tssgeom.identify.selection import separable_from
from tssgeom.identify.verdict import parameter, plain
from tssgeom.identify.waveform import Course, Waveform, course_of, varied_waveform
from tssgeom.threads import single_threaded


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
    outcomes = [
        outcome(pair, (models[pair.true].name, models[pair.other].name), sigma, course, channels)
        for pair in pairs
    ]
    narrowed = None if goal.separates else _narrowed(goal, total)
    return ProposedRun(
        name=name,
        route=f"as in {like}",
        like=like,
        new_route=None,
        drives=channels,
        time=course.time,
        values=course.drive,
        corner_time=course.corner_time,
        corners=course.corner,
        why=why(goal, total, narrowed),
        outcomes=tuple(words for _, words in outcomes),
        expected=expected_of(goal, total),
        channels={
            candidate.name: by_channel(one.flat)
            for candidate, one in zip(models, best.predicted, strict=True)
        },
        differences={
            models[max(pair.true, pair.other)].name: {
                each: values if pair.true else -values for each, values in pair.difference.items()
            }
            for pair in pairs
        },
        sigma=sigma,
        clearest=outcomes[0][0] if outcomes else names[0],
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
