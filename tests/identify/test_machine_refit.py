"""A model of a machine without one of its parts, beside itself."""

import numpy as np

from tssgeom.effects import Backlash, TensionInGain
from tssgeom.identify.machine_evidence import FittedModel
from tssgeom.identify.machine_parameters import Parameter
from tssgeom.identify.machine_parts import Number, Part
from tssgeom.identify.machine_problem import FitState, Problem
from tssgeom.identify.machine_refit import reordered
from tssgeom.rig import Rig
from tssgeom.uncertain import UNKNOWNS

_PRIOR = UNKNOWNS["friction.coefficient"]


def _part(name: str, effect, *numbers: str) -> Part:
    return Part(name, effect, tuple(Number(one, "", "", _PRIOR, 0.0) for one in numbers))


def test_the_numbers_of_the_part_that_may_go_stand_behind_all_others():
    gain = _part("gain", TensionInGain(gain_error=0.01), "gain_error")
    parts = (_part("play", Backlash(width_m=1e-4), "width_m"), gain)
    names = ("friction", "play: width_m", "compliance", "gain: gain_error")
    problem = Problem((), Rig(), tuple(Parameter(one, "", _PRIOR, "rig") for one in names), (), 16)
    state = FitState(np.arange(4.0), [], [], [], np.ones(0), 0.0, 0.1 * np.arange(4.0))
    made = reordered(FittedModel(problem, state, parts, {}, {}, {}), 0)
    order = [0, 2, 3, 1]
    assert [one.name for one in made.problem.parameters] == [names[k] for k in order]
    assert made.state.u.tolist() == order
    assert made.state.steps.tolist() == [0.1 * k for k in order]
    assert made.parts == parts
