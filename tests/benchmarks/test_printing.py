"""What the benchmarks print, and that every timed stage runs."""

import numpy as np
import pytest

from benchmarks import accuracy, machine, number, speed, table
from benchmarks.accuracy import failings, targets
from benchmarks.scores import METHODS, Outcome, Result, Score, bound, details, matrix, run, summary
from benchmarks.stages import PIPELINES, SMOOTH_STAGES, STAGES, frames
from tests.known_routes import Cell

CELL = Cell("test", "half circle", 30, 5e-4)


def _result(scores=None):
    outcomes = run(CELL, [0]) if scores is None else dict.fromkeys(METHODS, Outcome(scores, ()))
    return Result(CELL, bound(CELL, 1), 30.0, {name: summary([outcomes[name]], 1) for name in METHODS})


def _score(angle, se):
    return Score(angle, se, abs(angle), 0.0, np.nan, 1.0, thin=1.0)


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (np.nan, "—"), (np.inf, "—"), (1234.5, "1234"), (0.034567, "0.0346"), (-5.0, "-5.00")],
)
def test_numbers_have_three_digits_and_no_exponent(value, text):
    assert number(value) == text


def test_columns_are_as_wide_as_their_widest_cell():
    lines = table(["a", "bb"], [["long", "1"], ["x", "22.5"]], text_columns=1, markdown=False).splitlines()
    assert lines == ["a       bb", "----  ----", "long     1", "x     22.5"]


def test_markdown_says_on_which_side_numbers_stand():
    lines = table(["a", "b"], [["x", "1.5"]], text_columns=1, markdown=True).splitlines()
    assert lines == ["| a |   b |", "| - | --: |", "| x | 1.5 |"]


def test_the_machine_is_described_without_its_name():
    import platform

    assert "numpy" in machine()
    assert platform.node() not in machine()


def test_every_estimator_has_a_column_and_every_cell_a_row():
    result = _result()
    head, _, row = matrix([result], markdown=False).splitlines()
    assert all(name in head for name in METHODS)
    assert row.startswith("half circle N 30")
    text = details([result], every=True, markdown=False)
    assert all(name in text for name in ("bound", *METHODS))
    assert "failed" not in text.splitlines()[-1]


def test_failures_are_printed():
    one = summary([Outcome((), ("FitError: no curve",))], 1)
    result = Result(CELL, bound(CELL, 1), 30.0, dict.fromkeys(METHODS, one))
    assert "auto failed 1 times in half circle N 30 0.5 mm known: FitError: no curve" in details(
        [result], every=False, markdown=False
    )
    assert failings([result])


def test_cells_that_miss_a_target_are_named():
    scores = tuple(_score(0.1, 0.01) for _ in range(20))  # ten standard errors off
    text = targets([_result(scores)], markdown=False)
    assert "rms <= 1.3 x bound: missed in" in text
    assert "coverage 93 to 97 %, two deviations of chance allowed: missed in" in text
    assert "rms not above the best peer's: missed in" not in text  # all are equally bad here


def test_the_quick_run_fails_on_intervals_that_hold_too_little():
    assert any("95 % intervals hold 0 %" in line for line in failings([_result((_score(0.1, 0.01),))]))
    assert not failings([_result((_score(0.01, 0.01),))])


def test_an_unknown_cell_is_an_error(capsys):
    assert accuracy.main(["--cell", "no such cell"]) == 2
    assert "no such cell" in capsys.readouterr().out


def test_fibres_have_rows_of_their_own(capsys):
    assert accuracy.main(["--cell", "fibre: setup A 40", "--trials", "3"]) == 0
    printed = capsys.readouterr().out
    (row,) = [line for line in printed.splitlines() if line.startswith("setup A 40 gratings")]
    raw, spline, ours = (float(one) for one in row.split("/m")[1].split()[:3])
    assert 0.0 < ours < min(raw, spline)


@pytest.mark.parametrize("stage", [*STAGES, SMOOTH_STAGES[-1], *PIPELINES], ids=lambda stage: stage.name)
def test_every_timed_stage_runs_on_one_frame_after_the_other(stage):
    calls = stage.calls(frames(30, 2))
    for _ in range(3):
        assert next(calls)() is not None


def test_speed_prints_a_line_for_every_stage(capsys, monkeypatch):
    monkeypatch.setattr(speed, "_COUNTS", (30,))
    monkeypatch.setattr(speed, "_QUICK_SCALING", (20, 40))
    assert speed.main(["--quick", "--pairs", "2"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("machine: ")
    assert all(printed.count(f"\n{stage.name} ") == 2 + (stage in SMOOTH_STAGES) for stage in STAGES)
    assert all(printed.count(f"\n{stage.name} ") > 0 for stage in SMOOTH_STAGES)
