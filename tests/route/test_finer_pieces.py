"""How the angle of a smooth route is spread within its pieces, and how that errs."""

import numpy as np
import pytest

from tests.bristle.sheath import random_sheath, sensed
from tests.known_routes import Cell, draw
from tssgeom import clean, measure
from tssgeom.route.finer_pieces import finer_pieces
from tssgeom.route.pieces import Arcs
from tssgeom.route.resolution import at_resolution

NOISE = 1.5e-4


def routes(seed, count):
    """Random waves in space and helices, and what is sensed of each."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        sheath = random_sheath(rng, rng.uniform(0.4, 0.6), rng.uniform(1.5, 3.5), (0, 2)[k % 2])
        stations, points = sensed(sheath, rng, 120, NOISE, 1.0)
        yield sheath, measure(clean(points, stations=stations), noise=NOISE)


def angle_up_to(arcs, s):
    return np.interp(s, np.append(arcs.s_start, arcs.total_length), np.append(0.0, np.cumsum(arcs.angle)))


def scores(sheath, arcs, count=6):
    """Errors of the angle up to any arc length over their standard errors, along `count` widest ones."""
    s = np.linspace(0.0, sheath.length, 41)[1:]
    off = angle_up_to(arcs, s) - np.interp(s, sheath.s, sheath.angle)
    share = np.clip((s[:, None] - arcs.s_start) / arcs.length, 0.0, 1.0)
    k = len(arcs.length)
    variance, axes = np.linalg.eigh(share @ arcs.covariance[k:, k:] @ share.T)
    count = min(count, int(np.sum(variance > 1e-6 * variance[-1])))
    return (axes.T @ off)[::-1][:count] / np.sqrt(variance[::-1][:count])


def sums_of(arcs, whole):
    """Which of the finer pieces [k] lie in which of the whole ones [m], m by k."""
    piece = np.searchsorted(whole.s_start, arcs.s_start + 0.5 * arcs.length) - 1
    return np.equal.outer(np.arange(len(whole.length)), piece).astype(float)


def test_finer_pieces_have_the_sums_of_the_pieces_and_the_covariance_of_these_sums():
    (_, fit), *_ = routes(1, 1)
    whole, fine = fit.arcs, finer_pieces(fit)
    sums = sums_of(fine, whole)
    assert 40 <= len(fine.length) < 60
    np.testing.assert_allclose(sums @ fine.length, whole.length, rtol=1e-9)
    at_joints = np.interp(np.append(whole.s_start, whole.total_length), fit.profile.s, fit.profile.phi)
    np.testing.assert_allclose(sums @ fine.angle, np.diff(at_joints), rtol=1e-9)
    both = np.kron(np.eye(2), sums)
    np.testing.assert_allclose(both @ fine.covariance @ both.T, whole.covariance, rtol=1e-6, atol=1e-12)
    assert fine.total_angle_se == pytest.approx(whole.total_angle_se, rel=1e-6)
    assert np.linalg.eigvalsh(fine.covariance).min() > -1e-12


def test_where_the_angle_lies_errs_by_what_finer_pieces_state():
    fine = np.concatenate([scores(sheath, finer_pieces(fit)) for sheath, fit in routes(2, 12)])
    assert 0.5 < np.sqrt(np.mean(fine**2)) < 1.3
    assert np.mean(np.abs(fine) < 1.96) > 0.9


def test_the_angle_is_nearer_to_the_true_one_at_any_arc_length():
    off = np.zeros(2)
    for sheath, fit in routes(3, 12):
        s = np.linspace(0.0, sheath.length, 41)[1:]
        true = np.interp(s, sheath.s, sheath.angle)
        for way, arcs in enumerate((fit.arcs, finer_pieces(fit))):
            spread = angle_up_to(arcs, s) - true * arcs.total_angle / sheath.total_angle
            off[way] += np.mean(spread**2)
    assert off[1] < 0.7 * off[0]


def test_few_pieces_of_a_spiral_turn_where_it_turns_on_the_whole():
    cell = Cell("smooth", "clothoid", 200, 1e-4)
    off = []
    for trial in range(3):
        sight = draw(cell, trial)
        fit = measure(clean(sight.points, sight.station), cell.noise)
        arcs, profile = fit.arcs, fit.profile
        assert len(arcs.length) < 6
        within = angle_up_to(arcs, profile.s) - profile.phi
        off.append(np.trapezoid(within, profile.s) / np.trapezoid(profile.phi, profile.s))
    assert np.max(np.abs(off)) < 6e-3  # 0.02 where each joint has the angle of the route


def test_a_chain_of_arcs_is_its_pieces():
    s = np.linspace(0.0, 0.5, 60)
    turn = np.clip(s - 0.2, 0.0, 0.1) * 15.0
    step = np.diff(s, prepend=0.0)[:, None]
    points = np.cumsum(step * np.column_stack((np.cos(turn), np.sin(turn), 0.0 * s)), axis=0)
    fit = measure(clean(points + np.random.default_rng(1).normal(0.0, 1e-4, points.shape)), method="arcs")
    assert finer_pieces(fit) is fit.arcs


def test_finer_pieces_of_a_route_at_a_resolution_have_its_angle():
    (_, fit), *_ = routes(4, 1)
    smoother, _ = at_resolution(fit, 0.05)
    fine = finer_pieces(smoother)
    assert fine.total_angle == pytest.approx(smoother.arcs.total_angle, rel=1e-6)
    assert fine.total_length == pytest.approx(smoother.arcs.total_length, rel=1e-9)


def test_moved_pieces_keep_their_order_and_do_not_turn_back():
    arcs = Arcs.exact(np.array([0.1, 0.2]), np.array([1.0, 0.5]))
    moved = arcs.moved(np.array([0.01, -0.01, 0.1, -0.1]))
    np.testing.assert_allclose(moved.length, [0.11, 0.19])
    np.testing.assert_allclose(moved.angle, [1.1, 0.4])
    far = arcs.moved(np.array([-1.0, 0.0, -2.0, 0.0]))
    np.testing.assert_allclose(far.length, [0.01, 0.2])
    np.testing.assert_allclose(far.angle, [0.0, 0.5])
