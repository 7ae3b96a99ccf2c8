"""The bounds of commands hold on lumped rigs whose numbers are samples of what is stated."""

import numpy as np
import pytest

from benchmarks import streams
from benchmarks.streams import GAIN_SD, MU_SD, RHO_SD, outcome

RIGS = 48


@pytest.mark.parametrize("by_force", [False, True])
@pytest.mark.parametrize("moving", [False, True])
def test_the_95_percent_bounds_hold_as_often_as_they_say(moving, by_force):
    shares = np.array([outcome(seed, moving=moving, by_force=by_force).holds.mean() for seed in range(RIGS)])
    # commands on one rig share its errors: the standard error is that over rigs; 93 to 97 % is the goal
    chance = 3.0 * shares.std(ddof=1) / np.sqrt(RIGS)
    assert 0.93 - chance <= shares.mean() <= 0.97 + chance
    assert chance < 0.15


def test_without_the_errors_of_the_rig_the_bounds_do_not_hold(monkeypatch):
    monkeypatch.setattr(streams, "commander_of", lambda rig, uncertain: None)
    shares = [outcome(seed, moving=False, by_force=False).holds.mean() for seed in range(8)]
    assert np.mean(shares) < 0.5
    assert min(MU_SD, RHO_SD, GAIN_SD) > 0.0


def test_the_table_fails_where_the_bounds_are_too_narrow(capsys, monkeypatch):
    assert streams.main(["commands", "--rigs", "24"]) == 0
    assert "moving route, by tension" in capsys.readouterr().out
    monkeypatch.setattr(streams, "bound", lambda error: 0.1 * error)
    assert streams.main(["commands", "--rigs", "8"]) == 1
    assert "of the bounds hold" in capsys.readouterr().err
