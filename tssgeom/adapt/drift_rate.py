"""How fast followed numbers drift, by how far their estimates go; docs/model.md (253)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Vector


class DriftSettings(NamedTuple):
    """Numbers of the estimate of a drift."""

    span: float = 3.0
    """Length of an interval, over the time for which the filter remembers a number [1]. Chosen: estimates at
    both ends then have errors of their own."""
    intervals: float = 30.0
    """Intervals over which the mean is taken [1]. Chosen: the variance is then known to a third."""
    prior: float = 4.0
    """Intervals for which what the rig states counts at the start [1]; chosen."""
    steady: float = 2.0
    """Variance at the begin of an interval, over that at its end, above which it does not count [1]. Chosen:
    the filter is not steady then."""
    most: float = 10.0
    """Most that an interval counts as [1]. Chosen: a tenth of all with a drift as stated would be beyond 2.7,
    one in 600 beyond this."""
    least: float = 1e-3
    """Least variance of a drift, over that which is stated [1]. Chosen: a thirtieth in a number, so that one
    that begins to drift is followed within minutes."""


DRIFT = DriftSettings()
_COUNT, _SCALE, _BEGIN, _VALUE, _VARIANCE = range(5)


class DriftRate:
    """Estimates the variance of the drift of each number, as a share of that which the rig states.

    Parameters
    ----------
    stated
        [d] Variance of the change in a second, as stated: the most that is expected.
    """

    def __init__(self, stated: Vector) -> None:
        self.stated = stated
        self.rows: Matrix = np.tile([DRIFT.prior, 1.0, math.nan, 0.0, 0.0], (len(stated), 1))
        """[d, 5] Intervals so far and the mean share over them; time, value and variance at the begin of this
        one."""

    @property
    def variance(self) -> Vector:
        """[d] Variance of the change in a second."""
        return self.stated * np.minimum(np.maximum(self.rows[:, _SCALE], DRIFT.least), 1.0)

    def restart(self) -> None:
        """Begin new intervals: numbers were set."""
        self.rows[:, _BEGIN] = math.nan

    def with_more(self, stated: Vector) -> DriftRate:
        """Return the same with further numbers."""
        other = DriftRate(np.concatenate((self.stated, stated)))
        other.rows[: len(self.rows)] = self.rows
        return other

    def take(self, time: float, values: Vector, variances: Vector) -> None:
        """Take in what is known at a time [s]: values [d] and their variances [d]."""
        for row, stated, now, value, variance in zip(
            self.rows, self.stated.tolist(), self.variance.tolist(), values, variances, strict=True
        ):
            if stated == 0.0 or variance == 0.0:
                continue
            span, remembered = time - row[_BEGIN], variance / now
            if span < DRIFT.span * remembered:
                continue
            if row[_VARIANCE] <= DRIFT.steady * variance and not math.isnan(span):
                moved = (value - row[_VALUE]) ** 2 + variance - row[_VARIANCE]
                by_errors = -math.expm1(-span / remembered) * remembered
                share = min((moved - now * by_errors) / (stated * (span - by_errors)), DRIFT.most)
                row[_COUNT] = min(row[_COUNT] + 1.0, DRIFT.intervals)
                row[_SCALE] += (share - row[_SCALE]) / row[_COUNT]
            row[_BEGIN:] = time, value, variance
