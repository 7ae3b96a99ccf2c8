"""Points that no chain of arcs fits: its work grows with the cube of the pieces, so these are few."""

from contextlib import suppress
from time import process_time

import numpy as np
import pytest

from tssgeom.core.constants_arcs import CHAIN_MOVES
from tssgeom.errors import FitError
from tssgeom.route.arcs import moves
from tssgeom.route.arcs.chain import fit_fixed_pieces
from tssgeom.route.geometry import chain_data, first_chain, measure, spline_fit
from tssgeom.route.observations import clean
from tssgeom.route.spline.fit import fit

SECONDS = 20.0
"""Of one core. Chosen: the slowest takes 4; with as many pieces as corners it took ten minutes and more."""


def _walk(rng: np.random.Generator) -> np.ndarray:
    return 1e-3 * np.cumsum(rng.standard_normal((1000, 3)), axis=0)


def _denser_than_noise(rng: np.random.Generator) -> np.ndarray:
    s = np.linspace(0.0, 0.5, 3000)
    return np.column_stack([s, 0.05 * np.sin(10.0 * s), 0.0 * s]) + 3e-4 * rng.standard_normal((3000, 3))


@pytest.mark.parametrize("noise", [None, 2.3e-4], ids=["noise unknown", "noise understated"])
@pytest.mark.parametrize("made", [_walk, _denser_than_noise])
def test_jagged_points_take_seconds(made, noise):
    points = made(np.random.default_rng(0))
    chords = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    begin = process_time()
    with suppress(FitError):  # a refusal is as good
        measure(clean(points, chords), noise)
    assert process_time() - begin < SECONDS


@pytest.mark.parametrize("count", [400, 800])
def test_the_work_on_a_chain_has_a_bound_that_is_linear_in_the_points(monkeypatch, count):
    most = 300
    monkeypatch.setattr(moves, "CHAIN_MOVES", CHAIN_MOVES._replace(most_work=most))
    k = np.arange(count)
    up = np.cumsum((k // 10) % 2 == 0)
    aside = np.cumsum(((k // 10) % 2) * (1 - 2 * ((k // 20) % 2)))
    shape = clean(1e-3 * np.column_stack((up, aside, 0 * k)).astype(float))
    spline = fit(shape, 1e-4)
    data = chain_data(shape, 1e-4, spline)
    first = fit_fixed_pieces(data, first_chain(data, spline_fit(spline)))
    work = list(moves.fit_chain_in_steps(data, first, 120))
    assert sum(work[:-1]) <= most * count < sum(work)
