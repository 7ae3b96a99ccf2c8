"""Plays that are open when a run begins; docs/model.md (334)."""

import pytest

from tests.effects.rig import ARCS, FORCE, POSITION, RIG, RUNS, modelled
from tssgeom.effects import Backlash, LoadPlay
from tssgeom.tendon.bars.model import predict


def test_a_play_that_is_open_at_the_start_is_taken_up_first():
    shift = 1e-4
    moved = {**RUNS[POSITION], POSITION: RUNS[POSITION][POSITION] - shift}
    opened = modelled(POSITION, Backlash(width_m=3e-4, open_m=shift))
    behind = predict(moved, ARCS, RIG, [Backlash(width_m=3e-4)], drive=POSITION)
    assert opened[FORCE] == pytest.approx(behind[FORCE], abs=1e-12)
    assert opened[POSITION] == pytest.approx(behind[POSITION] + shift, abs=1e-15)
    assert opened["elongation_m"] == pytest.approx(behind["elongation_m"] + shift, abs=1e-15)
    true = modelled(POSITION)["displacement_out_m"]
    read = modelled(POSITION, LoadPlay(width_m=3e-4, open_m=shift))["displacement_out_m"]
    assert read[0] == true[0]
    assert (true - read)[1:30] == pytest.approx(shift)  # all is pulled there
