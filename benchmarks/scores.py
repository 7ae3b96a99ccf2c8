"""Trials of a cell, scored against the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from benchmarks.bound import Bound, cramer_rao
from benchmarks.cells import Cell, Draw, draw
from benchmarks.elongation import first_pull
from benchmarks.estimate import OURS, Estimate, Sighting
from benchmarks.peers import PEERS, SLOW
from benchmarks.routes import Truth

_LAYOUTS = 20  # draws of stations over which the bound is averaged
_GRID = 501  # stations at which φ(s) is compared
_INTERVAL = 1.959964  # standard errors to both sides that hold 95 %
_SLOW_POINTS, _SLOW_SHARE = 100, 4  # slow peers run every fourth trial of more points than this

METHODS: Mapping[str, Callable[[Sighting], Estimate]] = {**OURS, **PEERS}


class Score(NamedTuple):
    """One estimator in one trial; NaN where it gives no such thing. Angles are in units of Φ."""

    angle: float
    """Error of Φ, on a line in rad as all angles here."""
    angle_se: float
    """Standard error it claims."""
    phi: float
    """Greatest error of φ(s) along the route."""
    elongation: float
    """Error of the elongation [m]."""
    elongation_se: float
    """Standard error it claims [m]."""
    pieces: float
    """Number of pieces, 0 where it gives none."""
    thin: float
    """Whether slow peers have this trial too."""


class Outcome(NamedTuple):
    """One estimator over some trials of a cell."""

    scores: tuple[Score, ...]
    failures: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Summary:
    """One estimator over all trials of a cell; angles are in units of Φ, on a line in rad."""

    trials: int
    failed: int
    rms: float
    """Root mean square error of Φ."""
    rms_thin: float
    """The same over the trials that slow peers have too."""
    bias: float
    """Mean error of Φ."""
    worst: float
    """Greatest error of Φ."""
    phi: float
    """Root mean square over the trials of the greatest error of φ(s)."""
    elongation: float
    """Root mean square error of the elongation [m]."""
    coverage: float
    """Share of 95 % intervals of Φ that hold the truth."""
    elongation_coverage: float
    """Share of 95 % intervals of the elongation that hold the truth."""
    right_count: float
    """Share of trials with the true number of pieces."""
    failure: str
    """What the first failure said."""


def run(cell: Cell, trials: Sequence[int]) -> dict[str, Outcome]:
    """Run some trials of a cell with every estimator."""
    outcomes: dict[str, tuple[list[Score], list[str]]] = {name: ([], []) for name in METHODS}
    for trial in trials:
        seen = draw(cell, trial)
        for name, method in METHODS.items():
            if name in SLOW and not _thin(cell, trial):
                continue
            try:
                found = method(_sighting(cell, seen))
                outcomes[name][0].append(_score(found, seen.truth, thin=_thin(cell, trial)))
            except Exception as error:  # whatever an estimator dies of is a result here
                outcomes[name][1].append(f"{type(error).__name__}: {error}")
    return {name: Outcome(tuple(scores), tuple(failures)) for name, (scores, failures) in outcomes.items()}


def _thin(cell: Cell, trial: int) -> bool:
    """Whether slow peers run this trial."""
    return cell.n <= _SLOW_POINTS or trial % _SLOW_SHARE == 0


def _sighting(cell: Cell, seen: Draw) -> Sighting:
    return Sighting(
        points=seen.points.copy(),
        stations=seen.station.copy() if cell.stations == "known" else None,
        noise=cell.noise if cell.noise_known else None,
        true_noise=cell.noise,
    )


def _score(found: Estimate, truth: Truth, *, thin: bool) -> Score:
    at = np.linspace(0.0, truth.length, _GRID)
    off = np.interp(at, found.s, found.phi) - np.interp(at, truth.s, truth.phi)
    unit = truth.total_angle or 1.0
    angle = (found.total_angle - truth.total_angle) / unit
    elongation = found.elongation - first_pull(np.diff(truth.s), np.diff(truth.phi))
    if not np.isfinite([angle, elongation, *off]).all():
        raise FloatingPointError("the answer is not finite")
    worst = max(float(np.max(np.abs(off))) / unit, abs(angle))
    return Score(angle, found.angle_se / unit, worst, elongation, found.elongation_se, found.pieces, thin)


def summary(outcomes: Sequence[Outcome], pieces: int) -> Summary:
    """Sum up one estimator; `pieces` is the true number of pieces, 0 where there is none."""
    scores = [score for outcome in outcomes for score in outcome.scores]
    failures = [text for outcome in outcomes for text in outcome.failures]
    columns = np.array(scores).reshape(-1, len(Score._fields)).T
    angle, angle_se, phi, elongation, elongation_se, count, thin = columns
    counted = pieces > 0 and bool(np.any(count > 0))
    return Summary(
        trials=len(scores) + len(failures),
        failed=len(failures),
        rms=_rms(angle),
        rms_thin=_rms(angle[thin > 0]),
        bias=_mean(angle),
        worst=float(np.max(np.abs(angle), initial=0.0)) if len(angle) else np.nan,
        phi=_rms(phi),
        elongation=_rms(elongation),
        coverage=_coverage(angle, angle_se),
        elongation_coverage=_coverage(elongation, elongation_se),
        right_count=_mean((count == pieces).astype(float)) if counted else np.nan,
        failure=failures[0] if failures else "",
    )


def _mean(x: np.ndarray) -> float:
    return float(np.mean(x)) if len(x) else np.nan


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(_mean(x * x)))


def _coverage(error: np.ndarray, se: np.ndarray) -> float:
    if not len(se) or np.isnan(se).all():
        return np.nan
    return float(np.mean(np.abs(error) <= _INTERVAL * se))


def bound(cell: Cell, trials: int) -> Bound:
    """Cramér–Rao bound of a cell over its draws of stations, in units of `Summary`; NaN without pieces."""
    layouts = [draw(cell, trial) for trial in range(1 if _one_layout(cell) else min(trials, _LAYOUTS))]
    known = cell.stations == "known"
    bounds = [
        cramer_rao(course, seen.station[seen.good], cell.noise, stations_known=known)
        for seen in layouts
        if (course := seen.truth.course) is not None
    ]
    if not bounds:
        return Bound(np.nan, np.nan)
    columns = np.array([(one.angle, one.elongation) for one in bounds]).T
    return Bound(_rms(columns[0]) / (layouts[0].truth.total_angle or 1.0), _rms(columns[1]))


def _one_layout(cell: Cell) -> bool:
    return cell.stations in ("known", "even") and not cell.outliers and not cell.gap
