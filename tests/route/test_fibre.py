"""Curvatures of a fibre: integrated exactly, estimated in curvature space, with errors that cover."""

import json
from pathlib import Path

import numpy as np
import pytest

from tssgeom.arrays import rows_at
from tssgeom.errors import ShapeError
from tssgeom.route.fibre.models import Partition, Sensed, piece_curvature
from tssgeom.route.fibre.route import integrated
from tssgeom.route.fibre.sensed import clean_fibre, fit_fibre
from tssgeom.route.route_fit import RouteFit
from tssgeom.route.synthetic import helix

NEEDLE = Path(__file__).resolve().parents[3] / "shared" / "data" / "fbg_needle" / "shape_stuff.json"
LENGTH = 0.5


def stations(n: int) -> np.ndarray:
    """Gratings evenly along the fibre, half a spacing from its ends."""
    return (np.arange(n) + 0.5) * LENGTH / n


def read(bend: np.ndarray, s: np.ndarray):
    """A fibre from 0 to LENGTH with gratings at `s`."""
    marked = np.vstack((np.full(2, np.nan), bend, np.full(2, np.nan)))
    return clean_fibre(marked, np.concatenate(([0.0], s, [LENGTH])))


def measured(*fibre) -> RouteFit:
    return fit_fibre(*fibre).fit


def line(rng):
    return lambda s: np.zeros((len(s), 2))


def half(rng):
    plane = rng.uniform(0, 2 * np.pi)
    return lambda s: np.tile(np.pi / LENGTH * np.array([np.cos(plane), np.sin(plane)]), (len(s), 1))


def six_pieces(rng):
    """Straight to 40/m, lengths and planes by chance, so that joints fall anywhere between gratings."""
    length = rng.uniform(0.6, 1.4, 6)
    ends = np.cumsum(length / length.sum() * LENGTH)[:-1]
    kappa, plane = rng.permutation([0.0, 8.0, 40.0, 0.0, 20.0, 12.0]), rng.uniform(0, 2 * np.pi, 6)
    bend = kappa[:, None] * np.column_stack((np.cos(plane), np.sin(plane)))
    return lambda s: bend[np.searchsorted(ends, s)]


def harmonics(rng):
    size = 8.0 * rng.standard_normal((2, 2, 4)) / np.arange(1, 5)
    order = np.pi / LENGTH * np.arange(1, 5)[:, None]
    return lambda s: np.einsum("cpm,pmi->ic", size, np.stack((np.sin(order * s), np.cos(order * s))))


def angle(bend) -> float:
    s = np.linspace(0.0, LENGTH, 20001)
    return float(np.trapezoid(np.linalg.norm(bend(s), axis=1), s))


def errors(route, n: int, noise: float, known: bool, trials: int) -> np.ndarray:
    """Error of Φ and its standard error, [trials, 2]."""
    rng = np.random.default_rng(n)
    out = []
    for _ in range(trials):
        bend, s = route(rng), stations(n)
        sensed = bend(s) + noise * rng.standard_normal((n, 2))
        arcs = measured(read(sensed, s), noise if known else None).arcs
        out.append((arcs.total_angle - angle(bend), arcs.total_angle_se))
    return np.array(out)


@pytest.mark.parametrize("noise", [0.1, 1.0])
@pytest.mark.parametrize(
    ("route", "n", "trials"),
    [
        *((line, 8, 60), (line, 18, 60), (half, 8, 60), (half, 18, 60), (half, 100, 20)),
        *((six_pieces, 18, 60), (six_pieces, 100, 20), (harmonics, 8, 30), (harmonics, 18, 30)),
    ],
)
def test_the_interval_covers_the_angle(route, n, trials, noise):
    result = errors(route, n, noise, known=True, trials=trials)
    outside = np.sum(np.abs(result[:, 0]) > 1.96 * result[:, 1] + 1e-12)
    # 5 % are outside by right; 0.1 % of samples have more than this many
    assert outside <= {20: 5, 30: 6, 60: 10}[trials]
    # and the interval means something: eight gratings on harmonics are the widest, four times the error
    assert np.sqrt(np.mean(result[:, 1] ** 2)) < 6 * np.sqrt(np.mean(result[:, 0] ** 2)) + 0.05


def bumps(rng):
    """Two to four smooth bends of 2 to 12/m, with almost straight stretches between them and beside them."""
    k = rng.integers(2, 5)
    at, width = LENGTH * rng.uniform(0.1, 0.9, k), LENGTH * rng.uniform(0.05, 0.13, k)
    plane, size = rng.uniform(0, 2 * np.pi, k), rng.uniform(2.0, 12.0, k)
    bend = size[:, None] * np.column_stack((np.cos(plane), np.sin(plane)))
    return lambda s: np.exp(-(((s[:, None] - at) / width) ** 2)) @ bend


@pytest.mark.parametrize("known", [True, False])
def test_smooth_bends_between_straight_stretches_have_no_bias_and_intervals_that_cover(known):
    result = errors(bumps, 40, 0.15, known=known, trials=60)
    off = result[:, 0] / result[:, 1]
    assert abs(np.mean(off)) < 0.55  # 0.15 measured, and three standard errors of 60 trials
    assert np.sum(np.abs(off) > 1.96) <= 9  # 5 % are outside by right; 0.2 % of samples have more
    assert np.sqrt(np.mean(off**2)) > 0.7  # and they are not wider than needed


def test_an_unknown_noise_is_within_its_standard_error():
    rng, off = np.random.default_rng(12), []
    for _ in range(40):
        s = stations(40)
        result = fit_fibre(read(bumps(rng)(s) + 0.15 * rng.standard_normal((40, 2)), s))
        off.append((result.curvature_noise - 0.15) / result.curvature_noise_se)
    assert abs(np.mean(off)) < 0.9  # -0.4 measured, and three standard errors of 40 trials
    assert np.sqrt(np.mean(np.square(off))) < 1.5  # 1.1 measured


def test_a_known_noise_has_no_error():
    s = stations(18)
    assert fit_fibre(read(half(np.random.default_rng(0))(s), s), 0.1).curvature_noise_se == 0.0


def test_noise_alone_adds_no_angle_to_a_straight_fibre():
    result = errors(line, 100, 1.0, known=True, trials=10)
    rectified = 1.0 * np.sqrt(np.pi / 2) * LENGTH  # mean magnitude of two components of noise 1/m
    assert np.mean(result[:, 0]) < 0.05 * rectified


def test_unknown_noise_is_estimated():
    bend = half(np.random.default_rng(0))(stations(100))
    rng = np.random.default_rng(1)
    result = fit_fibre(read(bend + 0.5 * rng.standard_normal(bend.shape), stations(100)))
    assert result.curvature_noise == pytest.approx(
        0.5, rel=0.25
    )  # 200 values determine it to 5 %; grid steps of 10 %


def test_pieces_are_distinguished_from_smooth_curvature():
    rng = np.random.default_rng(2)
    for route, method in ((six_pieces, "arcs"), (harmonics, "spline")):
        bend = route(rng)(stations(60))
        result = fit_fibre(read(bend + 0.3 * rng.standard_normal(bend.shape), stations(60)), 0.3)
        assert result.fit.arcs.method == method
        assert result.probability[method] > 0.8  # a piece of a few gratings may be smooth as well


def test_straight_pieces_have_exactly_no_angle():
    s = stations(40)
    bend = np.where(s[:, None] < 0.25, 0.0, [12.0, 5.0])
    arcs = measured(read(bend + 0.2 * np.random.default_rng(3).standard_normal(bend.shape), s), 0.2).arcs
    assert arcs.angle[0] == 0.0
    assert len(arcs.length) == 2
    assert arcs.angle[1] == pytest.approx(13 * 0.25, abs=3 * arcs.total_angle_se)


def test_noise_across_a_bend_makes_no_piece_more_curved():
    four = Sensed(np.linspace(0.0, LENGTH, 4), np.tile([3.0, 4.0], (4, 1)), np.ones(4), 2.0)
    whole = Partition(0.0, np.array([0, 4]), np.array([True]))
    kappa, variance = piece_curvature(four, whole, 2.0)
    assert (kappa.item(), variance.item()) == pytest.approx((np.sqrt(24.0), 1.0))  # docs/model.md, (241)
    assert piece_curvature(four, whole, 12.0)[0] == 0.0  # no more than noise


def test_curvatures_of_zero_leave_the_angle_that_the_known_noise_could_hide():
    arcs = measured(read(np.zeros((18, 2)), stations(18)), 0.5).arcs
    assert arcs.total_angle == 0.0
    hidden = 0.5 / np.sqrt(18) * LENGTH  # of one component of the mean
    assert 0.1 * hidden < arcs.total_angle_se < 3 * hidden


def test_a_joint_is_uncertain_by_the_spacing_of_gratings():
    s = stations(10)  # 50 mm apart
    bend = np.where(s[:, None] < 0.25, [4.0, 0.0], [20.0, 0.0])
    arcs = measured(read(bend + 0.05 * np.random.default_rng(4).standard_normal(bend.shape), s), 0.05).arcs
    gap = 0.05 / np.sqrt(12)  # standard deviation of a position uniform over 50 mm
    assert np.sqrt(arcs.covariance[0, 0]) == pytest.approx(gap, rel=0.02)
    assert arcs.total_angle_se == pytest.approx(16.0 * gap, rel=0.15)  # noise, ends and slopes add
    assert arcs.covariance[:2, :2].sum() == pytest.approx(0.0, abs=1e-15)  # the whole length is known


@pytest.mark.parametrize("route", [line, half, six_pieces, harmonics])
def test_pieces_keep_length_and_angle(route):
    rng = np.random.default_rng(5)
    bend = route(rng)(stations(18))
    geometry = measured(read(bend + 0.3 * rng.standard_normal(bend.shape), stations(18)), 0.3)
    assert geometry.arcs.total_length == pytest.approx(LENGTH, abs=1e-12)
    assert geometry.arcs.total_angle == pytest.approx(geometry.profile.total_angle, abs=1e-12)
    assert geometry.arcs.total_angle_se == pytest.approx(geometry.profile.total_angle_se, rel=1e-9)
    assert np.linalg.eigvalsh(geometry.arcs.covariance).min() > -1e-12
    assert all(np.isfinite(array).all() for array in (geometry.route.position, geometry.profile.phi_se))


def test_rolling_the_fibre_about_itself_changes_no_angle():
    rng = np.random.default_rng(10)
    s = stations(18)
    bend = harmonics(rng)(s) + 0.3 * rng.standard_normal((18, 2))
    cos, sin = np.cos(1.1), np.sin(1.1)
    here, rolled = (measured(read(b, s), 0.3).arcs for b in (bend, bend @ [[cos, sin], [-sin, cos]]))
    assert rolled.total_angle == pytest.approx(here.total_angle, rel=1e-9)
    assert rolled.total_angle_se == pytest.approx(here.total_angle_se, rel=1e-9)


def test_angle_and_error_do_not_depend_on_the_unit():
    rng = np.random.default_rng(11)
    s = stations(18)
    bend = six_pieces(rng)(s) + 0.3 * rng.standard_normal((18, 2))
    small = measured(clean_fibre(bend, s), 0.3).arcs
    large = measured(clean_fibre(bend / 10, 10 * s), 0.03).arcs
    assert large.total_angle == pytest.approx(small.total_angle, rel=1e-9)
    assert large.total_angle_se == pytest.approx(small.total_angle_se, rel=1e-9)


def test_pieces_that_stand_for_a_smooth_route_do_not_depend_on_the_unit():
    s = stations(60)
    bend = harmonics(np.random.default_rng(11))(s)
    small = measured(clean_fibre(bend, s), 1e-3).arcs
    large = measured(clean_fibre(bend / 100, 100 * s), 1e-5).arcs
    assert small.method == "spline"
    assert large.length == pytest.approx(100 * small.length, rel=1e-9)


def test_a_half_circle_ends_two_radii_aside():
    everywhere = np.linspace(0.0, LENGTH, 18)  # gratings at both ends: nothing is left unsensed
    geometry = measured(clean_fibre(np.tile([np.pi / LENGTH, 0.0], (18, 1)), everywhere))
    end = geometry.route.position[-1]
    np.testing.assert_allclose(end, [2 * LENGTH / np.pi, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(geometry.route.tangent[-1], [0.0, 0.0, -1.0], atol=1e-5)


def test_linear_curvature_is_carried_to_fourth_order():
    def end(n):
        s = np.linspace(0.0, LENGTH, n + 1)
        bend = np.column_stack((8 * np.cos(20 * s), 8 * np.sin(20 * s)))  # a helix, smooth but not linear
        at = np.linspace(0.0, LENGTH, 1281)
        linear = rows_at(at, s, bend)
        return integrated(s, bend)[0][-1] - integrated(at, linear)[0][-1]

    rough, fine = (np.linalg.norm(end(n)) for n in (10, 20))
    assert rough / fine > 12  # 16 in the limit


def test_a_helix_of_curvatures_gives_the_positions_of_the_helix():
    radius, pitch = 0.03, 0.04
    rise = pitch / (2 * np.pi)
    per = radius**2 + rise**2
    s = np.linspace(0.0, LENGTH, 2001)
    turned = rise / per * s  # the frame without twist turns against the Frenet frame by the torsion
    location, axes = integrated(s, radius / per * np.column_stack((np.cos(turned), np.sin(turned))))
    true = helix(radius, pitch, s)
    near, far = location[0] - location[1000], true[0] - true[1000]
    assert np.linalg.norm(near) == pytest.approx(np.linalg.norm(far), rel=1e-5)  # second order in s steps
    assert np.linalg.norm(location[-1] - location[0]) == pytest.approx(
        np.linalg.norm(true[-1] - true[0]), rel=1e-5
    )
    np.testing.assert_allclose(
        np.einsum("iac,ibc->iab", axes, axes), np.tile(np.eye(3), (2001, 1, 1)), atol=1e-12
    )


def test_the_distal_end_scatters_as_its_standard_deviation_says():
    rng = np.random.default_rng(6)
    bend, ends, stated = half(rng)(stations(18)), [], []
    for _ in range(60):
        route = measured(read(bend + 0.5 * rng.standard_normal(bend.shape), stations(18)), 0.5).route
        ends.append(route.position[-1])
        stated.append(route.noise)
    scatter = np.sqrt(np.mean(np.var(ends, axis=0)))
    # 60 trials with about two values each give a standard deviation to 7 %, and the choice of method adds
    assert np.sqrt(np.mean(np.square(stated))) == pytest.approx(scatter, rel=0.3)


def test_thousands_of_gratings_are_averaged():
    s = stations(3000)
    bend = half(np.random.default_rng(0))(s) + np.random.default_rng(8).standard_normal((3000, 2))
    arcs = measured(read(bend, s), 1.0).arcs
    assert arcs.total_angle == pytest.approx(np.pi, abs=3 * arcs.total_angle_se)
    assert arcs.total_angle_se < 2 * LENGTH / np.sqrt(
        3000
    )  # 1/m over the root of the number, and an allowance


def test_the_noise_of_thousands_of_gratings_is_estimated_though_their_means_have_less():
    s = stations(2000)
    fit = fit_fibre(read(0.1 * np.random.default_rng(1).standard_normal((2000, 2)), s))
    assert fit.curvature_noise == pytest.approx(0.1, abs=5 * fit.curvature_noise_se)
    assert fit.fit.arcs.total_angle < 2 * fit.fit.arcs.total_angle_se


def test_gratings_that_were_not_read_are_bridged_with_a_larger_error():
    s = stations(18)
    bend = harmonics(np.random.default_rng(9))(s)
    holed = bend.copy()
    holed[7:11] = np.nan
    whole, gappy = (fit_fibre(read(b, s), 0.2) for b in (bend, holed))
    assert read(holed, s).warnings == ("4 gratings not read, bridged",)
    assert gappy.fit.arcs.total_angle_se > whole.fit.arcs.total_angle_se


@pytest.mark.parametrize(
    ("bend", "s", "reason"),
    [
        (np.zeros((4, 3)), np.arange(4.0), "one row of κ_x, κ_y"),
        (np.zeros((4, 2)), None, "without stations"),
        (np.zeros((4, 2)), np.arange(3.0), "3 stations for 4 gratings"),
        (np.zeros((4, 2)), np.array([0.0, 0.1, 0.1, 0.2]), "do not increase: 0.1 m follows 0.1 m"),
        (np.zeros((4, 2)), np.array([0.0, np.nan, 0.1, 0.2]), "station of grating 1 is missing"),
        (np.array([[0.0, np.nan], [1, 1], [1, 1]]), np.arange(3.0), "2 gratings read"),
        (np.array([[0.0, np.inf], [1, 1], [1, 1]]), np.arange(3.0), "curvature 0 is infinite"),
        (np.full((4, 2), 5000.0), 0.01 * np.arange(4.0), "check the units"),
        (
            np.diag([1e160, 1.0, 1.0, 1.0])[:, :2],
            0.01 * np.arange(4.0),
            "grating 0 has a curvature of 1e\\+160",
        ),
    ],
)
def test_what_cannot_be_used_is_refused_with_the_hint(bend, s, reason):
    with pytest.raises(ShapeError, match=reason):
        clean_fibre(bend, s)


@pytest.mark.skipif(not NEEDLE.is_file(), reason="needs the FBG needle shape")
def test_needle_shape_follows_from_its_own_curvatures():
    shape = json.loads(NEEDLE.read_text())["shape"]
    location, spin = 1e-3 * np.array(shape["pos"]).T, 1e3 * np.array(shape["wv"])
    s = np.linspace(0.0, 0.12, len(location))
    # its frame twists with the needle; ours does not, and the tangent moves by spin × tangent
    twist = np.concatenate(([0.0], np.cumsum(0.5 * (spin[2, 1:] + spin[2, :-1]) * np.diff(s))))
    cos, sin = np.cos(twist), np.sin(twist)
    bend = np.column_stack((cos * spin[1] + sin * spin[0], sin * spin[1] - cos * spin[0]))
    geometry = measured(clean_fibre(bend, s))
    result = rows_at(s, geometry.route.s, geometry.route.position)
    # the reference steps by half a millimetre with one rotation each: that is 0.23 µm off at its end
    assert np.max(np.linalg.norm(result - location, axis=1)) < 0.5e-6
    truth = np.trapezoid(np.hypot(*spin[:2]), s)
    assert geometry.arcs.total_angle == pytest.approx(truth, rel=1e-5)  # its curvature wanders by less a step
