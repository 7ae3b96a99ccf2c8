import itertools

import numpy as np
import pytest

from tssgeom import core
from tssgeom.route.pieces import Arcs
from tssgeom.route.synthetic import chain, colon, half_circle, setup_a, setup_b

BENT_3D = chain(np.array([0.1, 0.1, 0.1]), np.array([0.0, 20.0, 20.0]), np.array([0.0, 0.0, 2.0]))


@pytest.mark.parametrize("course", [half_circle(), setup_a(), colon(), BENT_3D])
@pytest.mark.parametrize("noise", [0.0, 2e-4, 2e-3])
def test_pieces_keep_length_and_angle(geometry, sensed, course, noise):
    _, profile, pieces = geometry(sensed(course, 150, noise)[0])
    assert pieces.total_length == pytest.approx(profile.length, rel=1e-12)
    assert pieces.total_angle == pytest.approx(profile.total_angle, rel=1e-12)
    assert pieces.total_angle_se == pytest.approx(profile.total_angle_se, rel=1e-6)
    assert (pieces.length > 0).all()
    assert (pieces.angle >= 0).all()


@pytest.mark.parametrize(
    ("course", "count"), [(half_circle(), 1), (setup_a(), 2), (setup_b(), 2), (BENT_3D, 3)]
)
def test_pieces_are_identified(geometry, sensed, course, count):
    _, _, pieces = geometry(sensed(course, 200, 1e-4)[0])
    long = (
        pieces.length > 0.04 * pieces.total_length
    )  # a short one may stand on a joint that is smoothed over
    assert long.sum() == count
    np.testing.assert_allclose(pieces.kappa[long], np.linalg.norm(course.bend, axis=1), rtol=0.05, atol=1.0)


def test_a_change_of_bending_plane_is_a_joint(geometry, sensed):
    course = chain(np.array([0.15, 0.15]), np.array([15.0, 15.0]), np.array([0.0, np.pi / 2]))
    _, _, pieces = geometry(sensed(course, 200, 1e-4)[0])
    assert np.min(np.abs(pieces.s_start - 0.15)) < 0.006


def _cost(value, weight, joints, penalty):
    total = penalty * (len(joints) - 2)
    for a, b in itertools.pairwise(joints):
        mean = np.average(value[a:b], axis=0, weights=weight[a:b])
        total += np.sum(weight[a:b, None] * (value[a:b] - mean) ** 2)
    return total


@pytest.mark.parametrize("seed", range(5))
def test_partition_is_the_best_of_all(seed):
    rng = np.random.default_rng(seed)
    value = np.repeat(rng.normal(size=(3, 2)), 4, axis=0) + 0.5 * rng.normal(size=(12, 2))
    weight = rng.uniform(0.5, 2.0, 12)
    all_ways = (
        [0, *cut, 12] for k in range(12) for cut in itertools.combinations(range(1, 12), k)
    )  # 2048 of them
    best = min(all_ways, key=lambda joints: _cost(value, weight, joints, 1.3))
    pieces, joints = core.best_partition(value, weight, 1.3)
    assert list(joints[: pieces + 1]) == best


def test_parallel_components_of_a_helix_turn_with_its_torsion():
    a, c = 0.03, 0.01
    t = np.linspace(0, 4 * np.pi, 4000)
    norm = np.hypot(a, c)
    tangent = np.column_stack((-a * np.sin(t), a * np.cos(t), np.full_like(t, c))) / norm
    normal = np.column_stack((-np.cos(t), -np.sin(t), 0 * t))
    parts = core.parallel_components(tangent, normal)
    turned = np.unwrap(np.arctan2(parts[:, 1], parts[:, 0]))
    torsion = c / norm**2
    assert abs(turned[-1] - turned[0]) == pytest.approx(torsion * norm * t[-1], rel=1e-4)
    np.testing.assert_allclose(np.linalg.norm(parts, axis=1), 1.0, rtol=1e-9)


def test_given_pieces_are_exact():
    arcs = Arcs.exact(np.array([0.1, 0.3, 0.1]), np.array([0.0, np.pi, 0.0]))
    assert arcs.total_angle_se == 0.0
    np.testing.assert_allclose(arcs.kappa, [0.0, np.pi / 0.3, 0.0])
    np.testing.assert_allclose(arcs.s_start, [0.0, 0.1, 0.4])
