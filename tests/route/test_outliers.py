"""One limit for outliers: what it lets through by chance, and that every estimator uses it."""

import math

import numpy as np
import pytest

from tests.core.twins.arcs_fit import residual_variance
from tssgeom import analyse, clean, read
from tssgeom.core.constants_route import PRIOR
from tssgeom.route.arcs.chain import Data, unfitted
from tssgeom.route.arcs.outliers import outlier_weights
from tssgeom.route.outliers import leaves_out_a_stretch, outlier_limit, outlying_tangent

NOISE = 5e-4


@pytest.mark.parametrize("count", [4, 30, 1000])
def test_pure_noise_of_two_components_has_an_outlier_with_one_chance_whatever_the_count(count):
    # the sum of two squared standard normal numbers is beyond x with a chance of exp(-x/2)
    assert count * math.exp(-0.5 * outlier_limit(count, 1.0)) == pytest.approx(math.exp(-8.0), rel=1e-12)


def test_the_limit_scales_with_the_variance():
    assert outlier_limit(50, 4e-6) == pytest.approx(4e-6 * outlier_limit(50, 1.0), rel=1e-15)


def test_the_greatest_variance_counts_and_exact_points_keep_a_floor():
    assert residual_variance(4.0, 9.0, 1.0) == 9.0
    assert residual_variance(9.0, 4.0, 1.0) == 9.0
    assert residual_variance(0.0, 0.0, 0.01) == pytest.approx((PRIOR.rounding * 0.01) ** 2, rel=1e-15)


def _straight(off):
    """Points at distances [n] from a straight chain of half a metre, and that chain."""
    n = len(off)
    s = np.linspace(0.0, 0.5, n)
    points = np.column_stack((s, off, np.zeros(n)))
    data = Data(points, np.ones(n), True, NOISE**2, 0.5 / n)
    chain = unfitted(np.zeros(3), np.eye(3), np.zeros(1), np.zeros((1, 2)), s)
    return data, chain._replace(square=off**2)


@pytest.mark.parametrize("known", [True, False])
def test_a_point_beyond_the_limit_loses_its_weight_in_a_chain_and_one_within_keeps_it(known):
    off = NOISE * np.random.default_rng(0).standard_normal(60)
    for share, weight in ((0.99, 1.0), (1.01, 0.0)):
        limit = outlier_limit(60, NOISE**2)
        off[7] = math.sqrt(share * limit)
        data, chain = _straight(off)
        if not known:
            # the robust scale of the other points: 2 ln 2 of a variance is the median of their squares
            data = data._replace(variance=0.0)
            robust = float(np.median(off**2)) / 1.386
            off[7] = math.sqrt(share * outlier_limit(60, robust))
            chain = chain._replace(square=off**2)
        weights = outlier_weights(data, chain)
        assert (1.0 if weights is None else weights[7]) == weight
        assert weights is None or weights.sum() == 59.0 + weight


def test_a_chain_with_more_outliers_than_a_tenth_keeps_all_its_points():
    off = np.full(60, 0.1 * NOISE)
    off[:7] = 30 * NOISE
    data, chain = _straight(off)
    assert outlier_weights(data, chain) is None


def test_the_direction_farthest_off_a_straight_curve_is_an_outlier_only_beyond_the_limit():
    n, variance = 20, np.full(20, 1e-4)
    u = np.arange(float(n))
    mean = np.zeros((n, 3, 4))
    mean[:, 0, 0], mean[:, 0, 1] = u, 1.0
    off = np.zeros(n)
    for share, which in ((0.99, -1), (1.01, 11)):
        off[11] = math.asin(math.sqrt(share * outlier_limit(n, 1e-4)))
        tangents = np.column_stack((np.cos(off), np.sin(off), np.zeros(n)))
        assert outlying_tangent(tangents, variance, u, mean, np.zeros(n)) == which


def test_points_side_by_side_without_weight_are_a_part_of_the_route():
    weight = np.ones(60)
    weight[20:28] = 0.0
    assert not leaves_out_a_stretch(weight)
    weight[28] = 0.0
    assert leaves_out_a_stretch(weight)
    weight = np.ones(60)
    weight[:4] = 0.0
    assert not leaves_out_a_stretch(weight)
    weight[4] = 0.0
    assert leaves_out_a_stretch(weight)


TWELVE = """x_mm,y_mm,z_mm
0.1,1.1,0.2
-3.9,-25.6,64.3
-11.6,-82.9,105.1
-19.2,-146.0,135.7
-18.1,-201.6,178.7
-7.5,-236.8,238.4
12.6,-250.5,304.9
41.2,-248.8,369.2
73.1,-240.4,433.1
97.1,-220.1,495.6
{}
{}
"""


def test_a_good_last_marker_behind_a_lost_one_stays(tmp_path):
    file = tmp_path / "twelve.csv"
    file.write_text(TWELVE.format("98.7,-177.7,551.6", "67.3,-118.6,570.4"))
    whole = analyse(file).profile
    file.write_text(TWELVE.format(",,", "67.3,-118.6,570.4"))
    bridged = analyse(file)
    assert bridged.shape.warnings == ("1 point missing, bridged",)
    # without the last marker Φ was 1.5 rad too small
    assert abs(bridged.profile.total_angle - whole.total_angle) < 3 * bridged.profile.total_angle_se
    assert bridged.profile.total_angle_se > whole.total_angle_se


def test_a_last_marker_farther_than_the_lost_way_is_an_outlier(tmp_path):
    file = tmp_path / "twelve.csv"
    file.write_text(TWELVE.format(",,", "67.3,381.4,570.4"))
    (frame,) = read(file)
    assert "1 outlying point left out (count from 0: 11)" in clean(frame.points).warnings
