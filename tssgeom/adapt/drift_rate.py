"""How fast followed numbers drift, and how far estimates are then off; docs/model.md (253), (268), (269)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tssgeom import core
from tssgeom.adapt.readings import mean_and_covariance
from tssgeom.arrays import Matrix, Vector
from tssgeom.statistics import EVEN, HELD


class DriftSettings(NamedTuple):
    """Numbers of the estimate of a drift."""

    shares: tuple[float, ...] = (0.0, *(10.0 ** (0.5 * i) for i in range(-6, 4)))
    """Variances of a drift that are compared, over that which the rig states [1]. Chosen: from none to six
    times as fast; a fault is faster yet."""
    changes: float = 1e-4
    """Probability in a second that its rate becomes another one [1/s]; chosen: once in hours."""
    least: float = 1e-2
    """Least variance of a drift for which members are made, over that which is stated [1]. Chosen: a tenth
    in a number, so that one that begins to drift is followed within a minute."""

    @property
    def prior(self) -> Vector:
        """[shares] Probability of each at the start."""
        share = np.array(self.shares)
        faster, rest = share > 1.0, (share > 0.0) & (share <= 1.0)
        beyond = round(1.0 - HELD, 2)  # what a rig states holds as often as an interval
        slower = 1.0 - EVEN - beyond  # that a number drifts at all is as likely as not
        return EVEN * (share == 0.0) + beyond * faster / faster.sum() + slower * rest / rest.sum()


DRIFT = DriftSettings()
KEPT = ("chances", "means", "spreads", "last", "waiting", "beyond")
"""What a rate consists of beside what is stated."""
_SHARES, _PRIOR = np.array(DRIFT.shares), DRIFT.prior
_VARIANCE, _RATES = 1, 2  # columns of `last`


class DriftRate:
    """Follows each number for every rate at which it may drift, and all together with the mean of these.

    Parameters
    ----------
    stated
        [d] Variance of the change in a second, as stated.
    """

    def __init__(self, stated: Vector) -> None:
        self.stated = stated
        d = len(stated)
        self.chances: Matrix = np.tile(_PRIOR, (d, 1))
        """[d, shares] Probability of each share."""
        self.means: Matrix = np.zeros((d, len(_SHARES)))
        self.spreads: Matrix = np.zeros((d, len(_SHARES)))
        """[d, shares] Value and variance of each number, if its drift has that share."""
        self.last: Matrix = np.tile([0.0, math.nan, 0.0, float(_PRIOR @ _SHARES)], (d, 1))
        """[d, 4] Value and variance of the members after the last drift, NaN before any, the variance between
        the rates, and the share for which members are made."""
        self.waiting: Matrix = np.zeros((d, 1))
        """[d, 1] Time for which drift has not been added yet [s]."""
        self.beyond: Matrix = np.zeros((d, d + 1))
        """[d, d + 1] What is known beyond the members: information, and in the last column its product with
        the numbers, about the values and in the standard deviations of `last`; docs/model.md (268)."""
        self._diagonal = np.diag_indices(d)

    @property
    def rows(self) -> Matrix:
        """[d, …] All of it but what is stated."""
        return np.hstack([getattr(self, name) for name in KEPT])

    def set_rows(self, rows: Matrix) -> None:
        """Set all of it to what `rows` was."""
        at = np.cumsum([getattr(self, name).shape[1] for name in KEPT])
        for name, part in zip(KEPT, np.split(rows, at[:-1], axis=1), strict=True):
            setattr(self, name, part.copy())

    @property
    def variance(self) -> Vector:
        """[d] Variance of the change in a second, as it is by now."""
        return self.stated * (self.chances @ _SHARES)

    def estimate(self, values: Vector, covariance: Matrix) -> tuple[Vector, Matrix]:
        """Return the numbers [d] and their covariance [d, d], from those of the members; docs/model.md (268).

        Drift that waits is in the covariance, and so is what rates differ in.
        """
        known, spread = core.known_numbers(values, covariance, self.last, self.beyond)
        spread[self._diagonal] += self.variance * self.waiting[:, 0] + self.last[:, _RATES]
        return known, spread

    def restart(self) -> None:
        """Begin anew with what is known of the numbers, which were set; rates stay."""
        self.last[:, _VARIANCE], self.last[:, _RATES], self.beyond[:] = math.nan, 0.0, 0.0

    def with_more(self, stated: Vector) -> DriftRate:
        """Return the same with further numbers."""
        other, count = DriftRate(np.concatenate((self.stated, stated))), len(self.stated)
        for name in KEPT[:-1]:
            getattr(other, name)[:count] = getattr(self, name)
        other.beyond[:count, :count], other.beyond[:count, -1] = self.beyond[:, :-1], self.beyond[:, -1]
        return other

    def wait(self, span: float) -> None:
        """Let time pass [s] whose drift `take` adds."""
        self.waiting += span

    def take(self, drifts: NDArray[np.bool_], members: Matrix) -> Vector:
        """Take in the members [n, d] before a drift; return its standard deviations [d]; (253), (268), (269).

        Parameters
        ----------
        drifts
            [d] Whether the drift that waits is added.
        """
        span = np.where(drifts, self.waiting[:, 0], 0.0)
        self.waiting[drifts] = 0.0
        values, covariance = mean_and_covariance(members)
        known, spread = core.known_numbers(values, covariance, self.last, self.beyond)
        sd = core.compare_drifts(
            members,
            span,
            self.stated,
            _SHARES,
            _PRIOR,
            DRIFT.changes,
            DRIFT.least,
            1.0,  # the stated one: what goes faster is followed beside, and a fault is left to the watch
            self.chances,
            self.means,
            self.spreads,
            self.last,
        )
        spread[self._diagonal] += self.variance * span
        covariance[self._diagonal] += sd * sd
        self.beyond = core.known_beyond(values, covariance, known, spread, self.last)
        return sd
