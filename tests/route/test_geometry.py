"""From points to angle: closed-form truths, invariances, error bars, and what noise may not do."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tssgeom.route.agreement import given_length
from tssgeom.route.geometry import measure
from tssgeom.route.observations import clean
from tssgeom.route.pieces import curvature_profile
from tssgeom.route.spline.fit import fit
from tssgeom.route.synthetic import chain, colon, half_circle, helix, positions, setup_a, setup_b

LINE = chain(np.array([0.5]), np.array([0.0]))
S_BEND = chain(np.array([0.2, 0.2]), np.array([10.0, 15.0]), np.array([0.0, 2.0]))


def _phi(points, stations=None, noise=None):
    profile = curvature_profile(fit(clean(points, stations), noise))
    return profile.total_angle, profile.total_angle_se


def test_an_exact_line_has_no_angle(sensed):
    phi, _ = _phi(sensed(LINE, 60, 0.0)[0])
    assert phi < 1e-9  # rounding of coordinates of 0.5 m, twice differentiated


@pytest.mark.parametrize("n", [5, 8, 30, 200, 1000])
def test_an_exact_half_circle_has_angle_pi(sensed, n):
    phi, _ = _phi(sensed(half_circle(), n, 0.0)[0])
    assert phi == pytest.approx(np.pi, rel=4e-3 if n == 5 else 1e-4)  # five points leave 45 degrees between


@pytest.mark.parametrize("kappa", [0.5, 10.0, 60.0])
def test_curvature_of_an_exact_arc_is_one_over_its_radius(geometry, sensed, kappa):
    _, profile, _ = geometry(sensed(chain(np.array([0.3]), np.array([kappa])), 200, 0.0)[0])
    np.testing.assert_allclose(profile.kappa, kappa, rtol=1e-3)


def test_helix_curvature_is_r_over_r2_plus_c2(geometry):
    s = np.linspace(0, 0.4, 200)
    _, profile, _ = geometry(helix(0.03, 0.04, s))
    c = 0.04 / (2 * np.pi)
    inner = slice(10, -10)  # the third derivative is unknown at the ends
    np.testing.assert_allclose(profile.kappa[inner], 0.03 / (0.03**2 + c**2), rtol=1e-3)
    assert profile.length == pytest.approx(0.4, rel=1e-5)


def test_clothoid_curvature_grows_linearly(geometry):
    n = 2000
    s = (np.arange(n) + 0.5) * 0.5 / n
    course = chain(np.full(n, 0.5 / n), 40.0 * s)
    _, profile, _ = geometry(positions(course, np.linspace(0, 0.5, 200)))
    inner = slice(5, -5)
    np.testing.assert_allclose(profile.kappa[inner], 40.0 * profile.s[inner], atol=0.02)
    assert profile.total_angle == pytest.approx(5.0, rel=1e-4)


@pytest.mark.parametrize("course", [setup_a(), setup_b(), S_BEND, colon()])
def test_exact_points_of_curved_routes_give_their_angle(sensed, course):
    phi, _ = _phi(sensed(course, 300, 0.0)[0])
    assert phi == pytest.approx(course.total_angle, rel=2e-3)  # jumps of curvature lie between points


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize(
    ("course", "bound"),
    [(half_circle(), 0.004), (setup_a(), 0.006), (S_BEND, 0.03), (colon(), 0.03)],
)
def test_noise_of_half_a_millimetre_moves_the_angle_by_less_than_a_few_per_cent(sensed, course, bound, known):
    """The sum of turning angles would be off by 600 % here; the bounds are 2.5 times the rms of trials."""
    errors = []
    for seed in range(6):
        points, s = sensed(course, 200, 5e-4, seed)
        errors.append(_phi(points, s if known else None)[0] / course.total_angle - 1)
    assert np.sqrt(np.mean(np.square(errors))) < bound


@pytest.mark.parametrize("course", [half_circle(), setup_a(), S_BEND, colon()])
@pytest.mark.parametrize(("n", "noise"), [(200, 5e-4), (200, 1e-4), (40, 3e-4)])
def test_the_standard_error_covers_the_truth(sensed, course, n, noise):
    z = []
    for seed in range(12):
        phi, se = _phi(sensed(course, n, noise, seed)[0])
        z.append((phi - course.total_angle) / se)
    # 12 draws: two or more beyond 3 standard errors has a chance of 5e-4 where the error bar is right
    assert np.sum(np.abs(z) > 3) < 2
    # a spline rounds off a sudden change of bending plane, which costs about two standard errors
    assert 0.1 < np.sqrt(np.mean(np.square(z))) < 2.3


def test_noise_is_estimated_and_used_when_known(geometry, sensed):
    points, _ = sensed(setup_a(), 200, 3e-4)
    result, _, _ = geometry(points)
    assert result.route.noise == pytest.approx(3e-4, rel=0.15)  # 2 x 200 normal components: sd 3.5 %
    known, _, _ = geometry(points, noise=3e-4)
    assert known.route.noise == pytest.approx(3e-4, rel=1e-9)


def test_uneven_and_random_spacing_does_no_harm():
    rng = np.random.default_rng(5)
    course = setup_a()
    for _ in range(4):
        s = np.sort(rng.uniform(0, course.total_length, 200))
        s[0], s[-1] = 0.0, course.total_length
        phi, se = _phi(positions(course, s) + 2e-4 * rng.standard_normal((200, 3)))
        assert phi == pytest.approx(course.total_angle, rel=0.02)
        assert abs(phi - course.total_angle) < 4 * se


def test_missing_points_are_bridged_with_a_larger_error(sensed):
    points, s = sensed(half_circle(), 100, 2e-4)
    whole, whole_se = _phi(points, s)
    gap = points.copy()
    gap[40:60] = np.nan
    phi, se = _phi(gap, s)
    assert phi == pytest.approx(np.pi, rel=0.02)
    assert se > whole_se
    unknown, _ = _phi(gap)
    assert unknown == pytest.approx(np.pi, rel=0.02)
    assert whole == pytest.approx(np.pi, rel=0.01)


@pytest.mark.parametrize("size", [5e-3, 0.05, 1.0])
@pytest.mark.parametrize("where", [0, 57, 199])
def test_one_outlier_is_ignored_with_a_warning(sensed, size, where):
    points, _ = sensed(setup_a(), 200, 2e-4)
    clear, _ = _phi(points)
    points[where] += size * np.array([0.6, 0.0, 0.8])
    shape = clean(points)
    spline = fit(shape)
    warnings = " ".join(shape.warnings + spline.warnings)
    assert "1 outlying point " in warnings
    assert f"(count from 0: {where})" in warnings
    assert curvature_profile(spline).total_angle == pytest.approx(clear, rel=0.01)


@pytest.mark.parametrize("seed", range(8))
def test_five_per_cent_of_outliers_do_little_harm(sensed, seed):
    """Ten of 200 points are off by 20 standard deviations, along the route as well as across."""
    points, _ = sensed(setup_a(), 200, 5e-4, seed)
    rng = np.random.default_rng(seed + 50)
    outlier = rng.choice(np.arange(1, 199, 2), 10, replace=False)  # no two side by side
    points[outlier] += 0.01 * rng.normal(size=(10, 3))
    phi, _ = _phi(points)
    assert phi == pytest.approx(3 * np.pi, rel=0.02)


def test_clear_points_are_not_taken_for_outliers(sensed):
    lost = sum(
        int((fit(clean(sensed(course, 200, noise, seed)[0])).route.weight == 0).sum())
        for course in (half_circle(), setup_a(), colon())
        for noise in (0.0, 1e-4, 1e-3)
        for seed in range(4)
    )
    assert lost <= 2  # of 7200


@settings(max_examples=15, deadline=None)
@given(
    st.integers(0, 1000),
    st.floats(0.2, 50.0),
    st.tuples(*[st.floats(-1, 1)] * 3),
)
def test_angle_does_not_depend_on_position_attitude_or_scale(seed, scale, shift):
    rng = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    points = positions(S_BEND, np.linspace(0, 0.4, 80)) + 2e-4 * rng.standard_normal((80, 3))
    phi, se = _phi(points)
    moved, moved_se = _phi(scale * (points @ turn.T + np.array(shift)))
    # the filter starts at one end in each of three coordinates: rounding passes through the search for λ
    assert moved == pytest.approx(phi, rel=1e-4)
    assert moved_se == pytest.approx(se, rel=1e-2)


def test_angle_does_not_depend_on_the_direction_of_travel(sensed):
    points, _ = sensed(S_BEND, 120, 2e-4)
    forward, se = _phi(points)
    backward, _ = _phi(points[::-1])
    assert abs(forward - backward) < 0.2 * se


def test_more_points_give_a_smaller_error(sensed):
    course = S_BEND
    se = [np.median([_phi(sensed(course, n, 5e-4, seed)[0])[1] for seed in range(5)]) for n in (30, 120, 480)]
    assert se[0] > se[1] > se[2]


def test_phi_grows_along_the_route_and_its_error_starts_at_zero(geometry, sensed):
    _, profile, _ = geometry(sensed(colon(), 100, 3e-4)[0])
    assert (np.diff(profile.phi) >= 0).all()
    assert profile.phi[0] == profile.phi_se[0] == 0.0
    assert np.isfinite(profile.kappa_se).all()


@pytest.mark.parametrize("n", [4, 5, 6])
def test_the_fewest_points_still_give_an_honest_answer(sensed, n):
    phi, se = _phi(sensed(half_circle(), n, 1e-4)[0])
    assert np.isfinite([phi, se]).all()
    assert abs(phi - np.pi) < 4 * se + 0.15


def test_length_is_that_of_the_route_not_of_the_zigzag(geometry, sensed):
    points, _ = sensed(half_circle(), 400, 1e-3)
    zigzag = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    assert zigzag > 0.6
    assert geometry(points)[1].length == pytest.approx(0.5, abs=4e-3)  # 2 to 3 sd of both ends


def test_every_array_is_finite_and_read_only(geometry, sensed):
    spline, profile, pieces = geometry(sensed(colon(), 60, 3e-4)[0])
    arrays = [
        value
        for part in (spline, spline.route, profile, pieces)
        for name in part.__slots__
        if isinstance(value := getattr(part, name), np.ndarray)
    ]
    assert len(arrays) == 18
    assert all(np.isfinite(a).all() and not a.flags.writeable for a in arrays)


@pytest.mark.parametrize("method", ["spline", "arcs"])
def test_the_curve_angle_along_a_route_of_known_length_grows_to_its_whole(method):
    course = chain(np.array([0.15, 0.2, 0.15]), np.array([2.0, 9.0, 3.0]))
    points = positions(course, np.linspace(0.0, course.total_length, 60))
    free = measure(
        clean(points + 1e-3 * np.random.default_rng(0).standard_normal(points.shape)), 1e-3, method
    )
    known = given_length(free, course.total_length, 1e-4)
    assert known.arcs.total_length != free.arcs.total_length
    assert known.profile.phi[-1] == known.arcs.total_angle
    assert np.all(np.diff(known.profile.phi) >= 0.0)
