"""The order of frames in a recording."""

import numpy as np
import pytest

from tssgeom.io.formats.recording import in_order
from tssgeom.stream import Frame, Rejected

POINTS = np.column_stack((np.arange(5.0), np.zeros(5), np.zeros(5)))


@pytest.mark.parametrize("bad", [Frame(POINTS[:2], 1e9), Frame(POINTS, 1e9, tension_in=-7.0)])
def test_the_time_of_a_frame_that_cannot_be_used_does_not_count(bad):
    frames = [Frame(POINTS, 0.1), bad, Frame(POINTS, 0.2), Frame(POINTS, 0.15)]
    outcome = list(in_order(frames))
    assert outcome[:3] == frames[:3]
    assert isinstance(outcome[3], Rejected)
    assert "comes after 0.2 s" in outcome[3].reason
