"""Tuned numbers of chains of arcs: how they are fitted, searched, and judged."""

import math
from typing import NamedTuple


class FootSearch(NamedTuple):
    """How an unknown station moves to the foot of its point in one evaluation of a fit."""

    steps: int = 2
    """Most Newton steps [1]; chosen: the fit itself goes on from there."""
    near: float = 0.15
    """Step after which there is no other [of the longest step]; chosen."""
    least_slope: float = 0.3
    """Least derivative of the distance along the chain [1]: points beyond the centre of an arc have none;
    chosen."""


FOOT = FootSearch()


class ChainFit(NamedTuple):
    """How a chain with a given number of pieces is fitted, and when that ends."""

    converged: float = 1e-3
    """Promised or actual decrease of the cost at which the fit has converged [noise variances]; chosen: far
    below what any decision between chains needs."""
    most_steps: int = 40
    """Most steps [1]; chosen."""
    reach: float = 2.0
    """Longest move of a foot at a time [mean spacings]; chosen."""

    first_damping: float = 1e-9
    """Damping of the first step, of the diagonal [1]; chosen: nearly that of Gauss and Newton."""
    damping_of_failure: float = 1e-6
    """Least damping after a step that does not decrease the cost, and one over the greatest [1]; chosen."""
    easier: float = 0.03
    """Factor on the damping after a step that decreases the cost [1]; chosen."""
    harder: float = 30.0
    """Factor on it after one that does not [1]; chosen."""

    still_expected: float = 4.0
    """Decrease that may still come, or the fit is given up [promised decrease of the next step]; chosen."""

    most_turn: float = 2.0
    """Greatest turn from point to point that is identifiable, from which on two points may be exchanged, and
    half of it between points that have unobserved ones between them [rad]; chosen, below π."""
    wide: float = 3.0
    """Distance of points that have unobserved ones between them [mean spacings]; chosen."""

    work_of_square: float = 1.0 / 6.0
    """Work of a squared parameter in an evaluation [visits of a point]; measured: 0.01 µs beside 0.07 µs."""

    kink: float = 0.1
    """Shortest piece of a chain with kinks [mean spacings]; chosen."""


CHAIN_FIT = ChainFit()


class ChainMoves(NamedTuple):
    """How other pieces of a chain are searched. Promises come from a straight line and may be wrong."""

    parts: int = 4
    """Parts into which a piece is cut to see where another joint would help; a shorter one than so many mean
    spacings is not cut [1]; chosen."""
    most_pieces: int = 40
    """Most pieces of a chain [1]; chosen."""
    trials: int = 12
    """Simpler chains that are tried [1]; chosen."""
    most_evaluations: int = 500
    """Evaluations of all that are tried, beyond which the best so far stays [1]; chosen: half a second of
    10 000 points, six times what a smooth route takes."""
    work_of_any: int = 2000
    """What an evaluation may take whatever the number of points, and a check of the model after one frame of
    a stream, as its steps count it [visits of a point]; derived: that of a chain with the most pieces; 0.2
    ms."""
    dropped_below: float = 8.0
    """Length of a piece below which it may be dropped whole [mean spacings]; chosen."""


CHAIN_MOVES = ChainMoves()


class ChainParameters(NamedTuple):
    """What a chain consists of; mathematics."""

    joint: float
    """Numbers of another joint, its position and the curvature vector behind it [1]. A simpler chain that
    promises to raise the criterion by no more than their price is still tried."""
    half_turn: float
    """Standard error of an angle from which on its direction is unknown [rad]."""


CHAIN_PARAMETERS = ChainParameters(joint=3.0, half_turn=math.pi)


class IdentifiableBend(NamedTuple):
    """Which pieces have a bend that their points determine."""

    few_points: float = 3.0
    """Length below which a piece holds few points; corners so near are one [spacings]. Chosen."""
    largest_se_short: float = 0.3
    """Standard error of the angle of a short piece from which on it is dropped [rad]; for any other it is
    half a turn. Chosen."""


IDENTIFIABLE = IdentifiableBend()
