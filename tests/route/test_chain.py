"""The chain of arcs: exact derivatives, the right pieces and errors, and the choice against the spline."""

import numpy as np
import pytest

from tests.core.twins.arcs_equations import normal_equations, slide_of_end
from tests.route.test_unresolved_curvature import chain_of
from tssgeom import core
from tssgeom.arrays import read_only
from tssgeom.route.arcs.chain import (
    Data,
    WeightedTangents,
    along,
    fit_fixed_pieces,
    form_of,
    squared_distances,
    unfitted,
)
from tssgeom.route.arcs.summary import chain_pieces, identifiable
from tssgeom.route.geometry import measure
from tssgeom.route.observations import clean
from tssgeom.route.synthetic import chain, colon, half_circle, setup_a

JOINTS = np.array([0.0, 0.1, 0.17, 0.3])
BEND = np.array([[5.0, 3.0], [0.0, 0.0], [-20.0, 10.0], [1e-5, 2e-5]])
CURVED = np.array([True, False, True, True])
LINE = chain(np.array([0.5]), np.array([0.0]))
SIX = chain(
    np.array([0.05, 0.1, 0.08, 0.1, 0.07, 0.1]),
    np.array([0.0, 20.0, 0.0, 40.0, 10.0, 0.0]),
    np.array([0.0, 0.0, 0.0, 2.0, 0.5, 0.0]),
)


@pytest.fixture
def start():
    rng = np.random.default_rng(0)
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return 0.1 * rng.normal(size=3), axes * np.sign(np.linalg.det(axes))


def _turned(axes, about):
    size = np.linalg.norm(about)
    x, y, z = about / max(size, 1e-300)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return axes @ (np.eye(3) + np.sin(size) * cross + (1 - np.cos(size)) * cross @ cross).T


def _moved(values, start, free):
    """Chain after a parameter step, written without the code under test."""
    position, axes = start
    shifts = 2 if free else 3
    position = position + (values[:shifts] @ axes[1:] if free else values[:shifts])
    axes = _turned(axes, values[shifts] * axes[1] + values[shifts + 1] * axes[2])
    joints, bend, row = JOINTS.copy(), BEND.copy(), shifts + 5
    joints[1:] += values[shifts + 2 : row]
    for j in np.flatnonzero(CURVED):
        bend[j] += values[row : row + 2]
        row += 2
    return position, axes, joints, bend


@pytest.mark.parametrize("free", [False, True])
def test_normal_equations_are_those_of_finite_differences(start, free):
    rng = np.random.default_rng(1)
    s = np.sort(rng.uniform(0, 0.4, 60))
    m = (2 if free else 3) + 2 + 3 + 6
    here, tangent, _ = along(s, form_of(*_moved(np.zeros(m), start, free)))
    points = read_only(here + 1e-3 * rng.normal(size=(60, 3)))
    weight = rng.uniform(0.5, 2.0, 60)
    jacobian = np.empty((60, 3, m))
    for i in range(m):
        step = 1e-6 * np.eye(m)[i]
        forward, behind = (along(s, form_of(*_moved(v, start, free)))[0] for v in (step, -step))
        jacobian[:, :, i] = (forward - behind) / 2e-6
    across = np.eye(3) - (tangent[:, :, None] * tangent[:, None, :] if free else 0.0)
    metric = across * weight[:, None, None] if free else np.eye(3) * weight[:, None, None]
    data, given = Data(points, weight, free, 0.0, 0.4 / 60), _chain(*start, JOINTS, BEND, s)
    matrix, gradient, cost, square = normal_equations(data, given, 0.0)
    expected = np.einsum("nia,nij,njb->ab", jacobian, metric, jacobian)
    scale = np.sqrt(np.diag(expected))
    # central differences with a step of 1e-6 are good to 1e-9 of curvatures up to 20/m
    np.testing.assert_allclose(matrix / np.outer(scale, scale), expected / np.outer(scale, scale), atol=2e-8)
    slope = np.einsum("nia,nij,nj->a", jacobian, metric, points - here)
    np.testing.assert_allclose(gradient / scale, slope / scale, atol=1e-9)
    assert cost == pytest.approx(np.einsum("ni,nij,nj->", points - here, metric, points - here), rel=1e-12)
    distance = squared_distances(data, given, across=free)
    np.testing.assert_allclose(square, distance, rtol=1e-9)  # of 1 mm, to the rounding of positions of 0.1 m


@pytest.mark.parametrize("free", [False, True])
def test_rows_of_directions_are_those_of_finite_differences(start, free):
    rng = np.random.default_rng(4)
    s = np.sort(rng.uniform(-0.01, 0.41, 60))
    m = (2 if free else 3) + 2 + 3 + 6
    here, tangent, _ = along(s, form_of(*_moved(np.zeros(m), start, free)))
    sensed = tangent + 1e-3 * rng.normal(size=(60, 3))
    weight = np.where(rng.uniform(size=60) < 0.2, 0.0, rng.uniform(0.5, 2.0, 60))
    jacobian = np.empty((60, 3, m))
    for i in range(m):
        step = 1e-6 * np.eye(m)[i]
        forward, behind = (along(s, form_of(*_moved(v, start, free)))[1] for v in (step, -step))
        jacobian[:, :, i] = (forward - behind) / 2e-6
    metric = (np.eye(3) - tangent[:, :, None] * tangent[:, None, :]) * weight[:, None, None]
    # points on the chain have no residual; their share is taken off again
    alone = Data(read_only(here), np.ones(60), free, 0.0, 0.4 / 60)
    beside = alone._replace(tangents=WeightedTangents(sensed, weight, weight))
    without, level, _, _ = normal_equations(alone, _chain(*start, JOINTS, BEND, s), 0.0)
    matrix, gradient, cost, _ = normal_equations(beside, _chain(*start, JOINTS, BEND, s), 0.0)
    expected = np.einsum("nia,nij,njb->ab", jacobian, metric, jacobian)
    # central differences with a step of 1e-6 are good to 1e-9 of curvatures up to 20/m
    size = np.abs(expected).max()
    np.testing.assert_allclose((matrix - without) / size, expected / size, atol=1e-8)
    slope = np.einsum("nia,nij,nj->a", jacobian, metric, sensed - tangent)
    np.testing.assert_allclose(gradient - level, slope, atol=1e-8 * np.abs(slope).max())
    assert cost == pytest.approx(
        np.einsum("ni,nij,nj->", sensed - tangent, metric, sensed - tangent), rel=1e-9
    )  # that of the points is rounding


def test_feet_are_where_the_distance_is_least(start):
    rng = np.random.default_rng(2)
    s = np.linspace(0.02, 0.38, 40)
    x, _, _ = along(s, form_of(*start, JOINTS, BEND))
    points = read_only(x + 2e-3 * rng.normal(size=(40, 3)))
    foot, data = s.copy(), Data(points, np.ones(40), True, 0.0, 0.4 / 40)
    for _ in range(6):
        normal_equations(data, _chain(*start, JOINTS, BEND, foot), 0.01)
    fine = np.linspace(0.0, 0.4, 40001)
    curve, _, _ = along(fine, form_of(*start, JOINTS, BEND))
    nearest = np.array([fine[np.argmin(np.sum((curve - p) ** 2, axis=1))] for p in points])
    np.testing.assert_allclose(foot, nearest, atol=2e-5)  # the grid is 1e-5 m


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize(("course", "count"), [(LINE, 1), (half_circle(), 1), (setup_a(), 2), (SIX, 6)])
def test_the_estimate_has_the_true_pieces(sensed, course, count, known):
    right = 0
    for seed in range(6):
        points, s = sensed(course, 200, 3e-4, seed)
        result = measure(clean(points, s if known else None))
        right += result.arcs.method == "arcs" and len(result.arcs.length) == count
    assert right >= 5  # 98 % each: two wrong of six have a chance of 0.6 %


def test_the_estimate_of_a_straight_route_has_no_angle_at_all(sensed):
    result = measure(clean(sensed(LINE, 100, 5e-4)[0]))
    assert result.arcs.total_angle == 0.0


@pytest.mark.parametrize("course", [setup_a(), SIX])
def test_chain_is_an_order_better_than_the_spline_where_pieces_are_true(sensed, course):
    errors = {"spline": [], "auto": []}
    for seed in range(8):
        points, s = sensed(course, 200, 5e-4, seed)
        for method, out in errors.items():
            out.append(measure(clean(points, s), method=method).arcs.total_angle - course.total_angle)
    rms = {method: np.sqrt(np.mean(np.square(out))) for method, out in errors.items()}
    assert rms["auto"] < 0.25 * rms["spline"]


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("course", [half_circle(), setup_a(), SIX])
def test_the_error_bars_of_the_chain_are_right(sensed, course, known):
    z = []
    for seed in range(24):
        points, s = sensed(course, 120, 4e-4, seed + 100)
        result = measure(clean(points, s if known else None), method="arcs").arcs
        z.append((result.total_angle - course.total_angle) / result.total_angle_se)
    spread = np.sqrt(np.mean(np.square(z)))
    assert 0.6 < spread < 1.45  # 24 draws: four standard deviations of 0.144 about 1


def test_smooth_routes_stay_with_the_spline(sensed):
    for seed in range(4):
        result = measure(clean(sensed(colon(), 200, 3e-4, seed)[0]))
        assert result.arcs.method == "spline"


@pytest.mark.parametrize("course", [half_circle(), SIX, colon()])
@pytest.mark.parametrize("method", ["auto", "spline", "arcs"])
def test_pieces_profile_and_route_agree(sensed, course, method):
    result = measure(clean(sensed(course, 100, 3e-4)[0]), method=method)
    assert result.arcs.total_length == pytest.approx(result.profile.length, rel=1e-12)
    assert result.arcs.total_angle == pytest.approx(result.profile.total_angle, rel=1e-12)
    assert result.arcs.total_angle_se == pytest.approx(result.profile.total_angle_se, rel=1e-6)
    assert result.route.s[-1] == pytest.approx(result.profile.length, rel=1e-12)
    step = np.linalg.norm(np.diff(result.route.position, axis=0), axis=1)
    np.testing.assert_allclose(step, np.diff(result.route.s), rtol=2e-2, atol=1e-6)


def test_exact_points_give_the_chain_to_rounding(sensed):
    result = measure(clean(sensed(SIX, 200, 0.0)[0]), method="arcs")
    assert result.arcs.total_angle == pytest.approx(SIX.total_angle, rel=1e-6)
    for joint in np.cumsum(SIX.length)[:-1]:
        assert np.min(np.abs(result.arcs.s_start - joint)) < 1e-6


def test_the_error_of_the_length_holds_what_the_turned_end_adds(sensed):
    """Thirty points whose stations are unknown: where the end turns, its foot slides."""
    off = []
    for seed in range(40):
        arcs = measure(clean(sensed(SIX, 30, 5e-4, seed)[0]), 5e-4, "arcs").arcs
        k = len(arcs.length)
        off.append((arcs.total_length - SIX.total_length) / np.sqrt(arcs.covariance[:k, :k].sum()))
    assert 0.75 < np.sqrt(np.mean(np.square(off))) < 1.3  # chance of 40 draws: 0.78 to 1.22 in 95 of 100


def _chain(start, axes, joints, bend, stations):
    return unfitted(start, axes, joints, bend, stations)._replace(curved=CURVED)


def test_the_foot_of_the_last_point_slides_as_in_finite_differences(start):
    """A parameter that carries the end of the chain forwards leaves the foot behind."""
    end, step = 0.4, 1e-6
    point = along(np.array([end]), form_of(*start, JOINTS, BEND))[0][0]
    result = slide_of_end(_chain(*start, JOINTS, BEND, np.array([0.0, end])))

    def foot(values):
        moved, s = _moved(values, start, True), end
        for _ in range(5):
            position, tangent, _ = along(np.array([s]), form_of(*moved))
            s -= float((position[0] - point) @ tangent[0])
        return s

    for a in range(len(result)):
        way = np.zeros(len(result))
        way[a] = step
        # second differences of the foot are some units of the parameters
        assert result[a] == pytest.approx((foot(way) - foot(-way)) / (2 * step), rel=1e-5, abs=1e-7)


def test_a_chain_that_has_turned_far_keeps_its_axes_at_right_angles(start):
    position, axes = start
    s = np.linspace(0.0, 0.4, 60)
    points = along(s, form_of(position, axes, JOINTS, BEND))[0]
    astray = _chain(position, _turned(axes, 0.3 * axes[1]), JOINTS, BEND, s)
    data = Data(points, np.ones(60), False, 0.0, 0.4 / 60)
    result = fit_fixed_pieces(data, astray)
    assert result.cost < 1e-12  # exact points are met
    np.testing.assert_allclose(result.axes @ result.axes.T, np.eye(3), atol=1e-12)  # rounding


def test_a_covariance_is_propagated_to_what_follows_from_the_parameters():
    rng = np.random.default_rng(0)
    root, gradient = rng.standard_normal((12, 12)), rng.standard_normal((5, 12))
    matrix = root @ root.T + np.diag(10.0 ** rng.uniform(-3, 3, 12))
    expected = gradient @ np.linalg.solve(matrix, gradient.T)
    result = core.propagated(matrix, gradient, 0.0)
    # the condition of the scaled matrix is some hundreds
    np.testing.assert_allclose(result, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("seed", range(12))
def test_no_piece_is_left_whose_bend_the_points_do_not_determine(seed, first):
    """An arc of 14 points, cut in two between the last two points of either end."""
    turn, spacing, noise = np.linspace(0.0, 2.0, 14), 0.2 / 13, 1e-3
    points = 0.1 * np.column_stack([np.sin(turn), 1.0 - np.cos(turn), 0.0 * turn])
    points += noise * np.random.default_rng(seed).normal(size=points.shape)
    short = 0.4 * spacing
    length = np.array([short, 0.2 - short] if first else [0.2 - short, short])
    data, cut = chain_of(points, noise, length, np.full(2, 10.0))
    left, pieces = identifiable(data, cut)
    assert pieces.unidentifiable < 0
    assert left.joints[0] == 0.0
    assert len(left.bend) == (2 if chain_pieces(data, cut).unidentifiable < 0 else 1)
