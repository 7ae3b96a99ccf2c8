"""Results of cells as tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.bound import Bound
from benchmarks.cells import Cell
from benchmarks.estimate import OURS
from benchmarks.peers import PEERS
from benchmarks.scores import METHODS, Summary
from benchmarks.tables import ABSENT, number, share, table

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
    """Everything else, for this project and its best peer, or for all; then what failures said."""
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
    drawn = table(_DETAILS, rows, text_columns=2, markdown=markdown)
    return "\n".join([drawn, *notes])


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
