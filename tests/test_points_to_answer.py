"""From points to tension and elongation: error bars hold, no frame is preferred, extremes are finite."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tssgeom.engine import process
from tssgeom.rig import Friction, Rig
from tssgeom.route.pieces import Arcs
from tssgeom.route.synthetic import chain, half_circle, positions
from tssgeom.stream import Frame, FrameResult, Rejected
from tssgeom.tendon.state import pretensioned, step, transmit

PULL = 15.0


def answer(points: np.ndarray, rig: Rig | None = None, **measured: float) -> FrameResult:
    (result,) = process([Frame(points, **measured)], rig or Rig(), tension_in=PULL)
    assert isinstance(result, FrameResult), result
    return result


def numbers(result: FrameResult) -> np.ndarray:
    """Length, angle, its error, T_out and elongation with its error."""
    sent, arcs = result.transmission, result.arcs
    results = (arcs.total_length, arcs.total_angle, arcs.total_angle_se)
    return np.array((*results, sent.tension_out, sent.elongation, sent.elongation_se))


def plotted(rng: np.random.Generator):
    """A route of two to five pieces in any planes, a quarter of them straight."""
    k = int(rng.integers(2, 6))
    kappa = np.where(rng.random(k) < 0.25, 0.0, rng.uniform(3.0, 25.0, k))
    return chain(rng.uniform(0.05, 0.2, k), kappa, rng.uniform(0.0, 2 * np.pi, k))


def sensed(course, n: int, noise: float, rng: np.random.Generator) -> np.ndarray:
    s = np.linspace(0.0, course.total_length, n)
    s[1:-1] += 0.2 * s[1] * rng.uniform(-1.0, 1.0, n - 2)
    return positions(course, s) + noise * rng.standard_normal((n, 3))


def test_the_error_bar_of_the_elongation_holds_the_truth_as_often_as_it_says():
    """Of 120 routes 95 % are meant to be within 1.96; fewer than 106 is a chance of 1 in 200.

    All of them may be: these arcs meet sharply, which no point shows; docs/model.md (267).
    """
    rng, inside = np.random.default_rng(424_242), 0
    for _ in range(120):
        course = plotted(rng)
        observed = answer(sensed(course, 100, 2e-4, rng)).transmission
        route = Arcs.exact(course.length, course.length * np.linalg.norm(course.bend, axis=1))
        truth = transmit(step(pretensioned(Rig()), route, Rig(), tension_in=PULL), Rig())
        inside += abs(observed.elongation - truth.elongation) < 1.96 * observed.elongation_se
    assert inside >= 106


@settings(max_examples=15, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), shift=st.floats(-1e3, 1e3), mirrored=st.booleans())
def test_tension_and_elongation_do_not_depend_on_position_attitude_or_handedness(seed, shift, mirrored):
    rng = np.random.default_rng(seed)
    points = sensed(plotted(rng), 60, 1e-4, rng)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    if (np.linalg.det(turn) < 0.0) != mirrored:
        turn[:, 0] *= -1.0
    before, after = numbers(answer(points)), numbers(answer(points @ turn.T + shift))
    # the search for joints ends within its own tolerance, whatever rounding at 1 km from the origin does
    values, errors = [0, 1, 3, 4], [2, 5]
    np.testing.assert_allclose(after[values], before[values], rtol=1e-4, atol=1e-9)
    # errors hold the odds of spline and chain, which follow the costs that the search ends at: 8e-4 measured
    np.testing.assert_allclose(after[errors], before[errors], rtol=3e-3, atol=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_from_the_other_end_the_route_is_the_same_within_its_error(seed):
    rng = np.random.default_rng(seed)
    points = sensed(plotted(rng), 80, 1e-4, rng)
    there, back = answer(points), answer(points[::-1])
    assert abs(there.arcs.total_angle - back.arcs.total_angle) < there.arcs.total_angle_se
    assert there.arcs.total_length == pytest.approx(back.arcs.total_length, rel=1e-3)


@pytest.mark.parametrize("n", [4, 5])
def test_the_fewest_points_have_an_error_bar_that_holds_the_truth(n):
    arcs = answer(positions(half_circle(), np.linspace(0.0, 0.5, n))).arcs
    assert abs(arcs.total_angle - np.pi) < 2 * arcs.total_angle_se


@pytest.mark.parametrize("noise", [0.0, 1e-4])
@pytest.mark.parametrize("friction", [0.0, 1e-300, 1e-12, 0.145])
@pytest.mark.parametrize("drive", [{}, {"displacement_in": 1e-3}, {"displacement_target": 1e-3}])
@pytest.mark.parametrize("angle", [0.0, 1e-8, 2 * np.pi, 100.0])
def test_extreme_routes_and_friction_give_finite_numbers(angle, friction, drive, noise):
    length = max(0.5, 0.03 * angle)
    course = chain(np.array([length]), np.array([angle / length]))
    s = np.linspace(0.0, length, max(60, int(6 * angle)))
    points = positions(course, s) + np.outer(s, [0.0, 0.0, 0.1])  # loops of a coil do not lie in each other
    points += noise * np.random.default_rng(1).standard_normal(points.shape)
    rig = Rig(friction=Friction(coefficient=friction))
    if (
        "displacement_target" in drive and friction * angle > 10.0
    ):  # 1 N at the load needs a million at the drive
        (rejected,) = process([Frame(points, **drive)], rig, tension_in=PULL)
        assert isinstance(rejected, Rejected)
        assert rejected.reason.endswith("[strain]")
        return
    results = numbers(answer(points, rig, **drive))
    assert np.isfinite(results).all()
    if not angle:
        assert results[1] < 1e-3


@pytest.mark.parametrize("length", [1e-3, 1.0, 50.0])
def test_the_answer_scales_with_the_route_from_a_millimetre_to_fifty_metres(length):
    points = positions(half_circle(), np.linspace(0.0, 0.5, 60))
    small, large = numbers(answer(points)), numbers(answer(points * length / 0.5))
    np.testing.assert_allclose(large[[0, 4]], small[[0, 4]] * length / 0.5, rtol=1e-9)  # rounding of the fit
    np.testing.assert_allclose(large[[1, 3]], small[[1, 3]], rtol=1e-9)
