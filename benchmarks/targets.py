"""What this project sets itself, and which cells keep it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.report import Result
from benchmarks.scores import Summary
from benchmarks.tables import number, share, table

_CHOSEN = "auto"
_TIMES_BOUND = 1.3
_POINTS_ON_A_PIECE = 5.0
_RIGHT_COUNT = 0.98
_COVERAGE = (0.93, 0.97)
_SMOOTH = {5e-4: 0.007, 1e-4: 0.0025}  # noise [m]: rms error of Φ at 200 points
_QUICK_TIMES_PEER, _QUICK_COVERAGE = 1.3, 0.8
_STRAIGHT = 0.005  # rad


@dataclass(frozen=True, slots=True)
class _Target:
    text: str
    applies: Callable[[Result], bool]
    value: Callable[[Result], float]
    """How much of what is allowed is used: 1 or less where the target is kept."""


def targets(results: Sequence[Result], *, markdown: bool) -> str:
    """Count the cells that keep each target, and name those that do not, worst first."""
    rows, named = [], []
    for target in _TARGETS:
        values = [(target.value(result), result.cell.title) for result in results if target.applies(result)]
        missed = sorted((one for one in values if not one[0] <= 1.0), reverse=True)
        rows.append([target.text, str(len(values) - len(missed)), str(len(values))])
        named += [f"\n{target.text}: missed in"] * bool(missed)
        named += [f"  {number(value, 2):>5} x  {title}" for value, title in missed]
    head = table([f"targets of {_CHOSEN!r}", "kept", "cells"], rows, text_columns=1, markdown=markdown)
    if named:
        named.insert(0, "\nBelow, x is how many times what the target allows.")
    return "\n".join([head, _pooled(results), *named])


def failings(results: Sequence[Result]) -> list[str]:
    """Say what the quick run cannot let pass; small counts allow loose bounds only."""
    wrong = []
    for result in results:
        one, name = result.summaries[_CHOSEN], " ".join(result.label.split())
        if one.failed:
            wrong.append(f"{name}: {_CHOSEN} failed {one.failed} times: {one.failure}")
        if one.coverage < _QUICK_COVERAGE:
            wrong.append(f"{name}: 95 % intervals hold {share(one.coverage)} %, want at least 80 %")
        over = _over_peer(result)
        if result.shortest > 0 and over > _QUICK_TIMES_PEER and not _on_line(result, one):
            wrong.append(f"{name}: rms {number(over)} times that of {result.best_peer}, want at most 1.3")
    return wrong


def _on_line(result: Result, one: Summary) -> bool:
    """Whether a line is called straight for all that matters, which no ratio of errors near zero can say."""
    return result.cell.route == "line" and one.rms < _STRAIGHT


def _chosen(result: Result) -> Summary:
    return result.summaries[_CHOSEN]


def _pooled(results: Sequence[Result]) -> str:
    coverage = [_chosen(result).coverage for result in results]
    right = [x for result in results if np.isfinite(x := _chosen(result).right_count)]
    counts = f", true number of pieces in {100 * np.mean(right):.1f} %" if right else ""
    return f"over all cells: 95 % intervals hold {100 * np.mean(coverage):.1f} %{counts}"


def _enough_points(result: Result) -> bool:
    return result.shortest >= _POINTS_ON_A_PIECE and bool(np.isfinite(result.bound.angle))


def _over_bound(result: Result) -> float:
    return _chosen(result).rms / (_TIMES_BOUND * result.bound.angle)


def _over_peer(result: Result) -> float:
    """Ratio of rms errors on the same trials."""
    return _chosen(result).rms_thin / result.summaries[result.best_peer].rms_thin


def _wrong_counts(result: Result) -> float:
    return (1.0 - _chosen(result).right_count) / (1.0 - _RIGHT_COUNT)


def _is_smooth(result: Result) -> bool:
    cell = result.cell
    clean = not cell.outliers and not cell.gap
    return result.shortest == 0.0 and cell.n == 200 and cell.noise in _SMOOTH and clean


def _over_smooth(result: Result) -> float:
    return _chosen(result).rms / _SMOOTH[result.cell.noise]


def _coverage_off(result: Result) -> float:
    """Distance from the middle of the wanted band over its half width, two deviations of chance allowed."""
    one = _chosen(result)
    low, high = _COVERAGE
    chance = 2.0 * np.sqrt(0.05 * 0.95 / max(one.trials, 1))
    return float(abs(one.coverage - 0.5 * (low + high)) / (0.5 * (high - low) + chance))


def _failures(result: Result) -> float:
    failed = _chosen(result).failed
    return 1.0 + failed if failed else 0.0


def _always(_: Result) -> bool:
    return True


_TARGETS = (
    _Target("no trial failed", _always, _failures),
    _Target(
        "pieces of >= 5 points: rms <= 1.3 x bound",
        lambda r: _enough_points(r) and r.bound.angle > 0,
        _over_bound,
    ),
    _Target("pieces of >= 5 points: true number in >= 98 %", _enough_points, _wrong_counts),
    _Target("smooth, 200 points: rms <= 0.7 % at 0.5 mm, 0.25 % at 0.1 mm", _is_smooth, _over_smooth),
    _Target("rms not above the best peer's", _always, _over_peer),
    _Target("coverage 93 to 97 %, two deviations of chance allowed", _always, _coverage_off),
)
