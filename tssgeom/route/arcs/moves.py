"""How many pieces a chain of arcs needs: straightened, merged, dropped, split by BIC; docs/model.md (126)."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Sequence
from itertools import chain as one_after_the_other

import numpy as np

from tssgeom import core
from tssgeom.core.constants import ROUNDING
from tssgeom.core.constants_arcs import CHAIN_MOVES, CHAIN_PARAMETERS
from tssgeom.route.arcs.chain import (
    Chain,
    Data,
    Trial,
    criterion,
    curvature_columns,
    fit_candidate,
    fit_with_work,
    noise_variance,
    piece_length,
    value_count,
    work_of_evaluation,
)
from tssgeom.route.steps import at_once
from tssgeom.statistics import information_price

_ALL = slice(None)
_STRAIGHTENED, _MERGED, _DROPPED = 0, 1, 2


class Budget:
    """Work that the search for the pieces of a chain may take, linear in the points; docs/model.md (220).

    Without points there is no bound.
    """

    def __init__(self, data: Data | None = None) -> None:
        points = math.inf if data is None else len(data.points) + CHAIN_MOVES.work_of_any
        self.left: float = CHAIN_MOVES.most_evaluations * points
        """What is left of it [visits of a point]."""

    @property
    def spent(self) -> bool:
        """Whether nothing is left."""
        return self.left < 0.0


def fit_chain(
    data: Data, first: Chain, budget: Budget | None = None, most: int = 3 * CHAIN_MOVES.most_pieces
) -> Chain:
    """Merge, straighten and split pieces as long as the Bayesian information criterion falls.

    Parameters
    ----------
    data
        The points.
    first
        Where to start, as `fit_fixed_pieces` leaves it.
    budget
        What the search may take; that of one search where left out.
    most
        How many moves to make at most; each piece can be split, straightened and merged.
    """
    return at_once(fit_chain_in_steps(data, first, most, budget))


def fit_chain_in_steps(
    data: Data, first: Chain, most: int, budget: Budget | None = None
) -> Generator[float, None, Chain]:
    """Do as `fit_chain`, with a stop after each candidate."""
    best, budget = first, budget or Budget(data)
    for _ in range(most):
        better = None
        for work, better in one_after_the_other(simpler_tried(data, best), finer_tried(data, best)):
            budget.left -= work
            yield work
            if better is not None or budget.spent:
                break
        if better is None or budget.spent:
            return better or best
        best = better
    return best


def work_of_promises(data: Data, chain: Chain) -> float:
    """Return the work of finding what to try [visits of a point]: as of a chain with every piece cut."""
    return work_of_evaluation(len(data.points), CHAIN_MOVES.parts * len(chain.matrix))


def simpler_tried(data: Data, chain: Chain, unlikely: slice = _ALL) -> Iterator[Trial]:
    """Try one piece straightened, dropped or merged, those first that promise most; docs/model.md (126).

    Each candidate that is tried is yielded, and first a trial of none: the work of finding them.

    Parameters
    ----------
    data, chain
        The points, and the chain as `fit_fixed_pieces` leaves it.
    unlikely
        Which ones to try of those that straight lines do not promise to help, the likeliest first.
    """
    promised = _simplifications(data, chain)
    yield Trial(work_of_promises(data, chain), None)
    now, latest = criterion(data, chain), information_price(CHAIN_PARAMETERS.joint, value_count(data))
    promise = np.array([each[0] for each in promised])
    order = [i for i in np.argsort(promise)[: CHAIN_MOVES.trials].tolist() if promise[i] < latest]
    for i in _tried(order, [bool(promise[i] < 0.0) for i in order], unlikely):
        yield fit_candidate(data, _simplified(chain, *promised[i][1:]), now)


def finer_tried(data: Data, chain: Chain, unlikely: slice = _ALL) -> Iterator[Trial]:
    """Try one joint more where it promises to save most, as `simpler_tried` does; docs/model.md (126)."""
    if len(chain.bend) >= CHAIN_MOVES.most_pieces:
        return
    saved, part, _ = core.saved_by_parts(*data.sensed, *chain[:5])
    yield Trial(work_of_promises(data, chain), None)
    price, now = information_price(1.0, value_count(data)), criterion(data, chain)
    order = [j for j in np.argsort(-saved)[: CHAIN_MOVES.trials].tolist() if saved[j] > price]
    sure = [bool(saved[j] > CHAIN_PARAMETERS.joint * price) for j in order]
    for j in _tried(order, sure, unlikely):
        where = float(chain.joints[j]) + piece_length(chain, j) * int(part[j]) / CHAIN_MOVES.parts
        yield fit_candidate(data, _split(chain, j, where), now)


def saved_by_slopes(data: Data, chain: Chain) -> float:
    """Return what sloping curvature in every piece would save beyond chance, in noise variances; (34).

    The steps of a staircase that stands for a smooth route fit better with a slope; those of true pieces do
    not.
    """
    return core.saved_by_parts(*data.sensed, *chain[:5])[2]


def _tried(order: Sequence[int], sure: Sequence[bool], unlikely: slice) -> list[int]:
    """Return what is sure to be worth a trial, and some of the rest; both are in order."""
    count = sum(sure)
    return [*order[:count], *order[count:][unlikely]]


def _simplifications(data: Data, chain: Chain) -> list[tuple[float, int, int]]:
    """List what could be left out: expected change of the criterion, kind and piece."""
    price, bend = information_price(1.0, value_count(data)), chain.bend
    k, column = len(bend), curvature_columns(chain.curved, data.free)
    length = np.diff(chain.joints, append=chain.stations[-1])
    components, curved = np.zeros((k, 2, len(chain.matrix))), np.flatnonzero(chain.curved)
    components[curved, 0, column[curved]] = components[curved, 1, column[curved] + 1] = 1.0
    gradient = np.concatenate((components, components[1:] - components[:-1])).reshape(2 * (2 * k - 1), -1)
    covariance = core.propagated(chain.matrix, gradient, ROUNDING.exact)
    steps = np.concatenate((bend, bend[1:] - bend[:-1]))
    wald = _wald_statistics(steps, noise_variance(data, chain) * covariance)
    listed = []
    for j, short in enumerate((length < CHAIN_MOVES.dropped_below * data.spacing).tolist()):
        if chain.curved[j]:
            listed.append((wald[j] - 2 * price, _STRAIGHTENED, j))  # docs/model.md (126)
        if j > 0:
            listed.append((wald[k + j - 1] - 3 * price, _MERGED, j))
        if k > 1 and short:
            listed.append((-price, _DROPPED, j))
    return listed


def _wald_statistics(step: np.ndarray, covariance: np.ndarray) -> list[float]:
    """Squared size of steps [r, 2] in their standard errors, by the covariance of all components [2r, 2r]."""
    diagonal = np.diag(covariance)
    x, y, of_x, of_y, of_both = (
        step[:, 0],
        step[:, 1],
        diagonal[::2],
        diagonal[1::2],
        np.diag(covariance, 1)[::2],
    )
    largest = np.maximum(of_x, of_y)
    with np.errstate(over="ignore", invalid="ignore"):  # of a bend that no point determines
        determinant = of_x * of_y - of_both**2
        flat = determinant <= 1e-12 * of_x * of_y
        squares = of_y * x**2 - 2 * of_both * x * y + of_x * y**2
        of_largest = np.divide(x**2 + y**2, largest, out=np.zeros(len(step)), where=largest > 0.0)
        return np.divide(squares, determinant, out=of_largest, where=~flat).tolist()


def _simplified(chain: Chain, kind: int, j: int) -> Chain:
    """Piece j straightened, merged with the piece before, or dropped between its neighbours."""
    k, candidate = len(chain.bend), chain._replace(form=chain.form.copy(), curved=chain.curved.copy())
    joints, bend, curved = candidate.joints, candidate.bend, candidate.curved
    if kind == _STRAIGHTENED:
        bend[j], curved[j] = 0.0, False
        return candidate
    if kind == _MERGED:
        before, after = piece_length(chain, j - 1), piece_length(chain, j)
        bend[j - 1] = (before * bend[j - 1] + after * bend[j]) / max(before + after, 1e-12)
        curved[j - 1] |= curved[j]
    elif j == 0:
        joints[1] = joints[0]
    elif j < k - 1:
        joints[j + 1] = 0.5 * (joints[j] + joints[j + 1])
    kept = np.arange(-4, k) != j
    return candidate._replace(form=candidate.form[kept], curved=curved[kept[4:]])


def without_piece(data: Data, chain: Chain, j: int, budget: Budget) -> Generator[float, None, Chain]:
    """Return the chain without piece j, dropped or merged with a neighbour, whichever fits best, in steps."""
    ways = [(_DROPPED, j), (_MERGED, j), (_MERGED, j + 1)]
    tried = list[Chain]()
    for kind, i in ways:
        if kind == _DROPPED or 0 < i < len(chain.bend):
            work, fitted = fit_with_work(data, _simplified(chain, kind, i))
            budget.left -= work
            yield work
            tried.append(fitted)
    return min(tried, key=lambda one: one.cost)


def _split(chain: Chain, j: int, where: float) -> Chain:
    """Piece j cut at arc length `where`, both parts curved as it was."""
    twice = np.arange(len(chain.form) + 1)
    twice[5 + j :] -= 1
    candidate = chain._replace(form=chain.form[twice], curved=chain.curved[twice[4:] - 4])
    candidate.joints[j + 1], candidate.curved[j : j + 2] = where, True
    return candidate
