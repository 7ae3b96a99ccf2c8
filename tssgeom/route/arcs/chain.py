"""A chain of arcs and the points that it is fitted to: parameters, fit, values that count, criterion.

The chain starts at a position with axes (tangent and two normals, carried along without twist). Piece j runs
from arc length b_j to b_j+1 with constant curvature components K_j on the normals, so a straight piece and a
change of the bending plane are regular points. The last piece goes on without end. The fit itself is in
`tssgeom/core/arcs.h`; docs/model.md (30) to (32).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tssgeom import core
from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.core.constants import ROUNDING
from tssgeom.core.constants_arcs import CHAIN_FIT
from tssgeom.statistics import information_price


class WeightedTangents(NamedTuple):
    """Sensed directions beside the points of a chain."""

    unit: Points
    """Unit tangents [n, 3]; a row without weight is not read."""
    weight: Vector
    """Noise variance of the points over that of each direction, 0 where none is used [n] [m²]."""
    variance: Vector
    """Variance of each direction, 0 where none is used [n] [rad²]."""


class Data(NamedTuple):
    """Points and what is known of them, lengths in metres."""

    points: Points
    weight: Vector
    free: bool
    """True where stations are unknown: only distances across the chain count."""
    variance: float
    """Known noise variance of a coordinate, 0 where unknown [m²]."""
    spacing: float
    """Mean spacing [m]."""
    tangents: WeightedTangents | None = None
    """Sensed directions, where there are any."""
    shortest: float = 1.0
    """Shortest piece [mean spacings]: less than 1 only where there are kinks, as it also fits noise."""

    @property
    def sensed(self) -> tuple[Points, Vector, bool, float, float, Points | None, Vector | None]:
        """Points and directions as the core takes them."""
        tangents = self.tangents
        unit, weight = (None, None) if tangents is None else (tangents.unit, tangents.weight)
        return (*self[:5], unit, weight)

    @property
    def fitted_directions(self) -> int:
        """Number of directions that are fitted."""
        return 0 if self.tangents is None else int(np.count_nonzero(self.tangents.weight > 0.0))

    @property
    def values_across(self) -> int:
        """Number of values that were sensed across the route: of the points that count, and of directions."""
        return 2 * int(np.count_nonzero(self.weight)) + 2 * self.fitted_directions


class Chain(NamedTuple):
    """A fitted chain.

    Its parameters in order are the start (3 coordinates, or 2 across where stations are unknown, since these
    then slide along), turns about both normals, inner joints, and curvature components of the curved pieces.
    """

    form: Points
    """Position of the start [m]; tangent and both normals there; then of each piece the arc length at which
    it begins [m] and its curvature components [1/m]; [4 + k, 3]."""
    curved: np.ndarray
    """Which pieces may be curved [k]."""
    stations: Vector
    """Arc length of the foot of each point [n] [m]."""
    matrix: Matrix
    """Normal equations of Gauss and Newton [m, m]."""
    cost: float
    """Weighted sum of squares [m²]."""
    square: Vector
    """Squared distance of each point, across the chain where stations are unknown [n] [m²]."""

    @property
    def start(self) -> Vector:
        """Position of the start [3] [m]."""
        return self.form[0]

    @property
    def axes(self) -> Matrix:
        """Tangent and both normals there [3, 3]."""
        return self.form[1:4]

    @property
    def joints(self) -> Vector:
        """Arc length at which each piece begins [k] [m]."""
        return self.form[4:, 0]

    @property
    def edges(self) -> Vector:
        """The same, and where the last piece ends: at the farthest foot, it has no joint [k + 1] [m]."""
        return np.append(self.joints, self.stations.max())

    @property
    def bend(self) -> Points:
        """Curvature components of each piece [k, 2] [1/m]."""
        return self.form[4:, 1:]

    @property
    def parameters_across(self) -> int:
        """Number of its parameters where stations are unknown; one more where they are known."""
        return parameter_count(self.curved, True)


def form_of(start: Vector, axes: Matrix, joints: Vector, bend: Points) -> Points:
    """Form of a chain: parameters as its properties."""
    form = np.empty((4 + len(joints), 3))
    form[0], form[1:4], form[4:, 0], form[4:, 1:] = start, axes, joints, bend
    return form


def unfitted(start: Vector, axes: Matrix, joints: Vector, bend: Points, stations: Vector) -> Chain:
    """Return a chain of curved pieces that is yet to be fitted."""
    form, curved = form_of(start, axes, joints, bend), np.ones(len(bend), dtype=np.bool_)
    return Chain(form, curved, stations, np.zeros((0, 0)), 0.0, np.zeros(0))


def fit_fixed_pieces(data: Data, chain: Chain, *, restart: bool = False) -> Chain:
    """Fit a chain of as many pieces by Levenberg and Marquardt; its matrix and cost are not used.

    Parameters
    ----------
    data, chain
        The points, and where the fit starts.
    restart
        Let the chain begin at the foot of the first point, where stations are unknown: in a fit its start
        moves only across itself, so the ends of a route that moves would run away from it.
    """
    return _fitted(data, chain, math.inf, restart)[2]


def fit_with_work(data: Data, chain: Chain) -> tuple[float, Chain]:
    """Do as `fit_fixed_pieces`; return also the work [visits of a point]."""
    return _fitted(data, chain, math.inf, False)[1:]


class Trial(NamedTuple):
    """A candidate that was tried."""

    work: float
    """Visits of points that it took, or that would have taken as long."""
    better: Chain | None
    """The chain, fitted, if its criterion is below what was asked and there are points on its pieces."""


def fit_candidate(data: Data, candidate: Chain, least: float) -> Trial:
    """Fit a candidate that is to have a criterion below `least`."""
    better, work, fitted = _fitted(data, candidate, least, False)
    return Trial(work, fitted if better else None)


def work_of_evaluation(points: int, parameters: int) -> float:
    """Return the work of building and solving the normal equations once [visits of a point]; (32)."""
    return points + CHAIN_FIT.work_of_square * parameters**2


def _fitted(data: Data, chain: Chain, least: float, restart: bool) -> tuple[bool, float, Chain]:
    """Return whether a fit is better than `least`, its work [visits of a point], and the chain."""
    count = parameter_count(chain.curved, data.free)
    fitted = core.fit_pieces(count, *data.sensed, data.shortest, *chain[:3], least, restart)
    work = fitted[1] * work_of_evaluation(len(data.points), count)
    return bool(fitted[0]), work, Chain(fitted[2], chain.curved, *fitted[3:])


def along(s: Vector, form: Points) -> tuple[Points, Points, Points]:
    """Position [m], unit tangent and curvature vector [1/m], each [n, 3], at arc lengths `s` [m]; (30)."""
    position, frame = core.along_chain(s, form)
    here = form[4 + np.searchsorted(form[5:, 0], s, side="right")]
    return position, frame[:, 0], here[:, 1:2] * frame[:, 1] + here[:, 2:] * frame[:, 2]


def squared_distances(data: Data, chain: Chain, *, across: bool) -> Vector:
    """Squared distance of the points from the chain at their stations [n], whole or across it [m²]."""
    position, frame = core.along_chain(chain.stations, chain.form)
    off = data.points - position
    square = np.einsum("ij,ij->i", off, off)
    return np.maximum(square - np.einsum("ij,ij->i", off, frame[:, 0]) ** 2, 0.0) if across else square


def piece_length(chain: Chain, j: int) -> float:
    """Length of piece j [m]."""
    end = chain.joints[j + 1] if j + 1 < len(chain.joints) else chain.stations[-1]
    return float(end - chain.joints[j])


def value_count(data: Data) -> int:
    """Return the number of values that are fitted."""
    used = int(np.count_nonzero(data.weight > 0.0))
    return (2 if data.free else 3) * used + 2 * data.fitted_directions


def first_joint_column(free: bool) -> int:
    """Return the parameter of the first inner joint: before it stand the start and two turns."""
    return (2 if free else 3) + 2


def parameter_count(curved: np.ndarray, free: bool) -> int:
    """Return the number of parameters of a chain: start, turns, joints, curvatures."""
    return first_joint_column(free) + len(curved) - 1 + 2 * int(np.count_nonzero(curved))


def curvature_columns(curved: np.ndarray, free: bool) -> np.ndarray:
    """First parameter of each piece's curvature [k]; that of a straight piece has no meaning."""
    first = first_joint_column(free) + len(curved) - 1
    return first + 2 * (np.cumsum(curved) - curved)


def criterion(data: Data, chain: Chain) -> float:
    """Bayesian information criterion: -2 ln of the greatest likelihood, and a price a parameter; (125)."""
    n = value_count(data)
    price = information_price(float(len(chain.matrix)), n)
    if data.variance > 0.0:
        return chain.cost / data.variance + n * math.log(data.variance) + price
    return n * math.log(chain.cost / n + 1e-300) + n + price


def noise_variance(data: Data, chain: Chain) -> float:
    """Noise variance of a coordinate, known or from the residuals [m²]."""
    if data.variance > 0.0:
        return data.variance
    rounding = (ROUNDING.relative * data.spacing) ** 2
    return max(chain.cost / max(value_count(data) - len(chain.matrix), 1), rounding)
