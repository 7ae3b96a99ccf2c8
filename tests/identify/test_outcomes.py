"""What is said of each outcome of a proposed run."""

import numpy as np
import pytest

from tssgeom.identify.outcomes import Contrast, outcome
from tssgeom.identify.waveform import Course

NOISE = 1e-6
TIME = np.linspace(0.0, 3.0, 301)
CORNER_TIME = np.array([0.0, 1.0, 2.0, 3.0])
CORNER = np.array([[0.0], [1e-3], [1e-3], [0.0]])
COURSE = Course(TIME, np.interp(TIME, CORNER_TIME, CORNER[:, 0])[:, None], CORNER_TIME, CORNER)


@pytest.mark.parametrize(
    ("difference", "said"),
    [
        (1e-5, "in the dwell at 1 mm (1 to 2 s) is 0.030 mm with creep and 0.020 mm with backlash"),
        (5e-7, "no leg alone decides, the course over all of them does"),
        (5e-8, "it does not separate creep from backlash"),
    ],
)
def test_an_outcome_decides_by_a_leg_or_by_all_or_not_at_all(difference, said):
    dwell = (TIME > 1.0) & (TIME < 2.0)
    off = {"displacement_out_m": difference * dwell}
    contrast = Contrast(1, 2, off, {"displacement_out_m": np.full(len(TIME), 2e-5)})
    sigma = {"displacement_out_m": np.full(len(TIME), NOISE)}
    channel, words = outcome(contrast, ("creep", "backlash"), sigma, COURSE, ("displacement_in_m",))
    assert channel == "displacement_out_m"
    assert said in words
