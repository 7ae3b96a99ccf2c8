"""A route whose distal end is straight: the distal tension knows the angle of the bends before it."""

import math

import numpy as np
import pytest

from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.bar_state import end_slope, to_bars
from tssgeom.tendon.state import Corners, TendonState, pretensioned, step, transmit


def slid(straight: float) -> tuple[TendonState, Arcs, Rig]:
    """A tendon that was pulled to 10 N on a bend of 2 ± 0.2 rad before a straight end [m]."""
    length = np.array([0.2, straight]) if straight else np.array([0.2])
    angle = np.array([2.0, 0.0]) if straight else np.array([2.0])
    covariance = np.zeros((2 * len(length),) * 2)
    covariance[len(length), len(length)] = 0.2**2
    arcs, rig = Arcs(length, angle, covariance, "arcs"), Rig()
    state = pretensioned(rig)
    for tension in (2.0, 10.0):
        state = step(state, arcs, rig, tension_in=tension)
    return state, arcs, rig


@pytest.mark.parametrize("straight", [0.0, 0.05, 0.3])
def test_bars_have_the_error_of_the_distal_tension_that_corners_have(straight):
    state, arcs, rig = slid(straight)
    assert isinstance(state.along, Corners)
    bars = to_bars(state.along, arcs, rig)
    expected = rig.friction.coefficient * state.tension_out * 0.2
    assert transmit(state, rig).tension_out_se == pytest.approx(expected)
    assert transmit(TendonState(bars, arcs), rig).tension_out_se == pytest.approx(expected, rel=1e-3)
    assert end_slope(bars, arcs) == pytest.approx(-rig.friction.coefficient, rel=1e-3)


def test_a_straight_route_has_no_slope():
    arcs = Arcs.exact(np.array([0.3]), np.array([0.0]))
    rig = Rig()
    state = step(pretensioned(rig), arcs, rig, tension_in=10.0)
    assert isinstance(state.along, Corners)
    assert end_slope(to_bars(state.along, arcs, rig), arcs) == 0.0
    assert not math.isnan(transmit(state, rig).tension_out_se)
