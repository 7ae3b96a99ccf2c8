"""How many pieces a chain of arcs needs: they are straightened, merged, dropped and split by BIC."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.shape.chain import normal_equations
from tssgeom.shape.chainfit import (
    Chain,
    Data,
    criterion,
    curvature_columns,
    first_joint_column,
    noise_variance,
    parameter_covariance,
    settle,
)

_SPLITS = 4  # parts into which a piece is cut to see where another joint would help
_MOST_PIECES = 40
_MOST_MOVES = 120
_MOST_TRIES = 6


def fit_chain(data: Data, first: Chain) -> Chain:
    """Fit, then merge, straighten and split pieces as long as the Bayesian information criterion falls.

    Parameters
    ----------
    data
        The points.
    first
        Where to start, as `settle` leaves it.
    """
    best = first
    for _ in range(_MOST_MOVES):
        found = better(data, best)
        if found is None:
            return best
        best = found
    return best


def better(data: Data, chain: Chain) -> Chain | None:
    """Return the first neighbouring chain with a lower criterion, the likeliest tried first; None if none."""
    now = criterion(data, chain)
    for neighbours in (_simpler, _finer):
        for candidate in neighbours(data, chain)[:_MOST_TRIES]:
            tried = settle(data, candidate)
            if criterion(data, tried) < now:
                return tried
    return None


def _simpler(data: Data, chain: Chain) -> list[Chain]:
    """Chains with one piece straightened, dropped or merged, the cheapest first."""
    covariance = parameter_covariance(data, chain)
    columns, n = curvature_columns(chain, data.free), math.log(data.values)
    options: list[tuple[float, Chain]] = []
    for j, column in enumerate(columns):
        if column >= 0:
            worth = _worth(chain.bend[j], covariance[column : column + 2, column : column + 2])
            options.append((worth - 2 * n, _straightened(chain, j)))
    for j in range(1, len(columns)):
        step = chain.bend[j] - chain.bend[j - 1]
        own = np.zeros((2, len(covariance)))
        for c in range(2):
            for sign, column in ((1.0, columns[j]), (-1.0, columns[j - 1])):
                if column >= 0:
                    own[c, column + c] = sign
        worth = _worth(step, own @ covariance @ own.T)
        options.append((worth - 3 * n, _merged(chain, j)))
    for j in range(1, len(columns) - 1):
        length = chain.joints[j + 1] - chain.joints[j]
        if length < 8 * data.gap:
            options.append((-n, _dropped(chain, j)))
    options.sort(key=lambda option: option[0])
    return [candidate for worth, candidate in options if worth < 3 * n]


def _worth(step: Vector, covariance: Matrix) -> float:
    """Squared size of a step in its standard errors."""
    if not covariance.any():
        return 0.0
    return float(step @ np.linalg.lstsq(covariance, step, rcond=1e-12)[0])


def _straightened(chain: Chain, j: int) -> Chain:
    bend, curved = chain.bend.copy(), chain.curved.copy()
    bend[j], curved[j] = 0.0, False
    return chain._replace(bend=bend, curved=curved)


def _merged(chain: Chain, j: int) -> Chain:
    """Pieces j-1 and j made one, with the mean of their curvatures."""
    ends = np.append(chain.joints, chain.stations[-1])
    before, after = ends[j] - ends[j - 1], ends[j + 1] - ends[j]
    bend, curved = chain.bend.copy(), chain.curved.copy()
    bend[j - 1] = (before * bend[j - 1] + after * bend[j]) / max(before + after, 1e-12)
    curved[j - 1] |= curved[j]
    return chain._replace(
        joints=np.delete(chain.joints, j), bend=np.delete(bend, j, axis=0), curved=np.delete(curved, j)
    )


def _dropped(chain: Chain, j: int) -> Chain:
    """Short piece j given half each to its neighbours."""
    joints = chain.joints.copy()
    joints[j + 1] = 0.5 * (joints[j] + joints[j + 1])
    return chain._replace(
        joints=np.delete(joints, j), bend=np.delete(chain.bend, j, axis=0), curved=np.delete(chain.curved, j)
    )


class _Parts(NamedTuple):
    """Normal equations of a chain whose pieces are cut into equal parts with curvatures of their own."""

    at: Vector
    """Where the parts begin [m]."""
    matrix: Matrix
    gradient: Vector
    kept: list[int]
    """Parameters of the chain that stay: start, directions, joints."""
    first: int
    """First curvature parameter."""

    def column(self, piece: int, component: int, weight: Vector) -> Vector:
        """Curvature component of a piece, varying over its parts by `weight`."""
        out = np.zeros(len(self.gradient))
        out[self.first + 2 * (_SPLITS * piece + np.arange(_SPLITS)) + component] = weight
        return out

    def saved(self, columns: list[Vector]) -> float:
        """Return what the best change of the kept parameters and those of `columns` saves of the cost."""
        design = np.column_stack([np.eye(len(self.gradient))[:, self.kept], *columns])
        reduced, slope = design.T @ self.matrix @ design, design.T @ self.gradient
        scale = 1.0 / np.sqrt(np.maximum(np.diag(reduced), 1e-300))
        step = np.linalg.lstsq(reduced * scale[:, None] * scale, slope * scale, rcond=1e-12)[0]
        return float(step @ (slope * scale))


def _parts(data: Data, chain: Chain) -> _Parts:
    ends = np.append(chain.joints, chain.stations[-1])
    at = np.concatenate([np.linspace(a, b, _SPLITS + 1)[:-1] for a, b in itertools.pairwise(ends)])
    matrix, gradient, _ = normal_equations(
        data.points,
        data.weight,
        chain.stations,
        chain.start,
        chain.axes,
        at,
        np.repeat(chain.bend, _SPLITS, axis=0),
        np.ones(len(at), dtype=np.bool_),
        data.free,
    )
    base = first_joint_column(data.free)
    joints = (
        base + _SPLITS * np.arange(1, len(chain.bend)) - 1
    )  # the other joints of the parts have no effect
    return _Parts(at, matrix, gradient, [*range(base), *joints.tolist()], base + len(at) - 1)


def slopes(data: Data, chain: Chain) -> float:
    """Return what sloping curvature in every piece would save beyond chance, in noise variances.

    A staircase that stands for a smooth route wants its steps to slope; true pieces do not.
    """
    parts = _parts(data, chain)
    ramp = np.linspace(-1.5, 1.5, _SPLITS)
    columns = _level_columns(parts, chain)
    columns += [parts.column(j, c, ramp) for j in range(len(chain.bend)) for c in range(2)]
    return parts.saved(columns) / noise_variance(data, chain) - 2 * len(chain.bend)


def _level_columns(parts: _Parts, chain: Chain, without: int = -1) -> list[Vector]:
    level = np.ones(_SPLITS)
    return [
        parts.column(j, c, level)
        for j in np.flatnonzero(chain.curved).tolist()
        if j != without
        for c in range(2)
    ]


def _finer(data: Data, chain: Chain) -> list[Chain]:
    """Chains with one joint more, where the residuals ask for it most."""
    if len(chain.bend) >= _MOST_PIECES:
        return []
    parts, variance = _parts(data, chain), noise_variance(data, chain)
    length = np.diff(np.append(chain.joints, chain.stations[-1]))
    options: list[tuple[float, Chain]] = []
    for j in np.flatnonzero(length >= 4 * data.gap).tolist():
        others = _level_columns(parts, chain, without=j)
        for cut in range(1, _SPLITS):
            before = (np.arange(_SPLITS) < cut).astype(np.float64)
            own = [parts.column(j, c, weight) for weight in (before, 1.0 - before) for c in range(2)]
            options.append(
                (parts.saved(others + own) / variance, _split(chain, j, parts.at[_SPLITS * j + cut]))
            )
    options.sort(key=lambda option: -option[0])
    return [candidate for saved, candidate in options[:2] if saved > math.log(data.values)]


def _split(chain: Chain, j: int, where: float) -> Chain:
    curved = np.insert(chain.curved, j + 1, True)
    curved[j] = True
    return chain._replace(
        joints=np.insert(chain.joints, j + 1, where),
        bend=np.insert(chain.bend, j + 1, chain.bend[j], axis=0),
        curved=curved,
    )
