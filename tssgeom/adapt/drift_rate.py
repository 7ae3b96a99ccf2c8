"""How fast followed numbers drift, and how far estimates are then off; docs/model.md (253), (268), (269)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tssgeom import core
from tssgeom.arrays import Matrix, Vector


class DriftSettings(NamedTuple):
    """Numbers of the estimate of a drift."""

    shares: tuple[float, ...] = (0.0, *(10.0 ** (0.5 * i) for i in range(-6, 4)))
    """Variances of a drift that are compared, over that which the rig states [1]. Chosen: from none to six
    times as fast; a fault is faster yet."""
    none: float = 0.5
    """Probability at the start that a number does not drift at all [1]; chosen: each as likely."""
    faster: float = 0.05
    """Probability at the start that it drifts faster than the rig states [1]; chosen: one rig in 20."""
    changes: float = 1e-4
    """Probability in a second that its rate becomes another one [1/s]; chosen: once in hours."""
    least: float = 1e-2
    """Least variance of a drift for which the filter is made, over that which is stated [1]. Chosen: a tenth
    in a number, so that one that begins to drift is followed within a minute."""
    most: float = 1.0
    """Most variance of a drift for which the filter is made, over that which is stated [1]. Chosen: what goes
    faster widens the bars, and a fault is left to the watch."""

    @property
    def prior(self) -> Vector:
        """[shares] Probability of each at the start."""
        share = np.array(self.shares)
        faster, rest = share > 1.0, (share > 0.0) & (share <= 1.0)
        slower = 1.0 - self.none - self.faster
        return self.none * (share == 0.0) + self.faster * faster / faster.sum() + slower * rest / rest.sum()


DRIFT = DriftSettings()
KEPT = ("chances", "means", "spreads", "last", "waiting")
"""What a rate consists of beside what is stated."""
_SHARES, _PRIOR = np.array(DRIFT.shares), DRIFT.prior
_VARIANCE, _RATIO, _SHARE = 1, 2, 3  # columns of `last`


class DriftRate:
    """Follows each number once more for every rate at which it may drift, and compares these rates.

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
        self.last: Matrix = np.tile([0.0, math.nan, 1.0, float(_PRIOR @ _SHARES)], (d, 1))
        """[d, 4] Value and variance of the filter after the last drift, NaN before any, the true variance
        over it, and the share for which the filter is made."""
        self.waiting: Matrix = np.zeros((d, 1))
        """[d, 1] Time for which drift has not been added yet [s]."""

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
        """[d] Variance of the change in a second for which the filter is made."""
        return self.stated * self.last[:, _SHARE]

    def spread(self, variances: Vector) -> tuple[Vector, Vector]:
        """Return variances [d] with the drift that waits, and true ones over them; docs/model.md (268)."""
        return core.true_variances(
            variances, self.waiting[:, 0], self.stated, _SHARES, self.chances, self.last
        )

    def restart(self) -> None:
        """Begin anew with what is known of the numbers, which were set; rates stay."""
        self.last[:, _VARIANCE], self.last[:, _RATIO] = math.nan, 1.0

    def with_more(self, stated: Vector) -> DriftRate:
        """Return the same with further numbers."""
        other, count = DriftRate(np.concatenate((self.stated, stated))), len(self.stated)
        for name in KEPT:
            getattr(other, name)[:count] = getattr(self, name)
        return other

    def wait(self, span: float) -> None:
        """Let time pass [s] whose drift `take` adds."""
        self.waiting += span

    def take(self, drifts: NDArray[np.bool_], members: Matrix) -> Vector:
        """Take in the members [n, d] before a drift; return its standard deviations [d]; (253), (269).

        Parameters
        ----------
        drifts
            [d] Whether the drift that waits is added.
        """
        span = np.where(drifts, self.waiting[:, 0], 0.0)
        self.waiting[drifts] = 0.0
        return core.compare_drifts(
            members,
            span,
            self.stated,
            _SHARES,
            _PRIOR,
            DRIFT.changes,
            DRIFT.least,
            DRIFT.most,
            self.chances,
            self.means,
            self.spreads,
            self.last,
        )
