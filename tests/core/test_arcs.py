"""Entries of chains against their slow twins on random chains, points and directions."""

import math

import numpy as np
import pytest

from tests.core.twins import arcs_equations, arcs_fit, arcs_moments, arcs_summary
from tssgeom import core
from tssgeom.core.constants_arcs import CHAIN_FIT, CHAIN_MOVES
from tssgeom.errors import FitError
from tssgeom.route.arcs import moves
from tssgeom.route.arcs.chain import (
    Chain,
    Data,
    WeightedTangents,
    along,
    criterion,
    fit_candidate,
    fit_fixed_pieces,
    form_of,
    noise_variance,
    parameter_count,
    squared_distances,
    unfitted,
)
from tssgeom.route.arcs.outliers import outlier_weights
from tssgeom.route.arcs.summary import chain_nodes, chain_pieces

EXACT = 1e-10


def close(result, expected, scale=None, within=EXACT):
    """Compare with the largest of what is expected, or with a scale."""
    result, expected = np.asarray(result), np.asarray(expected)
    assert result.shape == expected.shape
    largest = np.abs(expected).max(initial=0.0) if scale is None else scale
    np.testing.assert_allclose(result, expected, rtol=within, atol=within * largest)


def close_matrix(result, expected):
    """Compare matrices in the units of their diagonals."""
    unit = np.sqrt(np.maximum(np.diag(expected), 1e-300))
    close(result / np.outer(unit, unit), expected / np.outer(unit, unit))


def problem(seed):
    """Points near a random chain of one to four pieces, with and without stations, noise, and directions."""
    rng = np.random.default_rng(seed)
    k, n, free = int(rng.integers(1, 5)), int(rng.integers(20, 28)), bool(rng.integers(2))
    end = 0.4
    joints = end * (np.arange(k) + rng.uniform(-0.2, 0.2, k) * (np.arange(k) > 0)) / k
    curved = (np.arange(k) + rng.integers(2)) % 2 == 0 if rng.uniform() < 0.5 else np.ones(k, np.bool_)
    towards = rng.uniform(-math.pi, math.pi) + 2.0 * np.arange(k)
    bend = rng.uniform(6.0, 12.0, (k, 1)) * np.column_stack((np.cos(towards), np.sin(towards)))
    bend *= curved[:, None]
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    axes *= np.sign(np.linalg.det(axes))
    s = np.linspace(0.0, end, n) + 3e-3 * rng.uniform(-1.0, 1.0, n)
    position, tangent, _ = along(s, form_of(0.1 * rng.normal(size=3), axes, joints, bend))
    noise = 3e-4
    points = position + noise * rng.normal(size=(n, 3))
    if rng.uniform() < 0.4:
        points[rng.integers(n)] += 0.01 * rng.normal(size=3)
    weight = (rng.uniform(size=n) > 0.1).astype(float)
    tangents = None
    if rng.uniform() < 0.4:
        use = np.where(rng.uniform(size=n) < 0.8, 1.0, 0.0)
        unit = tangent + 0.02 * rng.normal(size=(n, 3))
        unit /= np.linalg.norm(unit, axis=1)[:, None]
        tangents = WeightedTangents(unit, use * noise**2 / 4e-4, use * 4e-4)
    variance = float(rng.choice([0.0, noise**2]))
    data = Data(points, weight, free, variance, end / n, tangents, float(rng.choice([1.0, 0.1])))
    # the fit starts some millimetres off
    start, bend = position[0] + 2e-3 * rng.normal(size=3), bend + curved[:, None] * rng.normal(size=(k, 2))
    joints[1:] += 4e-3 * rng.normal(size=k - 1)
    return data, unfitted(start, axes, joints, bend, s)._replace(curved=curved)


def determined(chain):
    """Whether the points determine every parameter to more than rounding."""
    unit = np.sqrt(np.diag(chain.matrix))
    return np.linalg.eigvalsh(chain.matrix / np.outer(unit, unit))[0] > 1e-5


def fitted(count):
    """Yield problems and their chains, fitted."""
    for seed in range(count):
        data, chain = problem(seed)
        chain = fit_fixed_pieces(data, chain)
        if determined(chain):
            yield data, chain


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1.0])
def test_positions_and_axes(scale):
    for seed in range(100):
        rng = np.random.default_rng(seed)
        k = int(rng.integers(1, 7))
        joints, bend = np.append(0.0, np.sort(rng.uniform(0, 0.5, k - 1))), scale * rng.normal(0, 20, (k, 2))
        s = np.append(rng.uniform(-0.1, 0.6, 9), joints)
        axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        start = rng.normal(size=3)
        for result, expected in zip(
            along(s, form_of(start, axes, joints, bend)),
            arcs_moments.along(s, start, axes, joints, bend),
            strict=True,
        ):
            close(result, expected)
        _, frames = core.along_chain(joints, form_of(start, axes, joints, bend))
        close(frames, arcs_moments.joint_frames(start, axes, joints, bend)[1])


def test_fits():
    """Final chains, whose equations are those of the twin to rounding, after as many steps."""
    steps = 0
    for seed in range(60):
        data, chain = problem(seed)
        restart = seed % 3 == 0
        result = fit_fixed_pieces(data, chain, restart=restart)
        if not determined(result):
            continue
        expected = arcs_fit.fit_pieces(data, chain, math.inf, restart and data.free)
        steps += expected.cost < 0.9 * arcs_fit.evaluated(data, chain)[0].cost
        # a joint that the points hardly determine loses digits, here and in the twin
        for name in ("start", "axes", "joints"):
            close(getattr(result, name), getattr(expected, name), 1.0)
        close(result.bend, expected.bend, 100.0)
        close(result.stations, expected.stations, 1.0)
        close(result.cost, expected.cost)
        close(result.square, expected.square)
        close_matrix(result.matrix, expected.matrix)
    assert steps > 25  # most of them are fits that move


def test_a_candidate_that_cannot_come_down_is_given_up_and_one_that_does_is_fitted():
    better = 0
    for seed in range(30):
        data, chain = problem(seed)
        plain = arcs_fit.fit_pieces(data, chain, math.inf, False)
        least = criterion(data, plain) + (1.0 if seed % 2 else -1.0)
        result = fit_candidate(data, chain, least).better
        expected = arcs_fit.improved(data, chain, least)
        assert (result is None) == (expected is None)
        if result is not None and expected is not None:
            better += 1
            close(result.cost, expected.cost)
            close(result.joints, expected.joints, 1.0)
    assert better > 8


def test_weights_of_points():
    changed = 0
    for seed in range(400):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 40))
        square = 1e-6 * rng.normal(size=n) ** 2 * rng.choice([1.0, 1e3], n, p=[0.95, 0.05])
        weight = (rng.uniform(size=n) > 0.05).astype(float)
        variance, last = float(rng.choice([0.0, 1e-6])), float(rng.choice([0.0, 1e-7, 1e-5]))
        data = Data(np.zeros((n, 3)), weight, bool(seed % 2), variance, 0.01)
        expected, weights = arcs_fit.outlier_weights(data, square, last)
        chain = unfitted(np.zeros(3), np.eye(3), np.zeros(1), np.zeros((1, 2)), np.zeros(n))
        result = outlier_weights(data, chain._replace(square=square), last)
        assert (result is not None) == expected
        if result is not None:
            np.testing.assert_array_equal(result, weights)
        changed += expected
    assert changed > 100


def test_whether_a_chain_fits():
    fits = 0
    for seed, (data, chain) in enumerate(fitted(150)):
        rng = np.random.default_rng(seed)
        last = noise_variance(data, chain) * 10.0 ** rng.uniform(-2.0, 3.0)
        if seed % 4 == 0:
            chain.bend[...] *= 40.0  # turns unobserved between its points
        weights = None if data.tangents is None else data.tangents.weight
        given = (data.weight, data.free, data.variance, data.spacing, weights)
        result = core.chain_fits(len(chain.matrix), *given, chain.form, chain.stations, chain.cost, last)
        assert bool(result) is not arcs_fit.unfit(data, chain, last)
        fits += result
    assert 20 < fits < 130


def test_pieces_and_their_errors():
    for data, chain in fitted(100):
        k = len(chain.bend)
        sizes, covariance, noise, hidden = arcs_summary.pieces(data, chain)
        length, angle, result, own, which, bends, _ = core.chain_pieces(*data.sensed, *chain[:5])
        close(length, sizes[:k])
        close(angle, sizes[k:])
        close_matrix(result, covariance)
        close(own, noise)
        close(bends, hidden)
        assert which == arcs_summary.unidentifiable(length, covariance, data.spacing)


def test_profiles_on_nodes():
    for data, chain in fitted(30):
        nodes = chain_nodes(data, chain, 1e-3)
        profile, route = nodes.profile, nodes.route
        begin = chain.stations[0]
        expected = arcs_summary.profile(data, chain, route.s + begin)
        # rounding of s + begin may put a node at a joint on its other side
        off = np.abs(route.s[:, None] + begin - chain.joints[1:]).min(axis=1, initial=1.0) > 1e-15
        for result, line in zip(
            (profile.kappa, profile.kappa_se, profile.phi, profile.phi_se), expected, strict=True
        ):
            close(result[off], line[off])
        # every joint is a node, and so are both ends
        for joint in (*chain.joints[1:], chain.stations[-1]):
            assert np.min(np.abs(route.s + begin - joint)) < 1e-15
        here = arcs_moments.along(chain.stations, chain.start, chain.axes, chain.joints, chain.bend)[0]
        close(route.residual, data.points - here, 1.0)


def test_a_frame_is_a_fit_without_outliers_and_its_pieces():
    outliers = 0
    for seed in range(80):
        data, chain = problem(seed)
        spacing = core.spacing_of_pieces(data.points, float(chain.stations[-1] - chain.stations[0]))
        kinks = np.any(np.diff(chain.joints[1:]) < spacing)
        shortest = CHAIN_FIT.kink if kinks else 1.0
        data = data._replace(weight=np.ones(len(data.points)), spacing=spacing, shortest=shortest)
        assert core.chain_scale(data.points, chain.form, chain.stations) == (spacing, shortest)
        last = 1e-7
        count = parameter_count(chain.curved, data.free)
        points, _, free, variance, _, *directions = data.sensed
        given = (count, points, free, variance, *directions, *chain[:3], last)
        *scale, fits, weight = (results := core.follow_chain(*given))[:4]
        assert scale == [spacing, shortest]
        rest = results[4:]
        expected = fit_fixed_pieces(data, chain, restart=True)
        weights = outlier_weights(data, expected, last)
        if weights is not None:
            outliers += 1
            data = data._replace(weight=weights)
            expected = fit_fixed_pieces(data, expected)
        np.testing.assert_array_equal(weight, data.weight)
        result = Chain(rest[0], chain.curved, *rest[1:5])
        for one, other in zip(result, expected, strict=True):
            np.testing.assert_array_equal(one, other)
        assert bool(fits) is not arcs_fit.unfit(data, expected, last)
        for one, other in zip(rest[5:], chain_pieces(data, expected), strict=True):
            np.testing.assert_array_equal(one, other)
    assert outliers > 10


def test_a_fit_is_the_same_wherever_arc_length_is_counted_from():
    for seed in range(30):
        data, chain = problem(seed)
        form = chain.form.copy()
        form[4:, 0] += 0.07
        elsewhere = chain._replace(form=form, stations=chain.stations + 0.07)
        here, there = (fit_fixed_pieces(data, each, restart=True) for each in (chain, elsewhere))
        if determined(here):
            form = there.form - here.form
            form[4:, 0] -= 0.0 if data.free else 0.07  # a chain that slides begins at its first foot
            assert np.abs(form).max() < 1e-6  # of iterations that end at another rounding


def test_what_could_be_left_out():
    for data, chain in fitted(100):
        promise, kind, piece = arcs_summary.simplifications(data, chain)
        result = moves._simplifications(data, chain)
        assert [each[1:] for each in result] == list(zip(kind, piece, strict=True))
        close([each[0] for each in result], promise, within=1e-8)  # of ratios of what hardly differs


def test_what_more_joints_and_slopes_would_save():
    for data, chain in fitted(60):
        best, part, slopes = core.saved_by_parts(*data.sensed, *chain[:5])
        saved = arcs_summary.saved_by_joints(data, chain)
        # what remains of information that nearly cancels: eight digits of it
        close(best, saved.max(axis=1), max(saved.max(), 1.0), 1e-8)
        close(saved[np.arange(len(part)), part], best, max(saved.max(), 1.0), 1e-8)
        close(slopes, arcs_summary.saved_by_slopes(data, chain), 10.0, 1e-8)


def test_covariances_are_propagated():
    for seed in range(200):
        rng = np.random.default_rng(seed)
        m, r = int(rng.integers(1, 14)), int(rng.integers(0, 6))
        root = rng.normal(size=(m + 2, m))
        matrix, gradient = root.T @ root + np.diag(10.0 ** rng.uniform(-2, 2, m)), rng.normal(size=(r, m))
        damping = float(rng.choice([0.0, 1e-13, 1e-3]))
        expected = arcs_fit.propagated(*arcs_fit.factor(matrix, damping), gradient)
        close(core.propagated(matrix, gradient, damping), expected)


def test_squared_distances():
    for data, chain in fitted(50):
        x, tangent, _ = arcs_moments.along(chain.stations, chain.start, chain.axes, chain.joints, chain.bend)
        off = data.points - x
        whole = np.sum(off**2, axis=1)
        close(squared_distances(data, chain, across=False), whole)
        lateral = np.maximum(whole - np.sum(off * tangent, axis=1) ** 2, 0.0)
        close(squared_distances(data, chain, across=True), lateral)


def test_numbers_that_are_none_end_without_a_result():
    for name in ("points", "weight"):
        data, chain = problem(3)
        broken = getattr(data, name).copy()
        broken[2] = math.nan
        assert (
            not fit_fixed_pieces(data._replace(**{name: broken}), chain).cost < math.inf or name == "weight"
        )
    data, chain = problem(3)
    for name in ("start", "axes", "joints", "bend", "stations"):
        nowhere = chain._replace(form=chain.form.copy(), stations=chain.stations.copy())
        getattr(nowhere, name)[...] = math.nan
        assert math.isnan(fit_fixed_pieces(data, nowhere).cost)
        count = parameter_count(chain.curved, data.free)
        known = (count, data.points, data.free, 0.0, None, None)
        assert not core.follow_chain(*known, *nowhere[:3], 0.0)[2]
        assert fit_candidate(data, nowhere, 1e9).better is None
    unknown = np.full_like(data.points, math.nan)
    assert not core.follow_chain(count, unknown, data.free, 0.0, None, None, *chain[:3], 0.0)[2]


def test_points_in_one_position_and_one_point_alone_end():
    for n in (1, 2, 8):
        data, chain = problem(5)
        data = data._replace(points=np.ones((n, 3)), weight=np.ones(n), tangents=None)
        chain = chain._replace(stations=np.zeros(n))
        chain_pieces(data, fit_fixed_pieces(data, chain))


def test_arrays_that_do_not_belong_together_are_refused():
    data, chain = problem(1)
    count = parameter_count(chain.curved, data.free)
    with pytest.raises(FitError, match="do not belong to each other"):
        core.fit_pieces(count + 1, *data.sensed, data.shortest, *chain[:3], math.inf, False)
    given = (data.points[:1], data.free, 0.0, None, None, *chain[:2], chain.stations[:1], 0.0)
    with pytest.raises(FitError, match="do not belong to each other"):  # one point has no spacing
        core.follow_chain(count, *given)
    with pytest.raises(ValueError, match="stations has shape"):
        core.fit_pieces(count, *data.sensed, data.shortest, *chain[:2], chain.stations[:-1], math.inf, False)


def test_limits_of_the_twin_are_those_of_the_core():
    assert CHAIN_MOVES.parts == 4
    assert CHAIN_FIT.most_steps == 40
    assert arcs_equations.normal_equations.__doc__
