"""Errors that neighbours share: Φ at a resolution, by what the source of the points is known to do."""

from pathlib import Path

import numpy as np
import pytest

from tests.known_routes import harmonic_course
from tssgeom import Frame, FrameResult, Rig, analyse, process
from tssgeom.errors import SettingsError
from tssgeom.io.formats.files import open_recording
from tssgeom.rig import ShapeSensor, Sheath, Source
from tssgeom.route import synthetic
from tssgeom.route.error_posterior import NO_POSTERIOR
from tssgeom.route.geometry import measure
from tssgeom.route.observations import clean
from tssgeom.route.resolution import angle_over_resolution, at_resolution
from tssgeom.route.route_fit import NO_ERRORS
from tssgeom.route.shared_errors import SOURCES, with_shared_errors
from tssgeom.route.synthetic import Course, chain, colon, positions

ARCS = chain(np.array([0.15, 0.2, 0.15]), np.array([6.0, 9.0, 4.0]), np.array([0.0, 0.7, 1.5]))
POINTS = 150


def sensed(course: Course, length: float, size: float, seed: int, white: float = 1e-4) -> np.ndarray:
    """Points whose errors of the relative `size` are alike over the relative `length`, beside white ones."""
    whole, rng = course.total_length, np.random.default_rng(seed)
    s = np.linspace(0.0, whole, POINTS)
    alike = np.exp(-0.5 * ((s[:, None] - s) / (length * whole)) ** 2) + 1e-8 * np.eye(POINTS)
    errors = size * np.linalg.cholesky(alike) @ rng.standard_normal((POINTS, 3))
    return positions(course, s) + whole * (errors + white * rng.standard_normal((POINTS, 3)))


def from_source(source: Source | None, **more: float) -> Rig:
    return Rig(shape=ShapeSensor(source=source, **more))


@pytest.mark.parametrize("planar", [True, False])
def test_an_arc_keeps_its_angle_at_any_resolution(planar):
    plane = 0.0 if planar else 1.1
    course = chain(np.array([0.25, 0.25]), np.array([8.0, 8.0]), np.array([plane, plane]))
    fit = measure(clean(positions(course, np.linspace(0.0, 0.5, 60))))
    assert angle_over_resolution(fit, np.array([0.005, 0.05, 0.5])) == pytest.approx(4.0, rel=1e-6)


def test_the_angle_never_grows_with_the_resolution():
    fit = measure(clean(sensed(ARCS, 0.02, 1e-3, 1)))
    angle = angle_over_resolution(fit, np.geomspace(0.001, 0.4, 30))
    assert np.all(np.diff(angle) <= 1e-9)
    assert angle[0] == pytest.approx(fit.arcs.total_angle, rel=0.05)
    assert angle[-1] < 0.9 * angle[0]


def test_a_wave_as_long_as_the_resolution_is_halved():
    s = np.linspace(0.0, 1.0, 800)
    points = np.column_stack([s, 1e-3 * np.cos(2.0 * np.pi * s / 0.1), 0.0 * s])
    fit = measure(clean(points), method="spline")
    halved = angle_over_resolution(fit, np.array([0.1]))[0]
    assert halved == pytest.approx(0.5 * fit.arcs.total_angle, rel=0.03)


def test_pieces_profile_and_covariance_are_those_of_the_resolution():
    fit = measure(clean(sensed(ARCS, 0.02, 1e-3, 2)))
    coarse, slope = at_resolution(fit, 0.05)
    assert coarse.resolution == 0.05
    assert slope > 0.0
    assert coarse.arcs.total_angle == pytest.approx(angle_over_resolution(fit, np.array([0.05]))[0])
    assert coarse.profile.total_angle == pytest.approx(coarse.arcs.total_angle)
    assert np.trapezoid(coarse.profile.kappa, coarse.profile.s) == pytest.approx(
        coarse.arcs.total_angle, rel=0.02
    )
    assert coarse.arcs.total_length == pytest.approx(fit.arcs.total_length)
    share = coarse.arcs.total_angle / fit.arcs.total_angle
    assert coarse.arcs.total_angle_se == pytest.approx(share * fit.arcs.total_angle_se)


@pytest.mark.parametrize(("length", "size"), [(0.02, 1e-3), (0.03, 1e-3), (0.04, 1e-3)])
def test_intervals_of_a_centre_line_hold_the_angle_that_markers_miss(length, size):
    held, missed, count = 0, 0, 0
    for seed in range(12):
        course = (ARCS, colon(), harmonic_course(np.random.default_rng(seed)))[seed % 3]
        points = sensed(course, length, size, seed)
        for source in ("centreline", "markers"):
            arcs = analyse(points, from_source(source)).arcs
            within = abs(arcs.total_angle - course.total_angle) < 1.96 * arcs.total_angle_se
            held += within and source == "centreline"
            missed += not within and source == "markers"
        count += 1
    assert held >= 0.8 * count
    assert missed >= 0.5 * count


@pytest.mark.parametrize("source", ["em", "fbg"])
def test_errors_of_a_source_join_those_of_angle_length_and_tension(source):
    points = sensed(ARCS, 0.02, 0.0, 3)
    alone, shared = analyse(points, from_source("markers")), analyse(points, from_source(source))
    # white noise gives no reason to move the angle by much of its error
    assert abs(shared.arcs.total_angle - alone.arcs.total_angle) < 0.3 * shared.arcs.total_angle_se
    least = {"em": 0.01, "fbg": 0.2}[source] * ARCS.total_angle
    assert shared.arcs.total_angle_se > 0.99 * least > 2.0 * alone.arcs.total_angle_se
    assert shared.profile.total_angle_se == pytest.approx(shared.arcs.total_angle_se, rel=1e-3)
    assert shared.transmission.tension_out_se == pytest.approx(
        0.145 * shared.arcs.total_angle_se * shared.transmission.tension_out, rel=0.02
    )
    k = len(shared.arcs.length)
    assert np.sqrt(shared.arcs.covariance[:k, :k].sum()) > 0.004 * ARCS.total_length


def test_errors_that_all_frames_share_do_not_hide_that_a_route_moves():
    quiet = [ARCS, ARCS, chain(ARCS.length, np.array([7.0, 10.0, 5.0]), np.array([0.0, 0.7, 1.5]))]
    frames = [Frame(sensed(course, 0.02, 0.0, i), float(i)) for i, course in enumerate(quiet)]
    results = list(process(frames, from_source("fbg"), tension_in=10.0))
    for course, one in zip(quiet, results, strict=True):
        assert isinstance(one, FrameResult)
        assert one.state.route is not None
        assert one.state.route.total_angle == pytest.approx(course.total_angle, rel=0.02)
        assert one.state.route.total_angle_se < 0.05 < one.arcs.total_angle_se


def test_points_without_any_noise_count_their_short_bends_as_errors_and_say_so():
    course = harmonic_course(np.random.default_rng(4))
    exact = positions(course, np.linspace(0.0, course.total_length, 200))
    result = analyse(exact)
    assert any("less noise" in text and "[shape] source" in text for text in result.warnings)
    hidden = result.arcs.total_angle - angle_over_resolution(result.tracked.fit, np.array([0.05]))[0]
    assert result.arcs.total_angle_se > 0.9 * hidden > 0.0
    stated = analyse(exact, from_source("markers"))
    assert not any("source" in text for text in stated.warnings)
    assert stated.arcs.total_angle_se < 0.5 * hidden


@pytest.mark.parametrize("count", [20, 150])
def test_points_that_a_program_smoothed_have_wide_intervals_and_a_warning(count):
    held, missed, warned = 0, 0, 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        course = (harmonic_course(rng), ARCS)[seed % 3 == 0]
        s = np.linspace(0.0, course.total_length, count)
        waves = np.cos(np.outer(s / course.total_length, np.pi * np.arange(1, 7)))
        points = positions(course, s) + 5e-4 * course.total_length * waves @ rng.standard_normal((6, 3))
        for source in (None, "markers"):
            result = analyse(points, from_source(source))
            within = abs(result.arcs.total_angle - course.total_angle) < 1.96 * result.arcs.total_angle_se
            held, missed = held + (within and not source), missed + (not within and bool(source))
            warned += any("less noise than sensors" in text for text in result.warnings)
    assert held >= 11
    assert missed >= 3
    assert warned >= 8


def test_arcs_through_points_up_to_rounding_were_computed_and_not_smoothed():
    for count in (12, 60):
        points = positions(ARCS, np.linspace(0.0, ARCS.total_length, count))
        result, alone = analyse(points), analyse(points, from_source("markers"))
        assert not result.warnings
        assert result.arcs.total_angle_se == alone.arcs.total_angle_se


def test_without_source_or_noise_a_length_holds_errors_that_neighbours_share():
    held, alone = 0, 0
    for seed in range(20):
        points = sensed(ARCS, 0.2, 6e-4, seed, white=6e-4)
        for rig, stated in ((Rig(), False), (from_source(None, noise_mm=0.3), True)):
            arcs = analyse(points, rig).arcs
            k = len(arcs.length)
            se = np.sqrt(arcs.covariance[:k, :k].sum())
            within = abs(arcs.total_length - ARCS.total_length) < 1.96 * se
            held, alone = held + (within and not stated), alone + (within and stated)
    assert held >= 18
    assert alone <= 16


def test_frames_of_unknown_points_do_not_average_what_neighbours_may_share():
    frames = [Frame(sensed(ARCS, 0.02, 0.0, seed), 0.03 * seed) for seed in range(40)]
    last = list(process(frames, Rig(), tension_in=5.0))[-1]
    assert isinstance(last, FrameResult)
    least = last.tracked.errors.least_angle
    assert last.tracked.fit.arcs.total_angle_se < least
    assert last.arcs.total_angle_se == pytest.approx(least, rel=1e-6)


def test_many_short_bends_of_unknown_points_may_be_errors():
    points = sensed(ARCS, 0.02, 1e-3, 5)
    result = analyse(points)
    assert any("many short bends" in text for text in result.warnings)
    assert abs(result.arcs.total_angle - ARCS.total_angle) < 1.96 * result.arcs.total_angle_se
    stream = list(process([Frame(points, float(i)) for i in range(3)], Rig(), tension_in=5.0))
    assert isinstance(stream[2], FrameResult)
    assert stream[2].arcs.total_angle_se == pytest.approx(result.arcs.total_angle_se, rel=0.1)


@pytest.mark.parametrize("course", [ARCS, colon()])
def test_white_noise_is_no_reason_to_count_bends_as_errors(course):
    for seed in range(6):
        points = sensed(course, 0.02, 0.0, seed, white=1e-3)
        assert not any("[shape] source" in text for text in analyse(points).warnings)


@pytest.mark.parametrize("torsion", [15.0, 30.0, 55.0])
def test_waves_and_helices_with_white_noise_have_no_bends_that_may_be_errors(torsion):
    s, square = np.linspace(0.0, 0.5, 200), 12.0**2 + torsion**2
    edges = np.linspace(0.0, 0.5, 1001)
    wave = chain(np.diff(edges), 12.0 * np.cos(torsion * 0.5 * (edges[1:] + edges[:-1])))
    turning = synthetic.helix(12.0 / square, 2.0 * np.pi * torsion / square, s)
    for exact, angle in ((turning, 6.0), (positions(wave, s), wave.total_angle)):
        for seed in range(3):
            noise = 1e-4 * np.random.default_rng(seed).standard_normal(exact.shape)
            result = analyse(exact + noise)
            assert not any("[shape] source" in text for text in result.warnings)
            assert abs(result.arcs.total_angle - angle) < 3.0 * result.arcs.total_angle_se < 0.3


def test_a_sheath_gives_the_resolution():
    assert Sheath().shortest_wave is None
    assert Sheath(diameter_mm=2.0).shortest_wave == pytest.approx(np.pi * 0.01)
    assert Sheath(diameter_mm=2.0, least_radius_mm=30.0).shortest_wave == pytest.approx(np.pi * 0.03)
    points = sensed(ARCS, 0.02, 1e-3, 6)
    result = analyse(points, Rig(sheath=Sheath(least_radius_mm=20.0)))
    assert result.fit.resolution == pytest.approx(np.pi * 0.02)
    stated = analyse(points, Rig(sheath=Sheath(diameter_mm=2.0), shape=ShapeSensor(resolution_mm=12.0)))
    assert stated.fit.resolution == pytest.approx(0.012)
    assert stated.arcs.total_angle > result.arcs.total_angle


def test_markers_are_taken_as_fitted():
    fit = measure(clean(sensed(ARCS, 0.02, 0.0, 7)))
    assert with_shared_errors(fit, "markers", None) == (fit, NO_ERRORS)


@pytest.mark.parametrize("wrong", [{"resolution_mm": 0.0}, {"resolution_mm": float("nan")}])
def test_a_resolution_that_cannot_be_is_refused(wrong):
    with pytest.raises(SettingsError, match=r"shape\.resolution_mm"):
        ShapeSensor(**wrong)
    with pytest.raises(SettingsError, match=r"sheath\.diameter_mm"):
        Sheath(diameter_mm=-1.0)


def test_raw_and_smoothed_lines_of_a_vessel_agree():
    folder = Path(__file__).parents[3] / "shared" / "data" / "vmtk_aorta"
    if not folder.is_dir():
        pytest.skip("the measured centre lines are absent")
    files = ("aorta-centerline.vtp", "test_vmtkcenterlinesmoothing_test_default_params.vtp")
    for number in (1, 2):
        raw, smooth = (
            analyse(open_recording(f"{folder / file}#{number}", "mm").frames[0]).arcs for file in files
        )
        both = np.hypot(raw.total_angle_se, smooth.total_angle_se)
        assert abs(raw.total_angle - smooth.total_angle) < 1.96 * both
        assert 1.0 < smooth.total_angle < 2.6


def test_intervals_hold_angle_and_length_where_errors_are_longer_than_the_resolution():
    held, white = [], []
    for seed in range(8):
        course = (ARCS, colon(), harmonic_course(np.random.default_rng(seed)))[seed % 3]
        points = sensed(course, (0.1, 0.2)[seed % 2], 7e-4 / course.total_length, seed, white=1e-5)
        alone = measure(clean(points), method="spline")
        for source in SOURCES:
            fit, shared = with_shared_errors(alone, source, None)
            arcs = shared.beside(fit).arcs
            angle = abs(arcs.total_angle - course.total_angle) < 1.96 * arcs.total_angle_se
            length = abs(arcs.total_length - course.total_length) < 1.96 * arcs.total_length_se
            (white if source == "markers" else held).extend((angle, length))
    assert np.mean(held) >= 0.9  # 95 % of 64, less two standard deviations
    assert np.mean(white) <= 0.5


def test_a_stated_scale_error_stands_for_that_of_a_source():
    fit = measure(clean(sensed(ARCS, 0.02, 0.0, 7)))
    known = NO_POSTERIOR._replace(angle=0.02)
    angle = fit.arcs.total_angle
    for source, share, own in (("fbg", 0.2, 0.1), ("em", 0.01, 0.0)):
        for gain, expected in ((0.0, share), (0.03, 0.03)):
            _, shared = with_shared_errors(fit, source, None, known, gain)
            assert shared.angle == pytest.approx((expected * angle) ** 2 + own**2 + 0.02**2)
    assert with_shared_errors(fit, "markers", None, gain=0.03) == (fit, NO_ERRORS)


def helix(turns: int, points: int) -> np.ndarray:
    turned = np.linspace(0.0, 2.0 * np.pi * turns, points)
    return np.column_stack([0.01 * np.cos(turned), 0.01 * np.sin(turned), 8e-4 * turned])


def walk(points: int) -> np.ndarray:
    return np.cumsum(2e-3 * np.random.default_rng(0).standard_normal((points, 3)), axis=0)


@pytest.mark.parametrize(("points", "angle"), [(helix(200, 1000), 400.0 * np.pi), (walk(500), None)])
def test_points_whose_residuals_are_no_noise_leave_open_how_far_the_route_turns(points, angle):
    result = analyse(points)
    assert any("as noise does not" in each for each in result.warnings)
    turned = np.sum(np.arccos(np.clip(cosines(points), -1.0, 1.0))) if angle is None else angle
    assert abs(result.arcs.total_angle - turned) < 2.0 * result.arcs.total_angle_se


def cosines(points: np.ndarray) -> np.ndarray:
    step = np.diff(points, axis=0)
    unit = step / np.linalg.norm(step, axis=1)[:, None]
    return np.sum(unit[1:] * unit[:-1], axis=1)


def test_white_noise_beyond_the_chords_stays_noise():
    turned, rng = np.linspace(0.0, np.pi, 200), np.random.default_rng(1)
    arc = 0.1 * np.column_stack([np.cos(turned), np.sin(turned), 0.0 * turned])
    for size in (1e-3, 3e-3, 1e-2):  # chords of 1.6 mm
        result = analyse(arc + size * rng.standard_normal((200, 3)))
        assert not any("as noise does not" in each for each in result.warnings)
