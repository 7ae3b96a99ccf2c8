"""Points that no chain of arcs fits: its work grows with the cube of the pieces, so these are few."""

from contextlib import suppress
from time import process_time

import numpy as np
import pytest

from tssgeom import core
from tssgeom.core.constants_arcs import CHAIN_MOVES
from tssgeom.errors import FitError
from tssgeom.route import geometry
from tssgeom.route.arcs import moves
from tssgeom.route.arcs.chain import along, fit_fixed_pieces, work_of_evaluation
from tssgeom.route.geometry import chain_data, first_chain, measure, spline_fit
from tssgeom.route.observations import clean
from tssgeom.route.spline.fit import fit

SECONDS = 10.0
"""Of one core. Chosen: the slowest takes 1; without a bound on the work it took ten minutes and more."""


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


def _square_wave(count: int, leg: int) -> np.ndarray:
    k = np.arange(count)
    up = np.cumsum((k // leg) % 2 == 0)
    aside = np.cumsum(((k // leg) % 2) * (1 - 2 * ((k // (2 * leg)) % 2)))
    return 1e-3 * np.column_stack((up, aside, 0 * k)).astype(float)


def _helix(count: int, turns: float) -> np.ndarray:
    turn = np.linspace(0.0, 2.0 * np.pi * turns, count)
    return 1e-3 * np.column_stack((10.0 * np.cos(turn), 10.0 * np.sin(turn), turn))


def _sparse_spiral(count: int, turns: float) -> np.ndarray:
    turn = 2.0 * np.pi * turns * np.sqrt(np.linspace(0.0, 1.0, count))
    return 1e-3 * np.column_stack((turn * np.cos(turn), turn * np.sin(turn), 0.1 * turn))


@pytest.mark.parametrize("count", [400, 800])
def test_the_work_on_a_chain_has_a_bound_that_is_linear_in_the_points(monkeypatch, count):
    most = 30
    monkeypatch.setattr(moves, "CHAIN_MOVES", CHAIN_MOVES._replace(most_evaluations=most))
    shape = clean(_square_wave(count, 10))
    spline = fit(shape, 1e-4)
    data = chain_data(shape, 1e-4, spline)
    first = fit_fixed_pieces(data, first_chain(data, spline_fit(spline)))
    work = list(moves.fit_chain_in_steps(data, first, 120))
    assert sum(work[:-1]) <= most * (count + CHAIN_MOVES.work_of_any) < sum(work)


def test_a_first_guess_has_no_more_pieces_than_a_chain_may_have():
    shape = clean(_square_wave(400, 10))
    smooth = spline_fit(spline := fit(shape, 1e-4))
    assert len(smooth.arcs.length) > CHAIN_MOVES.most_pieces
    assert len(first_chain(chain_data(shape, 1e-4, spline), smooth).bend) == CHAIN_MOVES.most_pieces


def test_a_search_that_changes_nothing_is_made_once():
    shape = clean(_square_wave(749, 17))
    spline = fit(shape)
    data = chain_data(shape, None, spline)
    chain = fit_fixed_pieces(data, first_chain(data, spline_fit(spline)))
    budget = moves.Budget(data)
    best = moves.fit_chain(data, chain, budget)
    left = budget.left
    assert moves.fit_chain(data, best, budget, 1) is best
    once = left - budget.left
    assert once > 0.0
    budget.left = begun = moves.Budget(data).left
    geometry._competitive(data, best, spline, budget)
    assert begun - budget.left <= 1.01 * once


HOSTILE = {
    "a helix of 2.8 points a turn": (lambda rng: _helix(460, 164.0), 1e-5),
    "a walk": (lambda rng: 5.0 * _walk(rng), 5e-4),
    "a spiral with a turn between two points": (lambda rng: _sparse_spiral(4000, 39.0), 1e-4),
    "more corners than pieces": (
        lambda rng: _square_wave(2190, 18) + 5e-4 * rng.standard_normal((2190, 3)),
        5e-4,
    ),
}


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("sensed", [False, True], ids=["stations unknown", "stations known"])
def test_a_chain_that_leaves_its_points_is_no_answer(name, sensed):
    made, noise = HOSTILE[name]
    points = made(np.random.default_rng(1))
    chords = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    try:
        result = measure(clean(points, chords) if sensed else clean(points), noise)
    except FitError:
        return
    if result.chain is None:
        assert result.spline is not None
        residual = result.spline.route.residual
    else:
        residual = points - along(result.chain.stations, result.chain.form)[0]
    spacing = result.arcs.total_length / len(points)
    rms = np.sqrt(np.mean(np.sum(residual**2, axis=1)[result.weight > 0.0]))
    assert rms < 2.0 * np.hypot(spacing, 4.0 * noise)


def test_noise_that_is_stated_far_too_low_does_not_narrow_the_bars_of_a_chain():
    rng = np.random.default_rng(4)
    s = np.linspace(0.0, np.pi, 200)
    exact = 0.5 / np.pi * np.column_stack((np.sin(s), 1.0 - np.cos(s), 0.0 * s))
    beyond = 0
    for _ in range(40):
        result = measure(clean(exact + 2e-4 * rng.standard_normal(exact.shape)), 1e-4, "arcs")
        assert result.noise == pytest.approx(2e-4, rel=0.2)
        assert any("and not 0.1 mm: check for outlying points" in each for each in result.warnings)
        beyond += abs(result.arcs.total_angle - np.pi) > 1.96 * result.arcs.total_angle_se
    assert beyond <= 6  # of 40 at 5 %: more than 6 have a chance of 0.3 %


def test_what_the_points_do_not_determine_is_dropped_within_the_budget(monkeypatch):
    """With noise of twenty spacings a chain has many such pieces, and each is three fits."""
    rng, angle = np.random.default_rng(0), np.linspace(0.0, np.pi, 4000)
    exact = 0.5 / np.pi * np.column_stack((np.sin(angle), 1.0 - np.cos(angle), 0.0 * angle))
    real, work = core.fit_pieces, []

    def counted(parameters, points, *rest):
        result = real(parameters, points, *rest)
        work.append(result[1] * work_of_evaluation(len(points), parameters))
        return result

    monkeypatch.setattr(core, "fit_pieces", counted)
    result = measure(clean(exact + 2.5e-3 * rng.standard_normal(exact.shape), 0.5 / np.pi * angle))
    assert abs(result.arcs.total_angle - np.pi) < 3.0 * result.arcs.total_angle_se
    assert sum(work) < 2.0 * CHAIN_MOVES.most_evaluations * (len(angle) + CHAIN_MOVES.work_of_any)
