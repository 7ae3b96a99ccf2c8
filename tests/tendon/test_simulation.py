"""A run that is simulated states for each sample how the drive goes."""

import math

import numpy as np
import pytest

from tssgeom.effects import TensionOutGain
from tssgeom.rig import Friction, Load, Rig, Tendon
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


@pytest.mark.parametrize("drive", ["tension_in", "displacement_in"])
def test_readings_hold_the_drive_as_given_and_the_tension_as_a_wrong_sensor_reads_it(drive):
    effects = (TensionOutGain(gain_error=0.1),)
    hardware = Rig(effects=effects, tendon=Tendon(pretension_N=3.0), load=Load(stiffness_N_per_m=2e3))
    values = np.array([5.0, 9.0, 7.0]) * (1.0 if drive == "tension_in" else 1e-3)
    moments = simulate(np.arange(3.0), ROUTE, hardware, **{drive: values})
    for moment, value in zip(moments, values, strict=True):
        unit = "N" if drive == "tension_in" else "m"
        assert moment.readings[f"{drive}_{unit}"] == value
        assert moment.readings["tension_out_N"] == pytest.approx(1.1 * moment.transmission.tension_out)
