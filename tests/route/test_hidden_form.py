"""Many noisy points hide whether a bend is an arc or a sine; docs/model.md (258), (259)."""

import numpy as np
import pytest

from tssgeom.route.arcs.moves import fit_chain
from tssgeom.route.bend_priors import hidden_form
from tssgeom.route.geometry import chain_data, first_chain, fit_fixed_pieces, measure, spline_fit
from tssgeom.route.model_choice import chain_evidence, preference
from tssgeom.route.observations import clean
from tssgeom.route.spline.fit import fit
from tssgeom.route.synthetic import Course, chain, positions
from tssgeom.route.tracking import follow, model_checked

CELLS, NOISE = 240, 1e-3
S = np.linspace(0.0, 0.4, 401)


def sensed(course: Course, n: int, rng: np.random.Generator) -> np.ndarray:
    """Noisy points at even stations [m]."""
    s = np.linspace(0.0, course.total_length, n)
    return positions(course, s) + NOISE * rng.standard_normal((n, 3))


def alternating(rng: np.random.Generator) -> Course:
    """Three to six arcs of one length in a plane, each to the other side."""
    count = int(rng.integers(3, 7))
    kappa = rng.uniform(0.5, 1.0, count) * (-1.0) ** np.arange(count)
    length = rng.uniform(0.2, 0.6)
    kappa *= rng.uniform(2.0, 6.0) / (np.abs(kappa).mean() * length)
    return chain(np.full(count, length / count), kappa)


def sine(rng: np.random.Generator) -> Course:
    """Three to eight half waves of curvature in a plane."""
    at = (np.arange(CELLS) + 0.5) / CELLS
    kappa = np.sin(np.pi * rng.uniform(3.0, 8.0) * at + rng.uniform(0.0, 6.28))
    length = rng.uniform(0.2, 0.6)
    kappa *= rng.uniform(2.0, 6.0) / (np.abs(kappa).mean() * length)
    return chain(np.full(CELLS, length / CELLS), kappa)


def waves(amplitude: float, half_waves: int = 4) -> np.ndarray:
    """Curvature of a sine in a plane that is turned about the route [n, 2] [1/m]."""
    return amplitude * np.outer(np.sin(np.pi * half_waves * S / S[-1]), (0.6, 0.8))


def test_of_bends_of_one_harmonic_every_form_is_left():
    turn = 2.0 / np.pi * 5.0 * S[-1]
    assert hidden_form(waves(5.0), S, 100, 1.0) == pytest.approx(
        np.std([np.pi / 4, 1, np.pi**2 / 8]) * turn, rel=1e-3
    )


FIRST = 5.0 * (0.1 / np.pi) ** 2  # first harmonic of four bends of 0.1 m with a sine of curvature 5/m [m]


def test_what_the_third_harmonic_of_arcs_would_show_is_certain():
    """It is 1/27 of the first one; two standard errors of a bend of 25 points leave 1/cosh(1)."""
    noise = FIRST / 27.0 * np.sqrt(25.0 / 2.0) / 2.0
    whole = hidden_form(waves(5.0), S, 100, 1.0)
    assert hidden_form(waves(5.0), S, 100, noise) == pytest.approx(whole / np.cosh(1.0), rel=0.01)
    assert hidden_form(waves(5.0), S, 100, noise / 10.0) < 1e-9
    assert hidden_form(waves(5.0), S, 100, 0.0) < 1e-9


def test_great_bends_are_certain_beside_small_ones():
    noise = FIRST / 27.0 * np.sqrt(25.0 / 2.0) / 2.0
    some = np.where((S < 0.2)[:, None], 100.0, 1.0) * waves(5.0)
    half = 0.5 * hidden_form(waves(5.0), S, 100, noise)
    assert hidden_form(some, S, 100, noise) == pytest.approx(half, rel=0.05)


@pytest.mark.parametrize("route", [alternating, sine])
def test_intervals_hold_the_turn_of_arcs_and_of_sines_that_points_do_not_distinguish(route):
    rng, held = np.random.default_rng(100), 0
    for trial in range(40):
        course = route(rng)
        arcs = measure(clean(sensed(course, 100, rng)), NOISE if trial % 2 else None).arcs
        held += abs(arcs.total_angle - course.total_angle) < 1.96 * arcs.total_angle_se
    assert held >= 34


def fitted(course: Course, rng: np.random.Generator):
    """Points, spline, and the chain that fits them best."""
    shape = clean(sensed(course, 200, rng))
    spline = fit(shape, NOISE)
    data = chain_data(shape, NOISE, spline)
    return data, fit_chain(data, fit_fixed_pieces(data, first_chain(data, spline_fit(spline)))), spline


def test_arcs_that_alternate_are_selected_and_staircases_on_sines_are_not():
    rng, selected, only_without_price = np.random.default_rng(4), [], 0
    for route in (alternating, sine):
        chosen = 0
        for _ in range(12):
            made = fitted(route(rng), rng)
            evidence = chain_evidence(*made)
            chosen += preference(*made, evidence) > 0.0
            only_without_price += preference(*made, evidence) > 0.0 > evidence.priced
        selected.append(chosen)
    assert selected[0] >= 6
    assert selected[1] <= 1
    assert only_without_price >= 2


def test_a_stream_keeps_the_chain_and_what_the_form_of_bends_adds():
    rng = np.random.default_rng(6)
    for seed in range(4):
        course, last, held = alternating(np.random.default_rng(seed)), None, []
        for _ in range(48):
            last = model_checked(follow(clean(sensed(course, 120, rng)), NOISE, last))
            arcs = last.fit.arcs
            held.append(abs(arcs.total_angle - course.total_angle) < 2.5 * arcs.total_angle_se)
        assert np.mean(held) >= 0.8
