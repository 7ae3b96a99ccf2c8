import numpy as np
import pytest

from tssgeom.route.synthetic import chain, colon, frames, positions, samples, setup_a, setup_b


def test_an_arc_closes_after_a_full_turn():
    loop = chain(np.array([0.3, 0.7]) * 2 * np.pi * 0.05, np.array([20.0, 20.0]))
    np.testing.assert_allclose(positions(loop, np.array([loop.total_length])), 0.0, atol=1e-15)


def test_axes_stay_orthonormal():
    _, axes = frames(colon())
    np.testing.assert_allclose(axes[-1] @ axes[-1].T, np.eye(3), atol=1e-12)


def test_positions_agree_with_stepping_along_the_tangent():
    course = chain(np.array([0.1, 0.2]), np.array([12.0, 30.0]), np.array([0.3, 2.0]))
    s = np.linspace(0, 0.3, 30001)
    points = positions(course, s)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    np.testing.assert_allclose(steps, 1e-5, rtol=1e-6)
    direction = np.diff(points, axis=0) / steps[:, None]
    turning = np.arccos(np.clip(np.sum(direction[1:] * direction[:-1], axis=1), -1, 1)).sum()
    assert turning == pytest.approx(course.total_angle, rel=1e-3)


def test_setups_a_and_b_differ_in_order_only():
    a, b = setup_a(), setup_b()
    assert a.total_angle == pytest.approx(3 * np.pi)
    assert b.total_angle == pytest.approx(a.total_angle, rel=1e-14)
    assert a.total_length == pytest.approx(0.5, abs=2e-4)  # the radii are given to 0.1 mm


def test_samples_are_the_same_at_every_call():
    for one, other in zip(samples(), samples(), strict=True):
        np.testing.assert_array_equal(one.points, other.points)
