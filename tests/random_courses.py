"""Random routes of half a metre, as chains of arcs; none of them follows a prior of the estimators."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tssgeom.route.synthetic import Course, chain

CELLS = 800  # arcs that stand for one random route


def pieces(rng: np.random.Generator) -> Course:
    """Draw half a metre of one to six pieces, each in a bending plane of its own."""
    count = rng.integers(1, 7)
    length = 0.5 * rng.dirichlet(np.full(count, 4.0))
    return chain(length, rng.uniform(0.0, 20.0, count), rng.uniform(0.0, 2.0 * np.pi, count))


def slopes(rng: np.random.Generator) -> Course:
    """Draw half a metre of curvature that is linear between four values, in a plane or slowly out of it."""
    t, nodes = (np.arange(CELLS) + 0.5) / CELLS, np.linspace(0.0, 1.0, 4)
    kappa = np.interp(t, nodes, rng.uniform(1.0, 8.0, 4))
    plane = rng.choice([0.0, 1.0]) * np.interp(t, nodes, rng.uniform(-0.5, 0.5, 4))
    return chain(np.full(CELLS, 0.5 / CELLS), kappa, plane)


def alternating(rng: np.random.Generator) -> Course:
    """Draw half a metre of three to six arcs in a plane that bend to one side and the other in turn."""
    count = rng.integers(3, 7)
    turn = rng.uniform(0.5, 1.0, count) * (-1.0) ** np.arange(count)
    length = 0.5 * rng.dirichlet(np.full(count, 6.0))
    return chain(length, turn * rng.uniform(1.0, 6.0) / (np.abs(turn) @ length))


RANDOM: dict[str, Callable[[np.random.Generator], Course]] = {
    "pieces": pieces,
    "slopes": slopes,
    "alternating": alternating,
}
