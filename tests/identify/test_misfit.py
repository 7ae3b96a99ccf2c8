"""In which phase of a run each reading is."""

import numpy as np
import pytest

from tssgeom.identify.campaign import Route
from tssgeom.identify.finding import PHASES
from tssgeom.identify.misfit import phases
from tssgeom.identify.readings import Reading
from tssgeom.route.pieces import Arcs


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_drive_that_only_trembles_is_held(noise):
    step = np.concatenate((np.full(20, 1.0), np.resize([0.02, 0.02, -0.02, -0.02], 20), np.full(20, -1.0)))
    drive, time = 5.0 + np.cumsum(step), np.arange(60.0)
    route = Route("one", Arcs.exact(np.ones(1), np.ones(1)), np.zeros((0, 3)), np.zeros(0))
    given = {"time_s": time, "tension_in_N": drive}
    run = Reading("run", route, False, "tension_in_N", given, {}, {"tension_in_N": noise})
    names = [PHASES[k] for k in phases(run, np.where(time < 35.0, 1.0, -1.0))]
    assert names[:19] == ["pull"] * 19
    assert names[22:38] == ["hold"] * 16
    assert names[42:] == ["release"] * 18
    assert PHASES[phases(run, -np.ones(60))[10]] == "release_to_pull"
    assert PHASES[phases(run, np.ones(60))[50]] == "pull_to_release"
