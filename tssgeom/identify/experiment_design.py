"""The next experiments of a campaign, designed for what its runs leave open.

Source: docs/discovery.md, "Designed experiments"; docs/model.md (117).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tssgeom.errors import SettingsError
from tssgeom.identify.assembly import Work
from tssgeom.identify.candidate_models import CandidateModel, left_by
from tssgeom.identify.expected_evidence import Information, shrink
from tssgeom.identify.experiment_routes import RouteChoice, other_routes, own_routes
from tssgeom.identify.experiment_search import EFFORT, Designed, Goal, Search, best_run, in_the_way
from tssgeom.identify.outcomes import contrasts
from tssgeom.identify.prediction import Errors, Stack, errors_of, total_sigma
from tssgeom.identify.proposal import Asked, NarrowedInterval, Proposal, ProposedRun
from tssgeom.identify.proposal_words import either, run_proposed, sentence
from tssgeom.identify.readings import Reading
from tssgeom.identify.run_limits import KEYS, limits_of
from tssgeom.identify.selection import name_of
from tssgeom.identify.verdict import parameter, plain
from tssgeom.rig import Rig
from tssgeom.statistics import NORMAL_95
from tssgeom.threads import single_threaded


def proposed(work: Work, runs: Sequence[Reading], rig: Rig, asked: Asked, seed: int) -> Proposal:
    """Design the next experiments.

    Parameters
    ----------
    work
        What the steps of the workflow left.
    runs
        All runs of the campaign, held out ones too.
    rig
        The nominal one.
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
        return _proposed(work, runs, rig, asked, seed)


def _proposed(work: Work, runs: Sequence[Reading], rig: Rig, asked: Asked, seed: int) -> Proposal:
    left = left_by(work)
    limits = limits_of(runs, rig, left.models[0].at, asked.limits)
    goal = Goal(left, _widest(left.models[0], work.problem.stack) if len(left.models) == 1 else 0)
    search = Search(_template(runs), rig, goal, limits, None)
    rng, made, own = np.random.default_rng(seed), list[ProposedRun](), own_routes(runs)
    total: Information | None = None
    for k in range(asked.runs):
        search = Search(search.template, rig, goal, limits, total)
        _, design, added = _best(search, own, other_routes(runs), rng)
        total = search.total(added)
        made.append(_run(f"run_{k + 1}", design, goal, total))
    assert total is not None
    narrowed = None if goal.separates else _narrowed(goal, total)
    return Proposal(
        sentence(goal, total, narrowed),
        tuple(model.name for model in left.models),
        limits.values,
        limits.stated,
        tuple(made),
        narrowed,
        _in_the_way(search, own, total, seed) if goal.separates else "",
    )


def _best(
    search: Search, own: Sequence[RouteChoice], others: Sequence[RouteChoice], rng: np.random.Generator
) -> tuple[float, Designed, Information]:
    """Return the best run on the routes there are, or on another if only that shows the likeliest model."""
    here = best_run(search, own, rng)
    if not search.goal.separates or search.goal.decides(search.total(here[2])):
        return here
    try:
        there = best_run(search, others, rng, EFFORT.elsewhere)
    except SettingsError:
        return here
    own_shows, others_show = (search.goal.standing(search.total(each[2])) for each in (here, there))
    first = next(k for k, model in enumerate(search.goal.models) if model.may_be_true)
    return there if first in others_show and first not in own_shows else here


def _template(runs: Sequence[Reading]) -> Reading:
    """Return a run with only the channels that all runs have."""
    first = runs[0]
    shared = set.intersection(*(set(run.measured) for run in runs)) or set(first.measured)
    return Reading(
        "proposed",
        first.route,
        False,
        first.drive,
        first.given,
        {name: values for name, values in first.measured.items() if name in shared},
        first.noise,
    )


def _run(name: str, design: Designed, goal: Goal[CandidateModel], total: Information) -> ProposedRun:
    run, models = design.run, goal.models
    stack = run.problem.stack
    errors: Errors = errors_of(stack, models[0].at.rig(run.problem.rig), models[0].at.effects)
    (sigma,) = stack.split(total_sigma(errors))
    measured = stack.split(stack.measured)[0]
    choice = design.choice
    return run_proposed(
        name,
        (choice.words or choice.route.name, choice.run, choice.route.arcs if choice.words else None),
        (run.reading.drive,),
        design.course,
        goal,
        total,
        None if goal.separates else _narrowed(goal, total),
        contrasts(run, models, total),
        [{channel: values[channel] for channel in measured} for values in run.channels],
        sigma,
    )


def _in_the_way(search: Search, own: Sequence[RouteChoice], total: Information, seed: int) -> str:
    """Return which limit stands against a decision; empty where the runs decide or none does."""
    goal = search.goal
    if goal.decides(total):
        return ""
    limit = in_the_way(search, own, len(goal.standing(total)), seed)
    if limit is None:
        return ""
    key, value, standing = limit
    return (
        f"With {key}={value:.3g} ({KEYS[key]}) one run is expected to show {either(goal, standing)} if true."
    )


def _widest(model: CandidateModel, stack: Stack) -> int:
    """Return which number has the widest interval for its size."""
    spread = np.sqrt(np.diag(np.linalg.inv(model.information)))
    relative = [float(spread[0]), float(spread[1])]
    for free, sd in zip(model.at.free, spread[2:], strict=True):
        value = float(getattr(model.at.effects[free.effect], free.key))
        length = stack.readings[0].route.arcs.total_length
        size = length if free.key == "at_m" else abs(value)
        relative.append(float(sd) if free.log else float(sd) * free.unit / max(size, 1e-300))
    return int(np.argmax(relative))


def _narrowed(goal: Goal[CandidateModel], total: Information) -> NarrowedInterval:
    """Return the interval that is narrowed, now and as expected."""
    model, k = goal.models[0], goal.which
    sd = math.sqrt(float(np.linalg.inv(model.information)[k, k]))
    ratio = shrink(total, model, 0, k)
    if k < 2:
        name, value, unit = (
            ("friction (the angle gain apart)", model.at.friction, "1"),
            ("compliance", model.at.compliance, "1/N"),
        )[k]
        half = NORMAL_95 * sd * value
        return NarrowedInterval(name, value, unit, half, ratio * half)
    free = model.at.free[k - 2]
    effect = model.at.effects[free.effect]
    value = float(getattr(effect, free.key))
    half = NORMAL_95 * sd * (abs(value) if free.log else free.unit)
    name = f"{parameter(free.key)} of {plain(name_of(effect))}"
    return NarrowedInterval(name, value, effect.parameters[free.key].unit, half, ratio * half)
