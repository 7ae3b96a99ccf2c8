"""A run that is simulated states for each sample how the drive goes."""

import math

import numpy as np
import pytest

from tssgeom.rig import Friction, Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.moving import MovingRoute
from tssgeom.tendon.simulation import simulate

ROUTE = MovingRoute(np.zeros(1), [Arcs.exact([0.5], [math.pi])])
RIG = Rig(tendon=Tendon(pretension_N=3.0), friction=Friction(coefficient=0.145))


@pytest.mark.parametrize("rest_m", [0.0, 2e-3, -1e-3])
def test_a_position_that_stays_is_held_whatever_its_zero(rest_m):
    rest = [rest_m] * 3
    drive = np.array([*rest, rest_m + 1e-3, rest_m + 1e-3, rest_m + 0.999e-3])
    moments = simulate(np.arange(6.0), ROUTE, RIG, displacement_in=drive)
    assert [each.phase for each in moments][1:] == ["hold", "hold", "pull", "hold", "pull_to_release"]
