"""Estimates of followed numbers at each time of a run, from all its readings: smoothing; docs/model.md (208).

Source: H. E. Rauch, F. Tung, C. T. Striebel, Maximum likelihood estimates of linear dynamic systems, AIAA
Journal 3 (1965). Only the numbers are smoothed: a tendon forgets its tensions within a stroke, numbers change
over minutes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Vector


class SmoothingSettings(NamedTuple):
    """Numbers of the smoothing."""

    most_moments: int = 1000
    """Moments that are kept [1], twice as many meanwhile. Chosen: as many as pixels across a figure."""


_SETTINGS = SmoothingSettings()
_RIDGE = 1e-12  # on the diagonal of correlations before they are inverted; derived: 1000 times rounding


class _Step(NamedTuple):
    """A number given the next kept one, with all readings between: normal about `offset + gain · next`."""

    offset: Vector
    gain: Matrix
    covariance: Matrix

    def then(self, later: _Step) -> _Step:
        """Return the step over both."""
        return _Step(
            self.offset + self.gain @ later.offset,
            self.gain @ later.gain,
            self.covariance + self.gain @ later.covariance @ self.gain.T,
        )


@dataclass(frozen=True, slots=True)
class SmoothedNumbers:
    """Followed numbers at kept moments of a run, in the units of their keys."""

    time: Vector
    """[m] Times of the moments [s]."""
    filtered: Matrix
    """[m, d] With the readings up to each moment."""
    filtered_covariance: np.ndarray
    """[m, d, d]"""
    values: Matrix
    """[m, d] With all readings."""
    covariance: np.ndarray
    """[m, d, d]"""

    @property
    def filtered_se(self) -> Matrix:
        """[m, d] Standard errors."""
        return np.sqrt(np.maximum(np.diagonal(self.filtered_covariance, axis1=1, axis2=2), 0.0))

    @property
    def se(self) -> Matrix:
        """[m, d] Standard errors."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance, axis1=1, axis2=2), 0.0))


class _Known(NamedTuple):
    """What is known at a time."""

    time: float
    values: Vector
    covariance: Matrix


class NumberHistory:
    """Takes in the estimates of a filter of a random walk, step by step, and smooths them.

    All steps count, also those between the kept moments: the backward recursion is affine, and that over many
    steps is one affine step again. Memory does not grow with the length of the run.

    Parameters
    ----------
    count
        d, how many numbers there are.
    most_moments
        Moments that are kept.
    """

    def __init__(self, count: int, most_moments: int = _SETTINGS.most_moments) -> None:
        self._count = count
        self._most = most_moments
        self._moments = list[_Known]()
        self._steps = list[_Step]()  # from each kept moment to the next one, the last to the newest
        self._newest: _Known | None = None
        self._stride, self._since_kept = 1, 0

    def take(self, time: float, values: Vector, covariance: Matrix, drift: Vector) -> None:
        """Take in what is known after the readings of a time [s], not before that of the last one.

        Parameters
        ----------
        time
            Time [s].
        values, covariance
            [d], [d, d] The estimate.
        drift
            [d] Variance in a second of the drift since the last one.
        """
        now = _Known(time, np.array(values), np.array(covariance))
        if self._newest is not None:
            step = _step_back(
                self._newest.values, self._newest.covariance, (time - self._newest.time) * drift
            )
            if self._since_kept == 0:
                self._moments.append(self._newest)
                self._steps.append(step)
            else:
                self._steps[-1] = self._steps[-1].then(step)
            self._since_kept = (self._since_kept + 1) % self._stride
            if self._since_kept == 0 and len(self._moments) >= 2 * self._most:
                self._thin()
        self._newest = now

    def cut(self, time: float) -> None:
        """Forget the kept moments from a time [s] on, and what came after."""
        if self._newest is None or self._newest.time < time:
            return
        count = sum(moment.time < time for moment in self._moments)
        self._newest = self._moments[count - 1] if count else None
        self._moments, self._steps = self._moments[: max(count - 1, 0)], self._steps[: max(count - 1, 0)]
        self._since_kept = 0

    def smoothed(self) -> SmoothedNumbers:
        """Return the numbers at the kept moments, with the readings up to each, and with all readings."""
        moments = [*self._moments, *([] if self._newest is None else [self._newest])]
        dimension = self._count
        time = np.array([one.time for one in moments])
        filtered = np.array([one.values for one in moments]).reshape(-1, dimension)
        covariances = np.array([one.covariance for one in moments]).reshape(-1, dimension, dimension)
        values, covariance = filtered.copy(), covariances.copy()
        for k in range(len(moments) - 2, -1, -1):
            step = self._steps[k]
            values[k] = step.offset + step.gain @ values[k + 1]
            covariance[k] = step.covariance + step.gain @ covariance[k + 1] @ step.gain.T
        return SmoothedNumbers(time, filtered, covariances, values, covariance)

    def _thin(self) -> None:
        """Keep every other moment."""
        pairs = zip(self._steps[::2], self._steps[1::2], strict=True)
        self._steps = [first.then(second) for first, second in pairs]
        self._moments = self._moments[::2]
        self._stride *= 2


def _step_back(values: Vector, covariance: Matrix, added: Vector) -> _Step:
    """Return the backward step of a random walk; docs/model.md (208)."""
    expected = covariance + np.diag(added)
    sd = np.sqrt(np.diag(expected))
    sd[sd == 0.0] = 1.0
    correlation = expected / np.outer(sd, sd) + _RIDGE * np.eye(len(sd))
    lost = added[:, None] * np.linalg.inv(correlation) / np.outer(sd, sd)  # Q (P + Q)⁻¹
    return _Step(lost @ values, np.eye(len(values)) - lost, np.diag(added) - lost * added)
