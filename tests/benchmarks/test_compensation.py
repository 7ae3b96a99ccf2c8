"""Gain of compensation on the lumped rig, in small cases and in the table."""

import numpy as np
import pytest

from benchmarks import compensation
from benchmarks.compensation import (
    COMMANDERS,
    PRETENSION,
    STIFFNESS,
    case,
    moved,
    ours,
    rms,
    scores,
    sensed,
    tracked,
)

FRAMES = 40


@pytest.mark.parametrize("seed", [0, 3])
@pytest.mark.parametrize("target", ["sine", "steps"])
def test_commands_of_the_model_leave_a_seventh_of_the_error_on_a_route_that_moves(target, seed):
    errors = scores(target, FRAMES, 5e-4, moving=True, seeds=[seed])
    left = {name: rms(position) for name, (position, _) in errors.items()}
    # 3 % of friction and compliance make some 30 µm, a twelfth; chance adds less than half of that
    assert left["ours"] < left["none"] / 7
    assert left["ours"] < left["backlash inverse"] / 1.5  # which does not know that bends move
    assert left["ours"] < 1.1 * left["closed form"]


def test_on_a_route_that_stands_the_model_is_the_closed_form():
    errors = scores("ramps", FRAMES, 1e-4, moving=False, seeds=[0])
    ratio = rms(errors["ours"][0]) / rms(errors["closed form"][0])
    assert ratio == pytest.approx(1.0, abs=0.05)  # they hear the noise of the points differently
    assert rms(errors["backlash inverse"][0]) < 1e-6  # two lines are the truth there, if fitted without error


def test_the_rig_moves_its_route_first_and_its_drive_then():
    one = case("sine", 5, 1e-4, moving=True)
    commands = np.array([2.0, 3.0, 2.5, 3.5, 3.0]) * 1e-3
    run = moved(one.angles, commands)
    assert run.displacement_in[2::2] == pytest.approx(commands, abs=1e-15)
    assert run.displacement_in[1::2] == pytest.approx([0.0, *commands[:-1]], abs=1e-15)
    error = tracked(one, commands)
    assert error.tension == pytest.approx(STIFFNESS * error.position, abs=1e-9)  # a spring, solved to 1e-9 N
    assert run.tension_out[0] == pytest.approx(PRETENSION, abs=1e-9)


def test_a_draw_repeats_and_the_next_differs():
    one, other = (case("steps", 10, 5e-4, moving=False, seed=seed) for seed in (0, 1))
    assert np.array_equal(ours(one), ours(one))
    assert not np.array_equal(sensed(one)[0], sensed(other)[0])


def test_the_table_names_everybody_and_fails_where_too_much_is_left(capsys, monkeypatch):
    monkeypatch.setattr(compensation, "TARGETS", {"steps": compensation.TARGETS["steps"]})
    assert compensation.main(["--quick", "--frames", "16"]) == 0
    printed = capsys.readouterr().out
    assert all(printed.count(f"  {name}  ") == 2 for name in COMMANDERS)  # on either route
    monkeypatch.setattr(compensation, "SHARE", 1e-3)
    assert compensation.main(["--quick", "--frames", "16"]) == 1
    assert "of the error is left" in capsys.readouterr().out
