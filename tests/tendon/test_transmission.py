"""Tension and elongation on a route: what must hold on any route, after any history."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tests.core.twins.tendon_profile import mean_decay, mean_decay_moment
from tssgeom.rig import Friction, Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.capstan import elongation_slopes, pretensioned, step, transmit

MU, RHO, PI = 0.145, 3.16e-4, math.pi  # the paper's tendon and sheath, section III-B
HALF_CIRCLE = Arcs.exact([0.5], [PI])
WITH_STRAIGHTS = Arcs.exact([0.1, 0.3, 0.1], [0.0, PI, 0.0])

# Closed forms that differ only in how they add up: a few hundred roundings of 1e-16, and 1e-12 in ln T for a
# corner that a front passes closely, over at most 12 steps.
RELATIVE = 1e-10

tensions = st.one_of(st.just(0.0), st.floats(0.01, 30.0))
histories = st.lists(tensions, min_size=1, max_size=12)
frictions = st.one_of(st.just(0.0), st.floats(0.001, 0.5))
pieces = st.lists(
    st.tuples(st.floats(0.01, 0.3), st.one_of(st.just(0.0), st.floats(1e-6, 4.0))), min_size=1, max_size=6
)
untimed = settings(deadline=None)  # the first example compiles the kernel


def rig(pretension=0.0, friction=MU):
    return Rig(tendon=Tendon(pretension_N=pretension), friction=Friction(coefficient=friction))


def driven(history, pretension=0.0, friction=MU):
    state = pretensioned(rig(pretension))
    for tension_in in history:
        state = step(state, tension_in, friction)
    return state


def after(history, arcs, pretension=0.0, friction=MU):
    return transmit(driven(history, pretension, friction), arcs, rig(pretension, friction))


def chain(*routes):
    return Arcs.exact(np.concatenate([r.length for r in routes]), np.concatenate([r.angle for r in routes]))


def arcs_of(parts):
    length, angle = np.array(parts).T
    return Arcs.exact(length, angle)


# --- what must hold on any route and after any history -----------------------------------------------------


def on_a_fine_grid(history, arcs, pretension, friction):
    """The slow twin: clip at 20 001 positions along each piece, then add up by the trapezium rule."""
    ends = np.concatenate(([0.0], np.cumsum(arcs.angle)))
    elongation, local = 0.0, np.empty(0)
    for length, start, stop in zip(arcs.length, ends[:-1], ends[1:], strict=True):
        phi = np.linspace(start, stop, 20_001)
        u = np.full_like(phi, math.log(pretension))
        for tension_in in history:
            u = np.clip(u, math.log(tension_in) - friction * phi, math.log(tension_in) + friction * phi)
        local = np.exp(u)
        elongation += RHO * length * np.trapezoid(local - pretension, dx=1 / 20_000)
    return local[-1], elongation


@given(st.lists(st.floats(0.1, 30.0), max_size=12), pieces, st.floats(0.1, 10.0), frictions)
@untimed
def test_closed_form_equals_a_fine_sum(history, parts, pretension, friction):
    """docs/model.md (5) and (9), against a sum that knows nothing of corners."""
    arcs = arcs_of(parts)
    result = after(history, arcs, pretension, friction)
    tension_out, elongation = on_a_fine_grid(history, arcs, pretension, friction)
    assert result.tension_out == pytest.approx(tension_out, rel=RELATIVE)
    # In a cell of h = 1/20 000 of a piece the rule errs by (μθh)²/12, and by μθh/4 where it holds a corner:
    # 12 corners at 30 N on 2 m of tendon stay below 30·ρ·12·0.3·0.5·4·h/4 = 1e-6 m.
    assert result.elongation == pytest.approx(elongation, rel=1e-8, abs=1e-6)


@given(histories, pieces, st.data(), st.floats(0.0, 1.0), tensions)
@untimed
def test_splitting_a_piece_changes_nothing(history, parts, data, share, pretension):
    arcs = arcs_of(parts)
    cut = data.draw(st.integers(0, len(parts) - 1))
    length, angle = parts[cut]
    halves = [(share * length, share * angle), ((1 - share) * length, (1 - share) * angle)]
    whole = after(history, arcs, pretension)
    split = after(history, arcs_of([*parts[:cut], *halves, *parts[cut + 1 :]]), pretension)
    assert split.tension_out == pytest.approx(whole.tension_out, rel=RELATIVE)
    # Elongation is a difference to the pretensioned length: it rounds on the scale of ρ·30 N·2 m = 0.02 m.
    assert split.elongation == pytest.approx(whole.elongation, rel=RELATIVE, abs=1e-12)


@given(histories, pieces, pieces, tensions)
@untimed
def test_a_route_in_two_parts_is_the_second_driven_by_the_first(history, first, second, pretension):
    front, back = arcs_of(first), arcs_of(second)
    arriving = [after(history[: n + 1], front, pretension).tension_out for n in range(len(history))]
    whole = after(history, chain(front, back), pretension)
    assert after(arriving, back, pretension).tension_out == pytest.approx(whole.tension_out, rel=RELATIVE)
    summed = after(history, front, pretension).elongation + after(arriving, back, pretension).elongation
    assert summed == pytest.approx(whole.elongation, rel=RELATIVE, abs=1e-12)  # as above


@given(histories, pieces, st.floats(0.1, 10.0), st.floats(0.1, 10.0))
@untimed
def test_scaling_every_tension_scales_the_elongation(history, parts, pretension, factor):
    arcs = arcs_of(parts)
    base = after(history, arcs, pretension)
    scaled = after([factor * value for value in history], arcs, factor * pretension)
    assert scaled.tension_out == pytest.approx(factor * base.tension_out, rel=RELATIVE)
    assert scaled.elongation == pytest.approx(factor * base.elongation, rel=RELATIVE, abs=1e-11)  # ten times


@given(histories, pieces, frictions)
@untimed
def test_dead_zone_ends_after_its_own_width(history, parts, friction):
    """docs/model.md (6): just before that tension the distal end still holds, just after it answers."""
    arcs, state = arcs_of(parts), driven(history, 5.0, friction)
    result = transmit(state, arcs, rig(5.0, friction))
    assert result.dead_zone == (result.dead_zone_width > 0)
    edge = result.tension_in + result.direction_index * result.dead_zone_width
    beyond = transmit(
        step(state, edge * (1 + 1e-6 * result.direction_index), friction), arcs, rig(5.0, friction)
    )
    assert not beyond.dead_zone
    if result.dead_zone_width > 1e-3:
        within = transmit(
            step(state, edge - result.direction_index * 1e-4, friction), arcs, rig(5.0, friction)
        )
        assert within.dead_zone
        assert within.tension_out == pytest.approx(result.tension_out, rel=RELATIVE)


def test_straight_route_has_no_dead_zone_and_stretches_by_hooke():
    result = after([15.0, 8.0], Arcs.exact([0.2, 0.3], [0.0, 0.0]), pretension=5.0)
    assert not result.dead_zone
    assert result.tension_out == pytest.approx(8.0, rel=RELATIVE)
    assert result.elongation == pytest.approx(RHO * (8.0 - 5.0) * 0.5, rel=RELATIVE)


def test_slack_tendon_is_shorter_by_its_pretension():
    result = after([15.0, 0.0], HALF_CIRCLE, pretension=5.0)
    assert result.tension_out == 0.0
    assert result.elongation == pytest.approx(-RHO * 5.0 * 0.5, rel=RELATIVE)
    assert not result.dead_zone


def test_before_the_first_pull_nothing_is_stretched():
    result = after([], WITH_STRAIGHTS, pretension=5.0)
    assert result.elongation == pytest.approx(0.0, abs=1e-15)  # one rounding of ρ·5 N·0.5 m
    assert result.direction_index == 1
    assert result.dead_zone_width == pytest.approx(5.0 * math.expm1(MU * PI), rel=RELATIVE)


# --- derivatives and standard errors -----------------------------------------------------------------------


@given(st.one_of(st.just(0.0), st.floats(-20.0, 20.0)))
@untimed
def test_means_of_the_decay_of_the_twin_equal_their_integrals(x):
    node, weight = np.polynomial.legendre.leggauss(60)
    tau, weight = (node + 1) / 2, weight / 2
    # Sixty Gauss nodes are exact to rounding for exp(20τ); the closed forms lose two digits near the series.
    mean, moment = mean_decay(x), mean_decay_moment(x)
    assert mean == pytest.approx(weight @ np.exp(-x * tau), rel=1e-12)
    assert moment == pytest.approx(weight @ (tau * np.exp(-x * tau)), rel=1e-12)


def elongation_of(state, parameters):
    length, angle = np.split(parameters, 2)
    return transmit(state, Arcs.exact(length, angle), rig(5.0)).elongation


def forward_difference(state, parameters, index, width=1e-6):
    """Second order, and to one side, because a straight piece cannot have less angle."""
    here, near, far = (
        elongation_of(state, parameters + k * width * (np.arange(parameters.size) == index))
        for k in (0, 1, 2)
    )
    return (-3 * here + 4 * near - far) / (2 * width)


tenths = st.integers(1, 300).map(lambda n: n / 10)
bends = st.tuples(st.floats(0.01, 0.3), st.one_of(st.just(0.0), st.floats(0.1, 4.0)))


@given(st.lists(tenths, max_size=12), st.lists(bends, min_size=1, max_size=6))
@untimed
def test_elongation_derivatives_equal_differences(history, parts):
    """docs/model.md (10) and (11); a longer angle moves all later pieces on in φ."""
    arcs, state = arcs_of(parts), driven(history, 5.0)
    joints = np.concatenate(([0.0], np.cumsum(arcs.angle)))
    apart = np.abs(np.subtract.outer(state.angle[1:], joints))
    assume(np.all(apart > 1e-5))  # at a joint with a corner the derivative of a straight piece is one-sided
    estimated, _ = elongation_slopes(state, arcs, rig(5.0))
    parameters = np.concatenate((arcs.length, arcs.angle))
    differences = [forward_difference(state, parameters, i) for i in range(parameters.size)]
    # The elongation rounds at 1e-17 m to 1e-16 m: over the width of 1e-6 that is 1e-10. Truncation is below.
    np.testing.assert_allclose(estimated, differences, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("history", [[15.0], [15.0, 10.0], [15.0, 3.0], [15.0, 3.0, 20.0], [6.0], [3.0]])
def test_tension_out_derivative_equals_differences(history):
    arcs, state = Arcs.exact([0.1, 0.3, 0.1], [0.4, PI, 0.0]), driven(history, 5.0)
    _, by_angle = elongation_slopes(state, arcs, rig(5.0))
    for piece in range(2):
        low, high = (
            transmit(state, Arcs.exact(arcs.length, arcs.angle + d * (np.arange(3) == piece)), rig(5.0))
            for d in (-1e-4, 1e-4)
        )
        difference = math.log(high.tension_out / low.tension_out) / 2e-4
        assert by_angle == pytest.approx(difference, abs=1e-9)  # linear: rounding 1e-15 over 2e-4


def test_standard_errors_equal_the_spread_over_sampled_pieces():
    """docs/model.md (13) and (14), with correlated errors of lengths and angles."""
    rng = np.random.default_rng(3)
    root = 1e-3 * rng.normal(size=(6, 6)) * np.array([0.1, 0.3, 0.1, 1.0, 1.0, 1.0])[:, None]
    mean = np.array([0.1, 0.3, 0.1, 0.5, 2.0, 1.0])
    arcs = Arcs(mean[:3], mean[3:], root @ root.T, "exact")
    state = driven([15.0, 10.0, 12.0], 5.0)
    sampled = mean + rng.normal(size=(4000, 6)) @ root.T
    results = [transmit(state, Arcs.exact(*np.split(row, 2)), rig(5.0)) for row in sampled]
    result = transmit(state, arcs, rig(5.0))
    # A spread from 4000 draws has a relative error of 1/sqrt(8000) = 1.1 %; 4 % is above three of those.
    assert result.elongation_se == pytest.approx(np.std([r.elongation for r in results]), rel=0.04)
    assert result.tension_out_se == pytest.approx(np.std([r.tension_out for r in results]), rel=0.04)


def test_pieces_without_error_give_results_without_error():
    result = after([15.0], HALF_CIRCLE)
    assert (result.elongation_se, result.tension_out_se) == (0.0, 0.0)
