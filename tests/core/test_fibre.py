"""The entries of a fibre against their slow twin on random gratings."""

import math

import numpy as np
import pytest

from tests.core.twins import fibre as twin
from tssgeom import core
from tssgeom.errors import FitError

KINDS = np.array([[0.0, 0.0, 0.3], [100.0, 0.0, 0.3], [60.0, 12.0, 0.4]]).T
RATE = 8.0


def _sites(seed, n=None):
    """Gratings on two pieces of curvature, the last site an end without one."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 7)) if n is None else n
    s = np.concatenate(([0.0], np.sort(rng.uniform(0.0, 0.5, n - 1))))
    bend = 10.0 * np.repeat(rng.normal(size=(2, 2)), 4, axis=0)[:n] + 0.5 * rng.normal(size=(n, 2))
    precision = rng.uniform(0.3, 4.0, n)
    precision[-1] = 0.0
    return s, bend, precision


def test_evidence_is_that_of_all_partitions_and_the_likeliest_is_named():
    for seed in range(40):
        given = (*_sites(seed), *KINDS, RATE)
        every = twin.partitions(*given)
        result, origin, kind = core.fibre_evidence(*given)
        assert result == pytest.approx(twin.log_evidence(every), rel=1e-8, abs=1e-8)
        _, starts, kinds = max(every)
        ends = [*starts[1:], len(given[0])]
        assert [origin[end] for end in ends] == starts
        assert [kind[end] for end in ends] == list(kinds)


def _draws(given, nodes_each=2, count=4000):
    s = given[0]
    m = nodes_each * (len(s) - 1) + 1
    node = np.interp(np.arange(m) / nodes_each, np.arange(len(s)), s)
    rng = np.random.default_rng(0)
    uniform, normal = rng.random((count, 2 * len(s))), rng.standard_normal((count, 8 * len(s)))
    evidence, *draws = core.fibre_draws(*given, node, uniform, normal)
    assert evidence == core.fibre_evidence(*given)[0] or math.isnan(evidence)
    return node, draws


def test_draws_have_the_moments_of_the_posterior():
    for seed in range(6):
        given = (*_sites(seed, 6), *KINDS, RATE)
        first, second = twin.posterior(*given)
        _, (curvature, *_) = _draws(given)
        at_sites = curvature[:, ::2]
        sd = np.sqrt(second - first**2)
        error = np.abs(at_sites.mean(axis=0) - first) / sd * math.sqrt(4000)
        assert error.max() < 4.5  # 72 means in all, one of which is beyond 4.5 standard errors once in 2000
        assert np.sqrt(np.mean(at_sites**2, axis=0)) == pytest.approx(np.sqrt(second), rel=0.12)


def test_angles_are_the_integral_of_the_magnitude_of_each_draw():
    given = (*_sites(3, 6), *KINDS, RATE)
    node, (curvature, magnitude, angle, _) = _draws(given, nodes_each=400, count=50)
    assert magnitude == pytest.approx(np.linalg.norm(curvature, axis=2), rel=1e-12)
    whole = np.sum(0.5 * (magnitude[:, 1:] + magnitude[:, :-1]) * np.diff(node), axis=1)
    # they differ in the cells of joints, 1/400 of the spacing wide
    assert angle[:, -1] == pytest.approx(whole, abs=0.02)
    assert (np.diff(angle, axis=1) >= 0.0).all()


def test_a_draw_is_smooth_where_a_piece_of_it_is():
    s, bend, precision = _sites(2, 6)
    only = [(KINDS[:, [k]] / np.array([[1.0], [1.0], [KINDS[2, k]]])) for k in (1, 2)]
    smooth = [_draws((s, bend, precision, *each, RATE))[1][3] for each in only]
    assert not smooth[0].any()
    assert smooth[1].all()


@pytest.mark.parametrize("index", [0, 1, 2])
def test_numbers_that_are_none_end_without_a_result(index):
    given = list(_sites(1, 6))
    given[index] = np.full_like(given[index], math.nan)
    assert math.isnan(core.fibre_evidence(*given, *KINDS, RATE)[0])
    assert len(_draws((*given, *KINDS, RATE), count=3)[1][2]) == 3


def test_nodes_that_do_not_divide_the_sites_are_refused():
    given = (*_sites(2, 6), *KINDS, RATE)
    with pytest.raises(FitError, match="do not belong to each other"):
        core.fibre_draws(*given, np.linspace(0.0, 0.5, 12), np.zeros((1, 12)), np.zeros((1, 48)))
