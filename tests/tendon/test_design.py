"""The added curve: Theorem 3 where it holds, and where it does not."""

import math

import numpy as np
import pytest

from tssgeom.errors import SettingsError
from tssgeom.rig import Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.design import (
    Curve,
    Cycle,
    Perturbation,
    advise,
    bent,
    disturbed,
    perturbed_routes,
    price,
    same_output,
    sweep,
)
from tssgeom.tendon.design_table import cases
from tssgeom.tendon.history import driven

MU, PI = 0.145, math.pi
HALF = Arcs.exact(np.array([0.2, 0.3]), np.array([0.4 * PI, 0.6 * PI]))
LOOP = Curve(2 * PI, 40.0)
CYCLE = Cycle(15.0, 5.0)
S = math.exp(-MU * 2 * PI)
ROUTES = perturbed_routes(HALF, Perturbation(2, math.radians(20), 0.02), 60, seed=3)
# Percentiles of differences of closed forms: 1e-16 of 10 N over changes of 0.01 N, some hundred roundings.
RELATIVE = 1e-9


@pytest.fixture(scope="module")
def table():
    return {case.name: case.numbers() for case in cases(HALF, ROUTES, Rig(), LOOP, CYCLE, 95.0)}


def test_price_of_the_paper_s_curve_is_0_489_mm_and_three_fifths_of_the_tension():
    cost = price(HALF, Rig(), LOOP, CYCLE)
    assert cost.own_elongation == pytest.approx(0.489e-3, abs=0.5e-6)  # three digits are given
    assert cost.tension_out == pytest.approx(15.0 * math.exp(-MU * 3 * PI), rel=1e-12)
    assert cost.release_reaches_below == pytest.approx(15.0 * math.exp(-2 * MU * 3 * PI), rel=1e-12)


def test_on_pulling_the_curve_scales_every_percentile_by_s(table):
    for name in ("pull_tension_out_change_N", "pull_elongation_change_m"):
        assert table["same_tension_in"][name] == pytest.approx(S * table["without"][name], rel=RELATIVE)


def test_when_all_releases_the_curve_amplifies_every_percentile_by_1_over_s(table):
    for name in ("full_release_tension_out_change_N", "full_release_elongation_change_m"):
        assert table["same_tension_in"][name] == pytest.approx(table["without"][name] / S, rel=RELATIVE)


def test_at_the_same_distal_tension_the_curve_gains_nothing(table):
    for name in ("tension_out_N", "pull_tension_out_change_N", "pull_elongation_change_m"):
        assert table["same_tension_out"][name] == pytest.approx(table["without"][name], rel=RELATIVE)
    assert same_output(CYCLE, Rig(), LOOP).tension_in == pytest.approx(15.0 / S)


def test_pretension_beyond_the_front_hides_perturbations_from_the_pull():
    rig = Rig(tendon=Tendon(pretension_N=6.0))
    cost = price(HALF, rig, LOOP, CYCLE)
    assert cost.pull_reaches_from == pytest.approx(
        6.0 * math.exp(MU * 3 * PI), rel=1e-12
    )  # 23.5 N: not reached
    assert cost.tension_out == pytest.approx(6.0, rel=1e-12)
    observed = disturbed(HALF, ROUTES, rig, LOOP, np.array([15.0]), 95.0)
    assert observed.tension[0] == pytest.approx(0.0, abs=1e-12)  # roundings of 6 N


def test_bends_add_their_angle_where_they_lie_and_keep_the_length():
    route = bent(HALF, np.array([0.25, 0.499]), np.array([0.3, 0.2]), 0.02)
    assert route.total_length == pytest.approx(0.5, rel=1e-12)
    assert route.total_angle == pytest.approx(PI + 0.5, rel=1e-12)
    before = route.angle[route.s_start + route.length <= 0.24 + 1e-9].sum()
    assert before == pytest.approx(0.24 / 0.5 * PI, rel=1e-9)
    before = route.angle[route.s_start + route.length <= 0.26 + 1e-9].sum()
    assert before == pytest.approx(0.26 / 0.5 * PI + 0.3, rel=1e-9)


def test_draws_are_the_same_for_the_same_seed_and_half_normal_in_angle():
    again = perturbed_routes(HALF, Perturbation(2, math.radians(20), 0.02), 60, seed=3)
    assert [r.total_angle for r in again] == [r.total_angle for r in ROUTES]
    many = perturbed_routes(HALF, Perturbation(1, 0.4, 0.02), 2000, seed=1)
    added = np.array([route.total_angle for route in many]) - PI
    # E|N(0, σ)| = σ√(2/π); four standard errors of a mean of 2000
    assert added.mean() == pytest.approx(0.4 * math.sqrt(2 / PI), abs=4 * 0.4 * 0.61 / math.sqrt(2000))


def test_advice_is_the_smallest_curve_that_reaches_the_tolerance_or_none():
    tried = sweep(HALF, ROUTES, Rig(), 40.0, CYCLE, 95.0, most=4 * PI)
    unhelped = tried[0].disturbed.worst
    assert advise(tried, 1.01 * unhelped).verdict == "none needed"
    result = advise(tried, 0.5 * unhelped)
    assert result.verdict == "curve"
    assert result.tried is not None
    assert result.tried.disturbed.worst <= 0.5 * unhelped
    smaller = [each for each in tried if each.curve.angle < result.tried.curve.angle]
    assert all(each.disturbed.worst > 0.5 * unhelped for each in smaller)
    assert advise(tried, 0.05 * unhelped).verdict == "out of reach"


def test_a_perturbation_of_no_angle_is_refused():
    with pytest.raises(SettingsError, match="angle of the bends is 0 rad"):
        perturbed_routes(HALF, Perturbation(2, 0.0, 0.02), 10, seed=1)


def test_the_curve_of_no_angle_changes_nothing():
    assert Curve(0.0, 40.0).before(HALF) is HALF
    assert (
        price(HALF, Rig(), Curve(0.0, 40.0), CYCLE).elongation == driven([15.0], HALF, Rig()).elongation[-1]
    )
