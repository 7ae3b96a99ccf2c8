"""Remarks on many runs are few lines: each once, and those that differ only in the run together."""

from dataclasses import replace

import pytest

from pipelines.discover import _print_table
from pipelines.remarks import grouped
from tests.worked_finding import worked_finding
from tssgeom.view import finding_wording as words

RUNS = ("slow", "fast", "slow_2")


def test_remarks_that_differ_only_in_the_run_are_one_line_with_the_runs():
    said = [f"{run}: t/s read as time_s; F1 read as tension_in_N × 0.001" for run in RUNS]
    assert grouped([*said, *said], RUNS) == [
        "slow, fast, slow_2: t/s read as time_s; F1 read as tension_in_N × 0.001"
    ]


def test_numbers_that_differ_from_run_to_run_are_a_range_and_those_in_names_are_not():
    counts = zip(RUNS, (4, 10, 9), (1800, 1800, 1800), strict=True)
    said = [f"{run}: tension_in_1_N is missing in {some} of {all_} rows" for run, some, all_ in counts]
    assert grouped(said, RUNS) == ["slow, fast, slow_2: tension_in_1_N is missing in 4 to 10 of 1800 rows"]


def test_a_run_is_known_inside_a_remark_and_signs_and_powers_count():
    said = ["zero of T of slow is -0.2 N, 1e-05 of 3.", "zero of T of slow_2 is -1.5 N, 2e-06 of 3."]
    assert grouped(said, RUNS) == ["zero of T of slow, slow_2 is -1.5 to -0.2 N, 2e-06 to 1e-05 of 3."]


def test_what_differs_in_words_or_is_of_one_run_twice_or_of_none_stays_apart():
    said = [
        "slow: a gap of 1 s",
        "slow: a gap of 2 s",
        "fast: a gap of 5 s",
        "fast: it creeps",
        "of 3 runs, 1",
    ]
    assert grouped([*said, "of 4 runs, 1"], RUNS) == [
        "slow, fast: a gap of 1 to 5 s",
        "slow: a gap of 2 s",
        "fast: it creeps",
        "of 3 runs, 1",
        "of 4 runs, 1",
    ]


@pytest.mark.parametrize("verdict", ["none", "effect"])
def test_the_verdict_is_the_last_line_that_discover_prints_and_each_remark_is_there_once(
    capsys, tmp_path, verdict
):
    finding = worked_finding(verdict)
    names = [run.name for run in finding.campaign.runs]
    said = tuple(f"{name}: tension_out_N is missing in {4 + k} of 240 rows" for k, name in enumerate(names))
    campaign = replace(finding.campaign, notes=said)
    _print_table(replace(finding, campaign=campaign, notes=said), tmp_path, ["report.html"])
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1] == f"{words.VERDICTS[finding.verdict]}: {finding.sentence}"
    (note,) = [line for line in lines if "is missing in" in line]
    last = 3 + len(names)
    assert note == f"note: {', '.join(names)}: tension_out_N is missing in 4 to {last} of 240 rows"
