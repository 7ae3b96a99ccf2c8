"""The runs that are worth most next: drives and routes searched for what they are expected to separate.

Source: docs/discovery.md, "Designed experiments"; docs/model.md (117).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.errors import SettingsError, TssgeomError
from tssgeom.identify.candidate_models import AnyCompared, CandidateModel, Left
from tssgeom.identify.expected_evidence import (
    Information,
    Predicted,
    expected_delta_bic,
    information_of,
    linear,
    predicted,
    shrink,
    size_over_limits,
    with_errors,
)
from tssgeom.identify.experiment_routes import RouteChoice, SlowStroke
from tssgeom.identify.readings import Reading
from tssgeom.identify.run_limits import RunLimits, forbidding, top_speed
from tssgeom.identify.selection import SEARCH, separable_from
from tssgeom.identify.waveform import Course, Range, Waveform, course_of, random_waveform, varied_waveform
from tssgeom.rig import Rig


@dataclass(frozen=True, slots=True)
class SearchEffort:
    """How long experiments are searched for."""

    sketched: int = 100
    """Random drives, judged with white noise alone; chosen: some seconds."""
    improved: int = 24
    """Changes of the best drive that are tried; chosen: some seconds."""
    attempts: int = 20
    """Random drives for each that fits the limits, at most; chosen."""
    beyond: float = 1.5
    """Detection limits that an effect is to exceed [1]; chosen: above 1 it counts, half more to be sure."""
    over: float = 1.02
    """Of a limit of tension: what a model may predict [1]; chosen: the models differ by more."""
    elsewhere: float = 0.5
    """Of the effort: search on other routes [1]; chosen for speed."""
    wider: float = 0.25
    """Of the effort: search within wider limits [1]; chosen for speed."""
    widening: Mapping[str, float] = field(
        default_factory=lambda: {"speed_mm_per_s": 10.0, "duration_s": 3.0, "tension_N": 1.5}
    )
    """What a limit is multiplied by to see whether it is in the way [1]; chosen."""


EFFORT = SearchEffort()
AnyDesigned = TypeVar("AnyDesigned")


@dataclass(frozen=True, slots=True)
class Designed:
    """One run that is proposed."""

    choice: RouteChoice
    course: Course
    waveform: Waveform
    run: Predicted
    """As the models predict it, with all errors."""


@dataclass(frozen=True, slots=True)
class Goal(Generic[AnyCompared]):
    """What runs are judged by: evidence between models; where there is one only, the width of one number."""

    left: Left[AnyCompared]
    which: int = 0
    """The number to be narrowed, where there is one model."""

    @property
    def models(self) -> tuple[AnyCompared, ...]:
        """What is left, the best first."""
        return self.left.models

    @property
    def separates(self) -> bool:
        """Whether there are models to separate."""
        return len(self.models) > 1

    def score(self, added: Information) -> float:
        """Return what some runs are worth [1]: more for the pair that is separated worst."""
        if not self.separates:
            return -math.log(shrink(added, self.models[0], 0, self.which))
        return float(np.mean([_saturated(gain) for gain in self.evidence(added).values()]))

    def evidence(self, added: Information) -> dict[tuple[int, int], float]:
        """Return the expected ΔBIC by pair, less where an effect stays below the detection limits."""
        gains = expected_delta_bic(added, self.models)
        for pair in gains:
            if not self.models[pair[1]].may_be_true:
                size = size_over_limits(added, self.models, pair, self.left.limits)
                gains[pair] *= min((size / EFFORT.beyond) ** 2, 1.0)
                if size <= 1.0:
                    gains[pair] = min(gains[pair], self.left.needed)
        return gains

    def standing(self, added: Information) -> dict[int, float]:
        """Return the models that the runs are expected to show if true, with their least ΔBIC [1]."""
        gains = self.evidence(added)
        worst = {
            i: min(gain for (true, _), gain in gains.items() if true == i)
            for i in {pair[0] for pair in gains}
        }
        return {i: gain for i, gain in worst.items() if gain > self.left.needed}

    def decides(self, added: Information) -> bool:
        """Whether the runs are expected to show whichever model is true."""
        return len(self.standing(added)) == len({pair[0] for pair in added.square})


def _saturated(gain: float) -> float:
    """Return evidence in units of what separates two models, each further unit worth less [1]."""
    share = gain / separable_from()
    return math.log1p(share) if share > 0.0 else share


@dataclass(frozen=True, slots=True)
class Search:
    """All that the search for one run needs."""

    template: Reading
    """A run with the channels and the temperature of the next."""
    rig: Rig
    goal: Goal[CandidateModel]
    limits: RunLimits
    before: Information | None
    """Of the runs that are already proposed."""

    def total(self, added: Information) -> Information:
        """Return the information with that of the runs that are already proposed."""
        return added if self.before is None else self.before.plus(added)

    def ranges(self, choice: RouteChoice) -> Iterator[Range]:
        """Yield how far the drive may go on a route by the first model."""
        model = self.goal.models[0]
        return SlowStroke(choice.route, self.template, self.rig, model, self.limits).ranges()

    def tried(self, choice: RouteChoice, within: Range, waveform: Waveform) -> Designed | None:
        """Return a run; None where it goes beyond a limit, or a model has no equilibrium."""
        course = course_of(waveform, within)
        if course is None:
            return None
        try:
            run = predicted(self.reading(choice, course), self.rig, self.goal.models)
        except TssgeomError:
            return None
        fits = all(self._allowed(course.time, channels) for channels in run.channels)
        return Designed(choice, course, waveform, run) if fits else None

    def reading(self, choice: RouteChoice, course: Course) -> Reading:
        """Return the run as a reading whose measured channels are zero."""
        given = {"time_s": course.time, self.template.drive: course.drive[:, 0]}
        if "temperature_C" in self.template.given:
            level = float(np.mean(self.template.given["temperature_C"]))
            given["temperature_C"] = np.full(len(course.time), level)
        measured = {name: np.zeros(len(course.time)) for name in self.template.measured}
        return replace(
            self.template, name="proposed", route=choice.route, held_out=False, given=given, measured=measured
        )

    def _allowed(self, time: Vector, channels: Mapping[str, Vector]) -> bool:
        tension, position = channels["tension_in_N"], channels["displacement_in_m"]
        return bool(
            tension.max() <= EFFORT.over * self.limits.tension_N
            and tension.min() >= self.limits.least_tension_N / EFFORT.over
            and 1e3 * np.abs(position).max() <= EFFORT.over * self.limits.travel_mm
            and 1e3 * top_speed(time, position) <= EFFORT.over * self.limits.speed_mm_per_s
        )

    def white(self, design: Designed) -> float:
        """Return what a run is worth with white noise alone [1]."""
        return self.goal.score(
            self.total(information_of(linear(design.run, self.goal.models), self.goal.models))
        )

    def whole(self, design: Designed) -> tuple[float, Designed, Information]:
        """Return what a run is worth with all errors, and that run."""
        run = with_errors(linear(design.run, self.goal.models), self.goal.models[0])
        added = information_of(run, self.goal.models)
        return self.goal.score(self.total(added)), replace(design, run=run), added


def best_run(
    search: Search, choices: Sequence[RouteChoice], rng: np.random.Generator, share: float = 1.0
) -> tuple[float, Designed, Information]:
    """Return the best run on any of some routes, its worth and its information.

    Parameters
    ----------
    search, choices
        What is searched for, and the routes.
    rng
        Random numbers; the same give the same run.
    share
        Of the usual effort.

    Raises
    ------
    SettingsError
        Where the limits leave no run.
    """
    ranges = [(choice, within) for choice in choices for within in search.ranges(choice)]

    def tried(k: int) -> Designed | None:
        choice, within = ranges[k % len(ranges)]
        return search.tried(choice, within, random_waveform(rng))

    sketched = list(sketches(tried, round(share * EFFORT.sketched))) if ranges else []
    if not sketched:
        raise forbidding(search.limits)
    sketched.sort(key=search.white, reverse=True)
    best = max((search.whole(each) for each in sketched[: SEARCH.refitted]), key=lambda each: each[0])
    within = dict(ranges)
    for _ in range(round(share * EFFORT.improved)):
        near = varied_waveform(best[1].waveform, rng)
        choice = best[1].choice
        design = search.tried(choice, within[choice], near)
        if design is not None and (judged := search.whole(design))[0] > best[0]:
            best = judged
    return best


def sketches(tried: Callable[[int], AnyDesigned | None], count: int) -> Iterator[AnyDesigned]:
    """Yield at most so many runs that fit, of those that are tried one after the other."""
    made = 0
    for k in range(count * EFFORT.attempts):
        if made >= count or (made == 0 and k > count * EFFORT.attempts // 4):
            return
        design = tried(k)
        if design is not None:
            made += 1
            yield design


def in_the_way(
    search: Search, choices: Sequence[RouteChoice], standing: int, seed: int
) -> tuple[str, float, list[int]] | None:
    """Return which limit stands against separating the models, a wider one, and what that would show.

    Parameters
    ----------
    search, choices
        What is searched for, and the routes.
    standing
        How many models the runs are expected to show as it is.
    seed
        Of the search.
    """
    out = list[tuple[str, float, list[int]]]()
    for key, factor in EFFORT.widening.items():
        wider = replace(search, limits=search.limits.widened(key, factor))
        try:
            _, _, added = best_run(wider, choices, np.random.default_rng(seed), EFFORT.wider)
        except SettingsError:
            continue
        out.append((key, getattr(wider.limits, key), sorted(search.goal.standing(search.total(added)))))
    best = max(out, key=lambda each: len(each[2]), default=None)
    return best if best is not None and len(best[2]) > standing else None
