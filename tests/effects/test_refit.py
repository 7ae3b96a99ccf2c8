"""What fits are for: the size of an effect comes back from a run of the independent simulator with noise."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from tests.effects.rig import ARCS, FORCE, PHYSICS, RIG, RUNS, refereed
from tssgeom.effects import KINDS
from tssgeom.rig import Friction, Rig, Tendon
from tssgeom.tendon.bars.model import predict

NOISE = {"tension_out_N": 0.05, "elongation_m": 2e-5}
NAMES = (
    "load_dependent_friction",
    "straight_section_friction",
    "asymmetric_friction",
    "slack_take_up",
    "pretension_error",
    "backlash",
    "thermal_drift",
)


@pytest.mark.parametrize("name", NAMES)
def test_friction_compliance_and_effect_come_back_within_their_errors(name):
    kind, truth = KINDS[name], refereed(FORCE, **PHYSICS[name])
    # a play typically starts at its edge, about which nothing is fitted
    keys = [key for key, reported in kind.parameters.items() if reported.fitted and reported.typical]
    typical = np.array([kind.parameters[key].typical for key in keys])
    rng = np.random.default_rng(5)
    data = {c: truth[c] + sd * rng.standard_normal(len(truth[c])) for c, sd in NOISE.items()}

    def missed(x):
        tendon = Tendon(pretension_N=2.0, compliance_per_N=3.16e-4 * x[0])
        rig = Rig(tendon=tendon, friction=Friction(coefficient=0.145 * x[1]), load=RIG.load)
        effect = kind(**dict(zip(keys, (typical * x[2:]).tolist(), strict=True)))
        observed = predict(RUNS[FORCE], ARCS, rig, [effect])
        return np.concatenate([(observed[c] - data[c]) / sd for c, sd in NOISE.items()])

    start = [1.0, 1.0, *(0.7 if kind.parameters[key].switch else 1.3 for key in keys)]
    fit = least_squares(missed, start, method="lm", diff_step=1e-4)
    error = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))
    assert np.all(np.abs(fit.x - 1.0) < 4.0 * error)
    assert error[2] < 0.15  # the run identifies the size, so the line above is a test
    assert fit.cost * 2.0 < 300.0  # of 242 values: 2.7 standard deviations of chance
