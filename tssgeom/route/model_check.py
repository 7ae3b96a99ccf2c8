"""Whether the estimator behind a tracked route is still the right one, tested in steps between frames.

A check is made of the points of one frame. Where a chain is tried beside a spline, which takes milliseconds,
a step is made after each frame that follows, so that none waits for more than one fit of a candidate. What
it selects is where the next frame starts; docs/model.md (34).
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.errors import FitError
from tssgeom.route.arcs.chain import Chain, Data, fit_fixed_pieces
from tssgeom.route.arcs.moves import finer_tried, fit_chain_in_steps, simpler_tried, work_of_promises
from tssgeom.route.arcs.summary import chain_fit
from tssgeom.route.geometry import chain_data, first_chain, spline_fit, with_few_points_variance
from tssgeom.route.model_average import added_in_steps
from tssgeom.route.model_choice import CHOICE, chain_evidence, evidence_difference, preference
from tssgeom.route.observations import Shape
from tssgeom.route.route_fit import RouteFit, SharedErrors
from tssgeom.route.spline.fit import fit_in_steps
from tssgeom.route.spline.spline import Spline
from tssgeom.statistics import EVIDENCE_SCALE

if TYPE_CHECKING:
    from tssgeom.route.tracking import TrackedFit


@dataclass(frozen=True, slots=True)
class TrackingSchedule:
    """When which model is checked while a route is tracked; docs/model.md (34). Evidence counts as 2 ln."""

    interval: int = 4
    """Frames between two checks of a chain, for fewer joints and for more in turn. Chosen: by latency."""
    first_interval: int = 16
    """Frames after which the other estimator is tried. Chosen: by latency."""
    longest_interval: int = 512
    """The same where the other was far behind again and again [frames]. Chosen."""
    moves: int = 2
    """Moves of a candidate chain in one check. Chosen: by latency."""


SCHEDULE = TrackingSchedule()


@dataclass(frozen=True, slots=True)
class ModelCheck:
    """What is to be checked, by the points of one frame."""

    shape: Shape
    noise: float | None
    """Known standard deviation of each coordinate [m]."""
    candidate: Literal["spline", "chain", "joints"]
    """What is tried: a spline, a chain, or other joints of the chain that is tracked."""
    data: Data | None = None
    """The points as given to the chain; None where a spline was tracked."""


Outcome: TypeAlias = Callable[["TrackedFit"], "TrackedFit"]
"""What a check changes of what is tracked when it ends, some frames after it began."""
Steps: TypeAlias = Generator[float, None, Outcome]


class CheckRun:
    """A check under way. Asked twice for the same frame, it gives the same answer."""

    def __init__(self, steps: Steps, work: float) -> None:
        self._steps, self._work, self._frames, self._outcome = steps, work, 0, None

    def after(self, frames: int) -> Outcome | None:
        """Make the steps of so many frames in all; return what they change, or None before the last one."""
        while self._frames < frames and self._outcome is None:
            self._frames += 1
            work = 0.0
            try:
                while work < self._work:
                    work += next(self._steps)
            except StopIteration as ended:
                self._outcome = ended.value
            except FitError:  # a candidate that cannot be fitted is no better than what is tracked
                self._outcome = _unchanged
        return self._outcome if self._frames <= frames else None


def _unchanged(now: TrackedFit) -> TrackedFit:
    return now


def steps_of(check: ModelCheck, begun: TrackedFit) -> Steps:
    """Choose the check of what was tracked when it began."""
    chain = begun.fit.chain
    if check.data is None or chain is None:
        return _chain_tried(check, begun)
    if check.candidate == "spline":
        return _spline_tried(check, check.data, chain, begun)
    return _joints_tried(check, check.data, chain, begun.checks)


def _joints_tried(check: ModelCheck, data: Data, chain: Chain, checks: int) -> Steps:
    """Try fewer joints and more in turn, some of them that are unlikely."""
    count, more_joints = divmod(checks, 2)
    rank, now = divmod(count, SCHEDULE.interval)
    rank %= SCHEDULE.interval
    unlikely = slice(rank, rank if now else rank + 1)
    for work, better in (finer_tried if more_joints else simpler_tried)(data, chain, unlikely):
        yield work
        if better is not None:
            better = yield from fit_chain_in_steps(data, better, SCHEDULE.moves - 1)
            return partial(_with_joints, check, chain, better)
    return partial(_with_joints, check, chain, None)


def _with_joints(check: ModelCheck, begun: Chain, better: Chain | None, now: TrackedFit) -> TrackedFit:
    """Go on with the better chain, unless another one is tracked by now."""
    chain = now.fit.chain
    if chain is None or len(chain.bend) != len(begun.bend):
        return now
    if better is None:
        return replace(now, checks=now.checks + 1)
    if now.index is not check.shape.index:
        better = better._replace(stations=chain.stations)
    return replace(now, fit=replace(now.fit, chain=better), checks=0)


def _spline_tried(check: ModelCheck, data: Data, chain: Chain, begun: TrackedFit) -> Steps:
    """Let a spline take over from a chain, or drop it for the time being.

    It starts from the last one, which may be old: its first fit only brings it up to date.
    """
    before = begun.candidate if isinstance(begun.candidate, Spline) else None
    spline = yield from fit_in_steps(check.shape, check.noise, before)
    if before is not None and begun.age == begun.interval:
        return partial(replace, candidate=spline)
    yield work_of_promises(data, chain)
    difference = preference(data, chain, spline, chain_evidence(data, chain, spline))
    smooth = replace(spline_fit(spline), turned=begun.fit.turned)
    arcs = chain_fit(check.shape, data, chain)
    taken = difference < -EVIDENCE_SCALE.very_strong
    yield work_of_promises(data, chain)
    added = yield from added_in_steps(smooth if taken else arcs, smooth, [(data, chain)])
    if taken:
        return partial(_taken_over, smooth, check.shape.index, None, added)
    return partial(_not_taken_over, -difference, spline, added)


def _taken_over(
    fit: RouteFit, index: Vector, candidate: Spline | None, added: SharedErrors, now: TrackedFit
) -> TrackedFit:
    """Go on with the other estimator, unless it is the one that is tracked by now."""
    if (fit.chain is None) == (now.fit.chain is None):
        return now
    return now.taken_over(fit, index, candidate, added)


def _not_taken_over(
    difference: float, candidate: Spline | None, added: SharedErrors, now: TrackedFit
) -> TrackedFit:
    """Keep the model. `difference` is the candidate's log evidence less that of the model [2 ln]."""
    interval = SCHEDULE.first_interval
    if difference < CHOICE.hopeless:
        interval = min(2 * now.interval, SCHEDULE.longest_interval)
    return replace(now, age=0, interval=interval, candidate=candidate, trials=0, by_models=added)


def _chain_tried(check: ModelCheck, begun: TrackedFit) -> Steps:
    """Let a chain take over from a spline, give it a few more moves, or drop it for the time being."""
    spline = begun.fit.spline
    if spline is None:
        return _unchanged
    # without the variances that earlier checks added
    smooth = with_few_points_variance(spline_fit(spline), check.shape)
    smooth = replace(smooth, turned=begun.fit.turned)
    data = chain_data(check.shape, check.noise, spline)
    if isinstance(begun.candidate, Chain):
        first = begun.candidate._replace(stations=np.array(spline.route.station))
    else:
        first = first_chain(data, smooth)
    candidate = fit_fixed_pieces(data, first)
    yield work_of_promises(data, candidate)
    moved = yield from fit_chain_in_steps(data, candidate, SCHEDULE.moves)
    difference = evidence_difference(data, moved, spline)
    converged = len(moved.bend) == len(candidate.bend)
    if difference < CHOICE.hopeless and (converged or begun.trials >= SCHEDULE.interval):
        added = yield from added_in_steps(smooth, smooth, [])
        return partial(_not_taken_over, difference, None, added)
    if not converged:
        return partial(replace, candidate=moved, trials=begun.trials + 1)
    yield work_of_promises(data, moved)
    arcs = replace(chain_fit(check.shape, data, moved), turned=begun.fit.turned)
    difference = preference(data, moved, spline, chain_evidence(data, moved, spline))
    taken = difference > EVIDENCE_SCALE.very_strong
    yield work_of_promises(data, moved)
    added = yield from added_in_steps(arcs if taken else smooth, smooth, [(data, moved)])
    if taken:
        return partial(_taken_over, arcs, check.shape.index, spline, added)
    return partial(_not_taken_over, difference, None, added)
