"""What the fit of a machine predicts of readings that are held out: the last cycles, or else run after run.

Source: docs/model.md (182).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.errors import FitError
from tssgeom.identify.fit_quality import FIT_TEST, spread
from tssgeom.identify.machine_fit import fitted_again
from tssgeom.identify.machine_problem import FitState, Problem, fitted_rows
from tssgeom.statistics import NORMAL_95, root_mean_square


@dataclass(frozen=True, slots=True)
class HeldOutSettings:
    """Which runs are held out."""

    most_runs: int = 8
    """Chosen: the time of twice the fit. Runs that are held out, one after the other [1]."""


HELD_OUT = HeldOutSettings()


class HeldOutMisfit(NamedTuple):
    """How a channel of a run is predicted by a fit without these readings."""

    name: str
    rms: float
    """Of what is left, of a whole run after its zero [unit]."""
    span: float
    """Range of the readings [unit]."""
    noise: float
    """White noise of the readings [unit]."""
    predicted_sd: float
    """Standard deviation of the prediction, rms [unit]."""

    @property
    def passes(self) -> bool:
        """Whether the misfit is small beside the range, the noise, or what the other readings determine."""
        limits = (
            FIT_TEST.most_of_range * self.span,
            FIT_TEST.most_of_noise * self.noise,
            NORMAL_95 * self.predicted_sd,  # below it the runs that are left do not determine it
        )
        return self.rms <= max(limits)


class HeldOut(NamedTuple):
    """What is held out, and how it is predicted."""

    of: str
    """What is held out: `cycles`, `runs`, or nothing."""
    rms: Mapping[str, tuple[float, float]]
    """By channel: rms on samples that are held out, and on those that are fitted without them."""
    misfits: tuple[HeldOutMisfit, ...]


NOTHING_HELD_OUT = HeldOut("", {}, ())


def cycles_held_out(problem: Problem, state: FitState) -> HeldOut:
    """Return how the fit of the first cycles predicts the last ones."""
    away = replace(problem, rows=fitted_rows(problem.runs, held_out=True))
    if not away.rows:  # the last cycles have no readings
        return NOTHING_HELD_OUT
    left, sd = predicted(problem, away, state)
    misfits = tuple(_misfits(away, left, sd))
    return HeldOut("cycles", _rms(problem, state, [(away, left)]), misfits)


def runs_held_out(problem: Problem, state: FitState) -> HeldOut:
    """Return how each run is predicted by the fit of the others; its zeros are its own."""
    count = len(problem.runs)
    if count < 2:
        return NOTHING_HELD_OUT
    at = np.unique(np.linspace(0, count - 1, min(count, HELD_OUT.most_runs)).round().astype(int))
    sides, misfits = list[tuple[Problem, list[Vector]]](), list[HeldOutMisfit]()
    for k in at:
        away = replace(problem, rows=tuple(block for block in problem.rows if block[0] == k))
        rest = replace(problem, rows=tuple(block for block in problem.rows if block[0] != k))
        if not away.rows or not rest.rows:
            continue
        weight = _of(problem, rest, state.weight)
        inflation = state.inflation[[block[0] != k for block in problem.rows]]
        kept = replace(state, left=rest.left(state.channels), weight=weight, inflation=inflation)
        try:
            rest, alone = fitted_again(rest, kept)
        except FitError:
            continue
        away = replace(away, too_few_bars=rest.too_few_bars)
        left, sd = predicted(rest, away, alone)
        sides.append((away, left))
        misfits += _misfits(away, left, sd)
    return HeldOut("runs", _rms(problem, state, sides), tuple(misfits))


def _of(problem: Problem, part: Problem, values: list[Vector]) -> list[Vector]:
    kept = {(k, name) for k, name, _ in part.rows}
    pairs = zip(problem.rows, values, strict=True)
    return [each for (k, name, _), each in pairs if (k, name) in kept]


def predicted(fitted: Problem, away: Problem, state: FitState) -> tuple[list[Vector], list[Vector]]:
    """Return what is left of each block that is held out, and the standard deviation of its prediction.

    The zeros and the start of a run that is not fitted are its own: they are fitted to it, and what they meet
    is no misfit.
    """
    slope = state.slope(fitted)
    covariance = np.asarray(np.linalg.inv(slope.T @ slope + np.eye(len(state.u))), dtype=np.float64)
    left = away.left(state.channels)
    slopes = state.jacobian(away, left)
    runs = {k for k, _, _ in fitted.rows}
    own = np.array([each.run >= 0 and each.run not in runs for each in fitted.parameters])
    scale = np.concatenate([np.full(len(each), 1.0 / max(spread(each), 1e-12)) for each in left])
    off, known = _without(scale * np.concatenate(left), scale[:, None] * slopes, own)
    sd = np.sqrt(np.einsum("ij,jk,ik->i", known, covariance[np.ix_(~own, ~own)], known)) / scale
    edges = np.cumsum([len(each) for each in left])[:-1]
    return np.split(off / scale, edges), np.split(sd, edges)


def _without(left: Vector, slope: Matrix, own: np.ndarray) -> tuple[Vector, Matrix]:
    """Return what is left, and its slopes by the other parameters, after a fit of a run's own ones."""
    of_run, others = slope[:, own], slope[:, ~own]
    if not own.any():
        return left, others
    inverse = np.linalg.inv(of_run.T @ of_run + np.eye(of_run.shape[1])) @ of_run.T
    return left - of_run @ (inverse @ left), others - of_run @ (inverse @ others)


def _misfits(away: Problem, left: list[Vector], sd: list[Vector]) -> Iterator[HeldOutMisfit]:
    for (k, name, at), off, of_prediction in zip(away.rows, left, sd, strict=True):
        values = away.runs[k].measured[name]
        yield HeldOutMisfit(
            f"{name} of {away.runs[k].name}" if len(away.runs) > 1 else name,
            root_mean_square(off),
            float(np.ptp(values[at])),
            away.runs[k].noise[name],
            root_mean_square(of_prediction),
        )


def _rms(
    problem: Problem, state: FitState, sides: list[tuple[Problem, list[Vector]]]
) -> dict[str, tuple[float, float]]:
    """Return by channel the rms on what is held out, and on what is fitted."""
    away, fitted = dict[str, list[Vector]](), dict[str, list[Vector]]()
    for part, left in sides:
        for (_, name, _), off in zip(part.rows, left, strict=True):
            away.setdefault(name, []).append(off)
    for (_, name, _), off in zip(problem.rows, problem.left(state.channels), strict=True):
        fitted.setdefault(name, []).append(off)
    of_fitted = {name: root_mean_square(np.concatenate(off)) for name, off in fitted.items()}
    return {
        name: (root_mean_square(np.concatenate(off)), of_fitted.get(name, math.nan))
        for name, off in away.items()
    }


def contradictions(held: HeldOut) -> Iterator[str]:
    """Yield what is held out and not predicted, a sentence each."""
    what = {"cycles": "the last cycles, held out", "runs": "held out"}.get(held.of, "")
    for each in held.misfits:
        if not each.passes:
            over_noise = each.rms / each.noise if each.noise else math.inf
            yield (
                f"{each.name}, {what}, is predicted within {each.rms / each.span:.1%} of its range and "
                f"{over_noise:.3g} × its noise: the model does not fit; at most "
                f"{FIT_TEST.most_of_range:.0%} or {FIT_TEST.most_of_noise:g} × are accepted"
            )
