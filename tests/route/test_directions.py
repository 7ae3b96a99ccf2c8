"""Directions beside the points, and a known length: what they add, and that they do no harm."""

import numpy as np
import pytest

from tssgeom import Frame, Rig, analyse, core, process
from tssgeom.errors import ShapeError
from tssgeom.rig import ShapeSensor
from tssgeom.route.arcs.chain import along, form_of
from tssgeom.route.geometry import measure
from tssgeom.route.observations import clean
from tssgeom.route.spline.problem import FilterModel
from tssgeom.route.synthetic import Course, chain, half_circle, helix
from tssgeom.route.tracking import follow

NOISE, TURN = 5e-4, np.radians(0.5)
SEVEN = chain(
    np.array([0.06, 0.08, 0.05, 0.09, 0.07, 0.08, 0.07]),
    np.array([0.0, 20.0, 8.0, 30.0, 0.0, 25.0, 12.0]),
    np.array([0.0, 0.0, 1.0, 2.0, 0.0, 3.0, 0.5]),
)


def _coils(course: Course, seed: int, n: int = 20):
    """Points, stations and tangents of sensors with six degrees of freedom."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0.0, course.total_length, n)
    joints = np.concatenate(([0.0], np.cumsum(course.length)[:-1]))
    position, tangent, _ = along(s, form_of(np.zeros(3), np.eye(3), joints, course.bend))
    sensed = tangent + TURN * rng.standard_normal((n, 3))
    points = position + NOISE * rng.standard_normal((n, 3))
    return points, s, sensed / np.linalg.norm(sensed, axis=1)[:, None]


def test_a_direction_conditions_the_tangent_as_any_gaussian_value_does():
    n, variance = 12, 0.0025
    u = np.arange(float(n))
    y = np.column_stack((u, 0.05 * u**2, 0.0 * u)) + 0.1 * np.random.default_rng(1).normal(size=(n, 3))
    unit, variances = np.full((n, 3), np.nan), np.zeros(n)
    unit[5], variances[5] = (0.85, 0.6, 0.1), variance
    start = np.zeros((3, 4))
    start[0, 1] = 1.0
    step, ends, zeros = (
        core.transitions(u, np.zeros((n, 3))),
        np.array([1e6, 1e6, 1.0, 1.0]),
        np.zeros((n, 3)),
    )
    model = FilterModel(u, y, np.ones(n), step, start, ends, zeros, across_only=False)
    before, wide, _ = core.smooth(*model, None, None, 1.0, 0.0)
    after, narrow, _ = core.smooth(*model, unit, variances, 1.0, 1.0)
    whole = wide[5, 4] + variance
    gain = wide[5, [1, 4, 5, 6]] / whole
    expected = before[5] + (unit[5] - before[5, :, 1])[:, None] * gain
    # the filter's vague start, 1e6 times the noise, costs digits
    np.testing.assert_allclose(after[5], expected, rtol=1e-7, atol=1e-8)
    assert narrow[5, 4] == pytest.approx(wide[5, 4] * variance / whole, rel=1e-7)


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("method", ["spline", "arcs"])
def test_directions_without_precision_change_nothing(known, method):
    points, s, tangents = _coils(half_circle(), 0, 60)
    stations = s if known else None
    alone = measure(clean(points, stations), NOISE, method)
    beside = measure(clean(points, stations, tangents, 1e4), NOISE, method)
    # passes end where the noise changes by less than 1 %: one more of them is all that differs
    assert beside.arcs.total_angle == pytest.approx(alone.arcs.total_angle, rel=1e-3)
    assert beside.arcs.total_angle_se == pytest.approx(alone.arcs.total_angle_se, rel=0.1)


def test_directions_without_precision_leave_the_average_over_few_points():
    """Which fit stands for all may change with a little of the weight of each."""
    for seed in range(8):
        points, _, tangents = _coils(half_circle(), seed, 20)
        alone = measure(clean(points), NOISE, "spline").arcs
        beside = measure(clean(points, None, tangents, 1e4), NOISE, "spline").arcs
        assert abs(beside.total_angle - alone.total_angle) < alone.total_angle_se
        assert 0.5 < beside.total_angle_se / alone.total_angle_se < 2.0


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize(("course", "share"), [(half_circle(), 0.97), (SEVEN, 0.4)])
def test_angles_with_directions_are_better_and_their_errors_right(course, share, known):
    errors = {True: [], False: []}
    z = []
    for seed in range(60):
        points, s, tangents = _coils(course, seed)
        for with_directions, out in errors.items():
            shape = clean(points, s if known else None, tangents if with_directions else None, TURN)
            result = measure(shape, NOISE).arcs
            out.append(result.total_angle - course.total_angle)
            if with_directions:
                z.append(out[-1] / result.total_angle_se)
    rms = {with_directions: np.sqrt(np.mean(np.square(out))) for with_directions, out in errors.items()}
    assert rms[True] < share * rms[False]  # 0.80 and 0.2 in 200 trials, the same noise in both
    assert np.sqrt(np.mean(np.square(z))) < 1.5  # 1.0 and 1.2 in 200 trials of each


def test_the_noise_of_the_points_is_estimated_beside_directions():
    result = [
        measure(clean(points, s, tangents, TURN), method="spline").route.noise
        for points, s, tangents in (_coils(SEVEN, seed) for seed in range(6))
    ]
    assert np.mean(result) == pytest.approx(NOISE, rel=0.2)  # 6 times 20 points, a third of them used up


@pytest.mark.parametrize("known", [False, True])
def test_warm_fits_with_directions_agree_with_cold_ones(known):
    last = None
    for seed in range(4):
        points, s, tangents = _coils(half_circle(), seed, 40)
        shape = clean(points, s if known else None, tangents, TURN)
        last = follow(shape, NOISE, last)
        cold = measure(shape, NOISE).arcs
        assert abs(last.fit.arcs.total_angle - cold.total_angle) < 0.2 * cold.total_angle_se


@pytest.mark.parametrize("method", ["spline", "arcs"])
def test_a_direction_that_stands_off_is_left_out_and_named(method):
    points, s, tangents = _coils(half_circle(), 2)
    bad = tangents.copy()
    bad[7] = np.cross(bad[7], [0.0, 0.0, 1.0]) * 0.6 + bad[7] * 0.8
    bad[7] /= np.linalg.norm(bad[7])
    missing = tangents.copy()
    missing[7] = np.nan
    result = measure(clean(points, s, bad, TURN), NOISE, method)
    expected = measure(clean(points, s, missing, TURN), NOISE, method)
    assert "1 directions stand off the route, ignored (count from 0: 7)" in result.warnings
    assert result.arcs.total_angle == pytest.approx(expected.arcs.total_angle, rel=2e-3)  # one more pass


def test_directions_that_cannot_be_are_refused_with_the_hint():
    points, s, tangents = _coils(half_circle(), 3)
    with pytest.raises(ShapeError, match="direction 0 has length 2: give unit vectors"):
        clean(points, s, 2 * tangents, TURN)
    with pytest.raises(ShapeError, match="from the distal to the proximal end: turn them round"):
        clean(points, s, -tangents, TURN)
    with pytest.raises(ShapeError, match="give one row for each"):
        clean(points, s, tangents[:-1], TURN)


def test_one_flipped_sensor_is_left_out_with_a_warning():
    points, s, tangents = _coils(half_circle(), 4)
    tangents[3] *= -1.0
    shape = clean(points, s, tangents, TURN)
    assert np.isnan(shape.directions[3]).all()
    assert "1 directions run against the route, left out (count from 0: 3)" in shape.warnings


def test_directions_of_unknown_noise_are_not_used():
    points, s, tangents = _coils(half_circle(), 5)
    shape = clean(points, s, tangents)
    assert shape.directions is None
    assert "direction_noise_deg" in shape.warnings[0]


@pytest.mark.parametrize("method", ["spline", "arcs"])
def test_a_known_length_shrinks_the_variance_of_the_length_as_the_formula_says(method):
    points, s, _ = _coils(half_circle(), 6, 60)
    sd = 2e-4
    alone = measure(clean(points), NOISE, method)
    given = measure(clean(points, length=float(s[-1]), length_noise=sd), NOISE, method)
    k = len(alone.arcs.length)
    own, left = (result.arcs.covariance[:k, :k].sum() for result in (alone, given))
    assert left == pytest.approx(own * sd**2 / (own + sd**2), rel=1e-9)
    share = own / (own + sd**2)
    expected = alone.arcs.total_length + share * (s[-1] - alone.arcs.total_length)
    assert given.arcs.total_length == pytest.approx(expected, rel=1e-12)
    assert given.route.s[-1] == pytest.approx(expected, rel=1e-12)
    assert given.profile.length == pytest.approx(expected, rel=1e-12)
    assert given.profile.total_angle == pytest.approx(given.arcs.total_angle, rel=1e-12)
    assert given.profile.total_angle_se == pytest.approx(given.arcs.total_angle_se, rel=1e-6)
    step = np.linalg.norm(np.diff(given.route.position, axis=0), axis=1)
    np.testing.assert_allclose(step, np.diff(given.route.s), rtol=2e-2)


def test_a_length_that_cannot_be_right_is_named_and_not_used():
    points, s, _ = _coils(half_circle(), 7, 60)
    alone = measure(clean(points), NOISE)
    given = measure(clean(points, length=float(s[-1]) - 0.012, length_noise=1e-3), NOISE)
    assert given.arcs.total_length == alone.arcs.total_length
    (warning,) = given.warnings
    assert warning.startswith("the route is 1")
    assert "longer than the stated length of 488 mm" in warning
    with pytest.raises(ShapeError, match="the length is -1 m"):
        clean(points, length=-1.0)


def test_a_length_does_not_count_where_an_end_is_missing():
    points, s, _ = _coils(half_circle(), 8, 60)
    points[0] = np.nan
    shape = clean(points, length=float(s[-1]))
    assert shape.length is None
    assert "the stated length is not used: an end of the route is missing" in shape.warnings


@pytest.mark.parametrize("noise_deg", [0.3, 1.0, 3.0])
def test_an_unknown_noise_of_directions_is_estimated(noise_deg):
    off, known, alone, estimates = [], [], [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        s = np.linspace(0.0, 0.42, 12)
        points = helix(0.03, 0.04, s) + 5e-4 * rng.standard_normal((12, 3))
        tangent = helix(0.03, 0.04, s + 1e-6) - helix(0.03, 0.04, s - 1e-6)
        tangent /= np.linalg.norm(tangent, axis=1)[:, None]
        sensed = tangent + np.radians(noise_deg) * rng.standard_normal((12, 3))
        frame = Frame(points, directions=sensed / np.linalg.norm(sensed, axis=1)[:, None])
        for values, noise in ((off, "estimate"), (known, noise_deg), (alone, None)):
            result = analyse(frame, Rig(shape=ShapeSensor(direction_noise_deg=noise)))
            values.append(result.arcs.total_angle - 0.42 * 0.03 / (0.03**2 + (0.02 / np.pi) ** 2))
            if values is off:
                estimates.append(np.degrees(result.tracked.direction_noise))
    least = 0.65 * noise_deg
    assert least < np.median(estimates) < max(1.35 * noise_deg, 1.1)  # of few sensors the prior of 1.1° shows
    assert np.std(off) < np.std(alone)
    assert noise_deg < 1.0 or np.std(off) < 1.3 * np.std(known)


def test_a_stream_keeps_the_noise_of_directions_that_it_estimated():
    s = np.linspace(0.0, 0.42, 12)
    tangent = helix(0.03, 0.04, s + 1e-6) - helix(0.03, 0.04, s - 1e-6)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    rng, frames = np.random.default_rng(0), []
    for k in range(4):
        points = helix(0.03, 0.04, s) + 2e-4 * rng.standard_normal((12, 3))
        frames.append(Frame(points, 0.02 * k, directions=tangent))
    rig = Rig(shape=ShapeSensor(direction_noise_deg="estimate"))
    noises = [one.tracked.direction_noise for one in process(frames, rig, tension_in=5.0)]
    assert 0.0 < noises[0] < 0.02
    assert noises[1:] == [noises[0]] * 3
