"""Which mechanism explains a disagreement best so far; docs/model.md (207)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from tssgeom.adapt.ensemble import Ensemble
from tssgeom.adapt.hypotheses import Hypothesis, hypotheses
from tssgeom.adapt.moments import RunFromHere, TendonFromHere, grown
from tssgeom.adapt.readings import Moment, noise_variance
from tssgeom.adapt.rig_filter import RigFilter
from tssgeom.errors import TssgeomError
from tssgeom.least_squares import SOLVER, Problem, search
from tssgeom.plausibility.limits import LIMITS


class DiagnosisSettings(NamedTuple):
    """Numbers of the search for a mechanism."""

    still: float = 9.0
    """Noises within which all readings of a sensor that stands lie [1]; chosen: 1000 readings of noise lie
    in 7."""
    moved: float = 30.0
    """Noises by which the other sensor at the drive moves meanwhile [1]; chosen."""
    senseless: float = 100.0
    """Mean square that the best mechanism leaves from which a sensor is at fault [1]. Measured: faults of
    machines leave less than 16, readings that make no sense more than 200."""


DIAGNOSIS = DiagnosisSettings()
SLICE = 8
"""Frames that a filter takes in between two frames of a stream [1]; measured: 3 ms."""


@dataclass(frozen=True, slots=True)
class Explanation:
    """A mechanism, and what it makes of the last seconds."""

    mechanism: str
    """As in reports of `discover`: `friction_over_time`, `strain_over_time`, `route_angle`, `play_at_drive`,
    `sensor`, `sensed_angle`."""
    where: str
    """On what it acts, or which channel."""
    probability: float
    """Among those that were tried [1]."""
    sentence: str
    """In plain words, with its size."""
    filter: Ensemble | None
    """The rig with it, followed up to now, or without the sensor at fault; of the likeliest alone."""


@dataclass(slots=True)
class _Fit:
    """The best values of a hypothesis so far, in prior standard deviations from where they start."""

    hypothesis: Hypothesis
    u: np.ndarray
    chi2: float
    covariance: np.ndarray

    @property
    def values(self) -> list[float]:
        numbers = zip(self.hypothesis.numbers, self.u.tolist(), strict=True)
        return [one.value + one.sd * u for one, u in numbers]

    @property
    def log_evidence(self) -> float:
        """Laplace's approximation with a standard normal prior of its numbers."""
        return 0.5 * (float(np.linalg.slogdet(self.covariance)[1]) - self.chi2)


class Means(NamedTuple):
    """What the comparison of mechanisms needs of one tendon, or of a machine."""

    run: Callable[[Any, Sequence[Moment]], RunFromHere]
    """The last seconds after a filter."""
    hypotheses: Callable[[Any, Sequence[Moment], float], Iterator[Hypothesis]]
    stopped: Callable[[Any, Sequence[Moment]], tuple[str, str] | None]
    """The sensor that stands while it should not, and that in words."""
    may_mute: Callable[[RunFromHere, str], bool]
    """Whether a channel can be left out."""


def explained(
    start: Ensemble, moments: Sequence[Moment], since: float, by: Means
) -> Iterator[tuple[Explanation, ...] | None]:
    """Yield None after each slice of work, and at last the explanations, the likeliest first.

    Parameters
    ----------
    start
        The filter as it was before the disagreement.
    moments
        What came in, before that too.
    since
        When it began [s].
    by
        How.
    """
    sound = start.copied()
    yield from _through(sound, [one for one in moments if start.time < one.time < since])
    after = [one for one in moments if one.time >= since]
    if not after:
        yield ()
        return
    stopped = by.stopped(sound, after)
    if stopped is not None:
        yield from _without(sound, after, *stopped)
        return
    run = by.run(sound, after)
    stands = _standing(run, sound)
    if stands is not None:
        yield from _without(sound, after, *stands)
        return
    fits = list[_Fit]()
    for hypothesis in by.hypotheses(sound, moments, since):
        for fit in _fitted(run, hypothesis):
            yield None
            if fit is not None:
                fits.append(fit)
    if not fits:
        yield ()
        return
    scale = max(1.0, min(fit.chi2 for fit in fits) / run.count)  # what the best one leaves, none explains
    if scale > DIAGNOSIS.senseless:
        where, without = _senseless(run, sound, by)
        if without is not None:
            yield from _through(without, after)
        words = f"{where} reads what no mechanism explains"
        yield (Explanation("sensor", where, 1.0, words, without),)
        return
    ranks = np.array([fit.hypothesis.log_prior + fit.log_evidence / scale for fit in fits])
    order = np.argsort(-ranks)
    fits, weights = [fits[i] for i in order], np.exp(ranks[order] - ranks.max())
    shares = dict[str, float]()  # of a mechanism, wherever it acts
    for fit, weight in zip(fits, weights / weights.sum(), strict=True):
        shares[fit.hypothesis.mechanism] = shares.get(fit.hypothesis.mechanism, 0.0) + float(weight)
    first = max(shares, key=lambda one: shares[one])
    best = next(fit for fit in fits if fit.hypothesis.mechanism == first)
    followed = _followed(sound, best)
    yield from _through(followed, after)
    likeliest = {one: next(fit for fit in fits if fit.hypothesis.mechanism == one) for one in shares}
    yield tuple(
        Explanation(
            mechanism,
            fit.hypothesis.where,
            shares[mechanism],
            fit.hypothesis.words.format(*fit.values),
            followed if fit is best else None,
        )
        for mechanism, fit in sorted(likeliest.items(), key=lambda each: -shares[each[0]])
    )


def _without(
    sound: Ensemble, after: Sequence[Moment], channel: str, words: str
) -> Iterator[tuple[Explanation, ...] | None]:
    """Go on without a sensor that is at fault."""
    sound.muted.add(channel)
    yield from _through(sound, after)
    yield (Explanation("sensor", channel, 1.0, words, sound),)


def _standing(run: RunFromHere, sound: Ensemble) -> tuple[str, str] | None:
    """Return the sensor that stands where the rig moves what it reads, and that in words."""
    rig = sound.rig_now()
    distances = run.distances(rig)
    for name, read, predicted in run.ranges(rig):
        others = [one for channel, one in distances.items() if channel != name]
        if (
            len(read) >= LIMITS.fewest_rows
            and np.ptp(read) <= DIAGNOSIS.still
            and np.ptp(predicted) > DIAGNOSIS.moved
            and all(one < math.sqrt(DIAGNOSIS.senseless) for one in others)
        ):
            noise = math.sqrt(noise_variance(sound.rig.sensors.get(name)))
            moved = f"{np.ptp(predicted) * noise:.3g}"
            return (
                name,
                f"{name} stands at {read[-1] * noise:.4g} while the rig moves what it reads by {moved}",
            )
    return None


def _senseless(run: RunFromHere, sound: Ensemble, by: Means) -> tuple[str, Ensemble | None]:
    """Return which sensor reads what no mechanism gives, and the filter to go on with, if any, without it."""
    distances = run.distances(sound.rig_now())
    far = [name for name, one in distances.items() if one > math.sqrt(DIAGNOSIS.senseless)]
    drive = run.drives[0]
    if len(distances) == 1:  # it or the drive: either may be wrong
        return f"{next(iter(distances))} or {drive}", None
    where = far[0] if len(far) == 1 else drive
    if not by.may_mute(run, where):
        return where, None
    followed = sound.copied()
    followed.muted.add(where)
    return where, followed


def _through(followed: Ensemble, moments: Sequence[Moment]) -> Iterator[None]:
    """Take a filter through moments, in slices."""
    for i, moment in enumerate(moments):
        followed.step(moment)
        if i % SLICE == SLICE - 1:
            yield None


def _followed(sound: Ensemble, best: _Fit) -> Ensemble:
    """Return the filter with the numbers of the best fit followed too, from where they are."""
    one = best.hypothesis
    if one.mutes:
        followed = sound.copied()
        followed.muted.add(one.where)
        return followed
    if one.length > 0.0:
        if "friction.coefficient" in sound.keys:  # the mean over the route is followed
            at = sound.keys.index("friction.coefficient")
            sound.reopen(np.eye(len(sound.keys))[at] * 0.5 * sound.values[at])
        return sound
    se = np.sqrt(np.diag(best.covariance)).tolist()
    sought = {
        number.key: replace(
            number,
            value=value,
            sd=max(2.0 * u * number.sd, 0.02 * number.sd),
            hourly_change=max(number.hourly_change, number.sd),  # what has begun may go on
        )
        for number, value, u in zip(one.numbers, best.values, se, strict=True)
    }
    followed = sound.with_more([new for key, new in sought.items() if key not in sound.keys], one.rig)
    known = {key: new.value for key, new in sought.items() if key in sound.keys}
    followed.set_numbers(known, {key: sought[key].sd for key in known})
    return followed


def _fitted(run: RunFromHere, one: Hypothesis) -> Iterator[_Fit | None]:
    """Yield None before each trial, and at last the fit, if any."""
    lower, upper = (
        np.array([(getattr(each, side) - each.value) / each.sd for each in one.numbers])
        for side in ("lower", "upper")
    )

    def model(u: np.ndarray) -> tuple[np.ndarray, None] | None:
        values = [number.value + number.sd * float(x) for number, x in zip(one.numbers, u, strict=True)]
        try:
            return run.left(one.rig_with(values)), None
        except TssgeomError:
            return None

    given = Problem(model, np.eye(len(one.numbers)), lower, upper, step=SOLVER.coarse_step, huber=run.huber)
    end = yield from search(given, np.maximum(SOLVER.coarse_step, lower))
    if end is not None:
        yield _Fit(one, end.u, end.chi2, end.covariance)


def _stopped_sensor(sound: RigFilter, after: Sequence[Moment]) -> tuple[str, str] | None:
    """Return the sensor at the drive that stands while the other one there moves, and that in words."""
    late = grown(after)
    pairs = [(one.readings.displacement_in, one.readings.tension_in) for one in late]
    if len(pairs) < LIMITS.fewest_rows or any(None in pair for pair in pairs):
        return None
    names, units = ("displacement_in_m", "tension_in_N"), ("m", "N")
    readings = np.array(pairs, dtype=np.float64).T
    moved = np.ptp(readings, axis=1)
    noise = np.array([math.sqrt(noise_variance(sound.rig.sensors.get(name))) for name in names])
    for which, other in ((0, 1), (1, 0)):
        if moved[which] <= DIAGNOSIS.still * noise[which] and moved[other] > DIAGNOSIS.moved * noise[other]:
            stands = f"{names[which]} stands at {readings[which, -1]:.4g} {units[which]}"
            return names[which], f"{stands} while {names[other]} moves by {moved[other]:.3g} {units[other]}"
    return None


def _may_mute(run: RunFromHere, where: str) -> bool:
    return where != "tension_in_N" or run.drives != (where,)


OF_TENDON = Means(TendonFromHere, hypotheses, _stopped_sensor, _may_mute)
