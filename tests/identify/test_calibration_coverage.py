"""On the independent lumped chain the 95 % intervals of a calibration hold the truth."""

import pytest

pytest.importorskip("tests.lumped")
from benchmarks.calibration import trial

TRIALS = 8


def test_intervals_hold_the_truth_on_runs_of_the_lumped_chain():
    held = {"friction": 0, "compliance": 0, "tension_out_offset": 0, "elongation_offset": 0}
    for seed in range(TRIALS):
        result, truth = trial("white", seed)
        for name, value in truth.items():
            reported = result.estimates[name]
            held[name] += reported.low <= value <= reported.high
    # Of 8 intervals that hold with 95 %, fewer than 6 do with a chance below 1 %.
    assert all(count >= 6 for count in held.values()), held


def test_a_run_that_is_driven_by_position_identifies_friction_and_compliance():
    result, truth = trial("by position", 0)
    for name in ("friction", "compliance"):
        assert result.estimates[name].value == pytest.approx(truth[name], rel=0.05)  # angle gain of 1 %
