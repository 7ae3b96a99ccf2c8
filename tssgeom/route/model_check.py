"""Whether the estimator behind a tracked route is still the right one, tested in steps between frames.

A check is made of the points of one frame. Where a chain is tried beside a spline, which takes milliseconds,
a step is made after each frame that follows, so that none waits for more than one fit of a candidate. What
it selects is where the next frame starts; docs/model.md (34).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, TypeAlias

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.core.constants_arcs import CHAIN_MOVES
from tssgeom.core.constants_route import PASSES
from tssgeom.errors import FitError
from tssgeom.route.arcs.chain import Chain, Data, fit_fixed_pieces
from tssgeom.route.arcs.moves import finer_tried, fit_chain_in_steps, simpler_tried, work_of_promises
from tssgeom.route.error_posterior import NO_POSTERIOR, ErrorPosterior
from tssgeom.route.fibre.noise import LastNoise
from tssgeom.route.geometry import chain_data, chain_fit, first_chain, spline_fit, with_few_points_variance
from tssgeom.route.model_average import added_in_steps
from tssgeom.route.model_choice import CHOICE, chain_evidence, evidence_difference, preference
from tssgeom.route.observations import Shape
from tssgeom.route.route_fit import NO_ERRORS, RouteFit, SharedErrors
from tssgeom.route.spline.fit import fit_in_steps
from tssgeom.route.spline.spline import Spline
from tssgeom.route.time_filter import PointFilter
from tssgeom.statistics import EVIDENCE_SCALE


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


@dataclass(frozen=True, slots=True)
class TrackedFit:
    """Fit of the last frame, and what the next one needs to go on from it."""

    fit: RouteFit
    index: Vector
    """Count of each fitted point in the sensed sequence."""
    age: int = 0
    """Frames since the other estimator was tried."""
    interval: int = SCHEDULE.first_interval
    """Frames after which it is tried again."""
    checks: int = 2
    """Checks of the joints of a chain since they changed."""
    candidate: Chain | Spline | None = None
    """What may take over: a chain under trial, or the spline of the last trial."""
    by_models: SharedErrors = NO_ERRORS
    """Variances from the choice between the two, and from forms that no point shows."""
    trials: int = 0
    """Checks that the candidate chain has gone through."""
    run: CheckRun | None = None
    """The check that is under way."""
    frames: int = 0
    """Frames that it has taken so far."""
    due: bool = False
    """Whether the steps that follow this frame are still to be made."""
    warm_only: bool = False
    """Whether the next fit may only go on from here: one from nothing takes ten times as long."""
    marker_axis: Vector | None = None
    """First axis across the route at the first marker, where markers sit beside the route [3]."""
    filtered: PointFilter | None = None
    """The points as filtered in time, where they are."""
    sensed_over_fitted: float = 1.0
    """Noise of the sensed points over that of those that were fitted [1]."""
    noise_growth: float = 1.0
    """Noise that the next fit is expected to find over that of this one [1]."""
    first_noise: float = 0.0
    """Noise of the fit from which the warm ones began [m]."""
    first_left: float = 0.0
    """Noise that the filter left of the points of that fit [m]."""
    noise_bounded: bool = False
    """Whether fits of few points went astray, so that the noise is taken from differences in time."""
    noise_of_time: bool = False
    """Whether few points showed less noise than the filter leaves, so that it is taken from that."""
    noise_contradicted: bool = False
    """Whether the points contradict the noise that is stated of them, so that it is estimated."""
    direction_noise: float = 0.0
    """Noise of a component of sensed directions that was estimated [rad]."""
    fibre_noise: LastNoise | None = None
    """Noise of the curvatures of a fibre that was estimated."""
    errors: ErrorPosterior = NO_POSTERIOR
    """What errors that neighbouring points share mean for the fit."""

    is_stale: bool = False
    """Whether few points went over to another estimator, whose errors are those of the route as it was."""

    @property
    def has_noise_of_time(self) -> bool:
        """Whether few points were taken for a sharper route than their noise in time leaves; (272)."""
        if self.filtered is None or not self.fit.is_of_few:
            return False
        return self.noise_of_time or PASSES.warm_noise * self.fit.noise**2 < self.filtered.noise**2

    def is_outdated(self, now: PointFilter) -> bool:
        """Whether a fit from nothing shows more: points were exchanged, or few have so little noise left."""
        return now.reordered or (self.fit.is_of_few and PASSES.warm_noise * now.noise**2 < self.first_left**2)

    @classmethod
    def of(cls, fit: RouteFit, index: Vector) -> TrackedFit:
        """Begin with a fit that was made from nothing."""
        return cls(fit, index, by_models=fit.by_models)

    def beside(self, fit: RouteFit) -> RouteFit:
        """Return the fit of a later frame with these variances added."""
        return replace(self.by_models.of_stream(fit), turned=self.fit.turned)

    def with_check(self, check: ModelCheck | None) -> TrackedFit:
        """Begin a check, where there is one."""
        if check is None:
            return self
        # joints are tried at once: those of a route that slides are soon wrong
        work = math.inf if check.candidate == "joints" else CHAIN_MOVES.work_of_any
        return replace(self, run=CheckRun(_steps(check, self), work), frames=0, due=True)


Outcome: TypeAlias = Callable[[TrackedFit], TrackedFit]
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


def model_checked(last: TrackedFit) -> TrackedFit:
    """Make the steps of a check that are due after a frame; its end may select another estimator or joints.

    `follow` does so itself where it was not done; to have it done between two frames changes nothing else.
    """
    if not last.due or last.run is None:
        return last
    outcome = last.run.after(last.frames + 1)
    if outcome is None:
        return replace(last, frames=last.frames + 1, due=False)
    return replace(outcome(last), run=None, frames=0, due=False)


def _unchanged(now: TrackedFit) -> TrackedFit:
    return now


def _steps(check: ModelCheck, begun: TrackedFit) -> Steps:
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
        return partial(_taken_over, TrackedFit(smooth, check.shape.index, by_models=added))
    return partial(_not_taken_over, -difference, spline, added)


def _taken_over(taken: TrackedFit, now: TrackedFit) -> TrackedFit:
    """Go on with the other estimator, unless it is the one that is tracked by now."""
    if (taken.fit.chain is None) == (now.fit.chain is None):
        return now
    is_stale = taken.fit.is_of_few
    return replace(taken, marker_axis=now.marker_axis, filtered=now.filtered, is_stale=is_stale)


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
        begins = TrackedFit(arcs, check.shape.index, candidate=spline, by_models=added)
        return partial(_taken_over, begins)
    return partial(_not_taken_over, difference, None, added)
