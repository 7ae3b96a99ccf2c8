"""How the differences between bars and lumped chain go when either is refined."""

import numpy as np
import pytest
from scipy.optimize import brentq

from tests.tendon.lumped_pair import (
    BLOCKED,
    HALF,
    HELD,
    LOOP,
    MM,
    MU,
    PI,
    RHO,
    SETUP_B,
    SPRING,
    STROKES,
    Case,
    by_bars,
    by_lumped,
    on_wander,
)
from tssgeom.rig import Rig, Tendon
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.capstan import pretensioned, step, transmit

TENSION_IN, TENSION_OUT, ELONGATION = 0, 1, 2  # rows of a run
FORCE_STILL = Case(*SETUP_B, "force", range(8), [2.0, 15.0, 8.0, 4.0, 12.0, 6.0, 9.0, 15.0])
POSITION_STILL = Case(*SETUP_B, "displacement", range(7), np.array([0, 2, 1.5, 0.8, 1.6, 1.2, 2]) * MM)
FORCE_MOVING = on_wander("force", STROKES["force"], SPRING)
POSITION_MOVING = on_wander("displacement", STROKES["displacement"], BLOCKED)
POSITION_HELD = on_wander("displacement", HELD["displacement"], BLOCKED)


def rms(difference):
    return np.sqrt(np.mean(difference**2))


# What is left with 60 bars, rms: measured, rounded up by half. It is a tenth of the promise or less.
@pytest.mark.parametrize(
    ("case", "row", "left"),
    [
        (FORCE_STILL, ELONGATION, 0.14e-6),
        (POSITION_STILL, ELONGATION, 0.04e-6),
        (FORCE_MOVING, ELONGATION, 0.04e-6),
        (POSITION_MOVING, TENSION_OUT, 0.0013),
        (POSITION_HELD, TENSION_OUT, 0.0005),
    ],
    ids=["force", "position", "moving, force", "moving, position", "moving, position held"],
)
def test_the_difference_falls_with_the_square_of_the_bars(case, row, left):
    asked = case.asked(41)
    truth = by_lumped(case, asked, 0.02, 640)[row]
    few, many = (rms(by_bars(case, asked, 0.02, bars)[row] - truth) for bars in (15, 60))
    assert few / many > 10.0  # 16 for order two; joints of pieces fall unevenly into bars
    assert many < left


@pytest.mark.parametrize(
    ("case", "row"),
    [(FORCE_MOVING, ELONGATION), (POSITION_MOVING, TENSION_IN), (POSITION_MOVING, TENSION_OUT)],
    ids=["force", "position, near end", "position, far end"],
)
def test_the_difference_on_a_moving_route_falls_with_the_step_in_time(case, row):
    asked = case.asked(41)
    truth = by_lumped(case, asked, 0.0025, 160)[row]
    long, short = (rms(by_bars(case, asked, span, 120)[row] - truth) for span in (0.2, 0.025))
    assert long / short > 4.0  # 8 for order one, for which 0.2 s is rather long


def exact_tension_in(positions):
    """Tension [N] of a drive that was pulled to `at[0]` against a fixed end and goes back, closed form."""
    rig, arcs = Rig(tendon=Tendon(compliance_per_N=RHO, pretension_N=2.0)), Arcs.exact(*SETUP_B)

    def missing(tension_in, state, location):
        return transmit(step(state, tension_in, MU), arcs, rig).elongation - location

    top = brentq(missing, 2.0, 100.0, args=(pretensioned(rig), positions[0]), xtol=1e-12)
    pulled = step(pretensioned(rig), top, MU)
    return np.array([top, *(brentq(missing, 0.01, top, args=(pulled, x), xtol=1e-12) for x in positions[1:])])


def test_just_after_a_position_drive_turns_the_tension_errs_by_no_more_than_the_first_bar_holds():
    asked = np.concatenate(([1.0], 1.0 + np.geomspace(1e-5, 1.0, 26)))
    case = Case(*SETUP_B, "displacement", [0, 1, 2], np.array([0.0, 2.0, 1.0]) * MM, BLOCKED)
    truth = exact_tension_in(np.interp(asked, case.knots, case.values))
    passed = (truth[0] - truth) / (2 * MU * truth[0])  # how far the front has come, about [rad]
    for bars in (30, 60, 120):
        error = np.abs(by_bars(case, asked, 0.01, bars)[0] - truth)
        bar = 2 * PI / LOOP * (LOOP + HALF) / bars  # angle of the first bar [rad]
        assert np.all(error <= MU * bar * truth[0])  # half a bar on either side of the cone
        # a corner of the profile inside a bar costs up to μθ/8, shared by the bars that the front has passed
        assert np.all(error[passed > 3 * bar] <= MU * bar * truth[0] / (8 * 3))
