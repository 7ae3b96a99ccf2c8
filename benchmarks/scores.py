"""Trials of a cell, scored against the truth, and their tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from benchmarks import ABSENT, number, share, table
from benchmarks.estimators import OURS, PEERS, SLOW, Bound, Estimate, Sighting, cramer_rao, first_pull
from tests.known_routes import Cell, Draw, Truth, draw
from tssgeom.statistics import NORMAL_95

_LAYOUTS = 20  # draws of stations over which the bound is averaged
_GRID = 501  # stations at which φ(s) is compared
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
    """Message of the first failure."""


def run(cell: Cell, trials: Sequence[int]) -> dict[str, Outcome]:
    """Run some trials of a cell with every estimator."""
    outcomes: dict[str, tuple[list[Score], list[str]]] = {name: ([], []) for name in METHODS}
    for trial in trials:
        sensed = draw(cell, trial)
        for name, method in METHODS.items():
            if name in SLOW and not _thin(cell, trial):
                continue
            try:
                estimate = method(_sighting(cell, sensed))
                outcomes[name][0].append(_score(estimate, sensed.truth, thin=_thin(cell, trial)))
            except Exception as error:  # whatever an estimator dies of is a result here
                outcomes[name][1].append(f"{type(error).__name__}: {error}")
    return {name: Outcome(tuple(scores), tuple(failures)) for name, (scores, failures) in outcomes.items()}


def _thin(cell: Cell, trial: int) -> bool:
    """Whether slow peers run this trial."""
    return cell.n <= _SLOW_POINTS or trial % _SLOW_SHARE == 0


def _sighting(cell: Cell, sensed: Draw) -> Sighting:
    return Sighting(
        points=sensed.points.copy(),
        stations=sensed.station.copy() if cell.stations == "known" else None,
        noise=cell.noise if cell.noise_known else None,
        true_noise=cell.noise,
        source="smoothed" if cell.shared[0] else "markers",
    )


def _score(estimate: Estimate, truth: Truth, *, thin: bool) -> Score:
    at = np.linspace(0.0, truth.length, _GRID)
    off = np.interp(at, estimate.s, estimate.phi) - np.interp(at, truth.s, truth.phi)
    unit = truth.total_angle or 1.0
    angle = (estimate.total_angle - truth.total_angle) / unit
    elongation = estimate.elongation - first_pull(np.diff(truth.s), np.diff(truth.phi))
    if not np.isfinite([angle, elongation, *off]).all():
        raise FloatingPointError("the answer is not finite")
    worst = max(float(np.max(np.abs(off))) / unit, abs(angle))
    return Score(
        angle, estimate.angle_se / unit, worst, elongation, estimate.elongation_se, estimate.pieces, thin
    )


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
    return float(np.mean(np.abs(error) <= NORMAL_95 * se))


def bound(cell: Cell, trials: int) -> Bound:
    """Cramér–Rao bound of a cell over its draws of stations, in units of `Summary`; NaN without pieces."""
    layouts = [draw(cell, trial) for trial in range(1 if _one_layout(cell) else min(trials, _LAYOUTS))]
    known = cell.stations == "known"
    bounds = [
        cramer_rao(course, sensed.station[sensed.good], cell.noise, stations_known=known)
        for sensed in layouts
        if (course := sensed.truth.course) is not None
    ]
    if not bounds:
        return Bound(np.nan, np.nan)
    columns = np.array([(one.angle, one.elongation) for one in bounds]).T
    return Bound(_rms(columns[0]) / (layouts[0].truth.total_angle or 1.0), _rms(columns[1]))


def _one_layout(cell: Cell) -> bool:
    return cell.stations in ("known", "even") and not cell.outliers and not cell.gap


_DETAILS = (
    "cell",
    "estimator",
    "trials",
    "failed",
    "rms",
    "/bound",
    "bias",
    "worst",
    "φ(s)",
    "δ [µm]",
    "95 % Φ",
    "95 % δ",
    "count",
)


@dataclass(frozen=True, slots=True)
class Result:
    """All estimators on one cell."""

    cell: Cell
    bound: Bound
    """Of Φ in units of Φ or, on a line, in rad; of the elongation [m]; NaN where there is none."""
    shortest: float
    """Points on the shortest piece, 0 where the route has no pieces."""
    summaries: Mapping[str, Summary]

    @property
    def unit(self) -> float:
        """What turns angles into the unit that is printed: per cent, or mrad on a line."""
        return 1000.0 if self.cell.route == "line" else 100.0

    @property
    def best_peer(self) -> str:
        """The peer with the least rms error of Φ."""
        return min(PEERS, key=lambda name: _or_infinite(self.summaries[name].rms_thin))

    @property
    def label(self) -> str:
        """Name of the cell, with the unit of its angles where that is not per cent."""
        return f"{self.cell.name} [mrad]" if self.cell.route == "line" else self.cell.name


def _or_infinite(x: float) -> float:
    return x if np.isfinite(x) else np.inf


def matrix(results: Sequence[Result], *, markdown: bool) -> str:
    """Root mean square error of Φ, cells by estimators, in per cent (mrad on a line)."""
    rows = [
        [
            result.label,
            number(result.bound.angle * result.unit),
            *(number(result.summaries[name].rms * result.unit) for name in METHODS),
        ]
        for result in results
    ]
    return table(["rms of Φ [%]", "bound", *METHODS], rows, text_columns=1, markdown=markdown)


def details(results: Sequence[Result], *, every: bool, markdown: bool) -> str:
    """Everything else, for this project and its best peer, or for all; then the messages of failures."""
    rows: list[list[str]] = []
    notes: list[str] = []
    for result in results:
        names = list(METHODS) if every else [*OURS, result.best_peer]
        rows.append(_bound_row(result))
        rows += [_row(result, name) for name in names]
        notes += [
            f"{name} failed {one.failed} times in {' '.join(result.label.split())}: {one.failure}"
            for name, one in result.summaries.items()
            if one.failed
        ]
    rendered = table(_DETAILS, rows, text_columns=2, markdown=markdown)
    return "\n".join([rendered, *notes])


def _bound_row(result: Result) -> list[str]:
    row = [result.label, "bound", *[ABSENT] * (len(_DETAILS) - 2)]
    row[4], row[9] = number(result.bound.angle * result.unit), number(result.bound.elongation * 1e6)
    return row


def _row(result: Result, name: str) -> list[str]:
    one, unit = result.summaries[name], result.unit
    ratio = one.rms / result.bound.angle if result.bound.angle > 0 else np.nan
    return [
        "",
        name,
        str(one.trials),
        str(one.failed),
        number(one.rms * unit),
        number(ratio) if np.isfinite(result.bound.angle) else ABSENT,
        number(one.bias * unit),
        number(one.worst * unit),
        number(one.phi * unit),
        number(one.elongation * 1e6),
        share(one.coverage),
        share(one.elongation_coverage),
        share(one.right_count),
    ]
