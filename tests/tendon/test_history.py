"""A history of tensions gives what one step after the other gives."""

import math

import numpy as np
import pytest

from tssgeom.rig import Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.capstan import pretensioned, step, transmit
from tssgeom.tendon.history import driven, joined, profiles

ROUTE = Arcs.exact([0.1, 0.3, 0.1], [0.0, math.pi, 0.7])
RIG = Rig(tendon=Tendon(pretension_N=1.5))
DRIVE = [1.5, 8.0, 15.0, 9.0, 12.0, 2.0]


def test_a_history_is_the_steps_one_after_the_other():
    run, state = driven(DRIVE, ROUTE, RIG), pretensioned(RIG)
    for k, drive in enumerate(DRIVE):
        state = step(state, drive, RIG.friction.coefficient)
        observed = transmit(state, ROUTE, RIG)
        assert run.tension_out[k] == observed.tension_out
        assert run.elongation[k] == pytest.approx(observed.elongation, abs=1e-15)  # adds in another order


def test_profiles_begin_with_the_proximal_and_end_with_the_distal_tension():
    observed = profiles(DRIVE, np.array([0.0, ROUTE.total_angle]), RIG)
    np.testing.assert_allclose(observed[:, 0], DRIVE, rtol=1e-12)  # a logarithm and back
    np.testing.assert_allclose(observed[:, 1], driven(DRIVE, ROUTE, RIG).tension_out, rtol=1e-12)


def test_joined_routes_keep_the_errors_of_each():
    first = Arcs(np.array([0.1]), np.array([0.2]), np.diag([1e-6, 1e-4]), "arcs")
    second = Arcs(np.array([0.3, 0.1]), np.array([0.4, 0.5]), np.diag([2e-6, 3e-6, 4e-4, 5e-4]), "arcs")
    both = joined(first, second)
    np.testing.assert_array_equal(np.diag(both.covariance), [1e-6, 2e-6, 3e-6, 1e-4, 4e-4, 5e-4])
    assert both.total_angle == pytest.approx(1.1)


def test_a_history_may_be_empty():
    assert len(driven([], ROUTE, RIG).tension_out) == 0
