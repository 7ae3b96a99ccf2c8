"""Scores of the discovery benchmark, on reports written by hand."""

import math

import numpy as np
import pytest

from benchmarks import discovery
from benchmarks import discovery_scores as scores
from benchmarks.discovery import confusions, failures, limits, peers, target_rows, targets
from benchmarks.discovery_campaigns import Case, cases, discovered
from benchmarks.discovery_peers import Residual, held_out_ratio, without_flicker
from benchmarks.discovery_scores import Baseline, Outcome
from tests.campaigns import INSIDE, OUTSIDE

NOISE = {"tension_in_N": 0.02, "elongation_m": 2e-6}


def report(verdict, *named, tie=(), parameters=None, after=(0.02, 2e-6), before=(0.10, 2e-6), breaks=()):
    numbers = {
        key: {"value": v, "unit": "", "ci95": [low, high]}
        for key, (v, low, high) in (parameters or {}).items()
    }
    return {
        "verdict": verdict,
        "effects": [{"name": name, "parameters": numbers} for name in named],
        "tie": [list(names) for names in tie],
        "breaks_tie": [{"experiment": text, "expected_delta_bic": 20.0} for text in breaks],
        "gap": {
            "noise": NOISE,
            "before": {"held_out": dict(zip(NOISE, before, strict=True))},
            "after": {"held_out": dict(zip(NOISE, after, strict=True))},
        },
        "base": {"compliance_per_N": {"value": 3e-4, "ci95": [2.9e-4, 3.1e-4]}},
    }


def outcome(group, causes, report, seconds=5.0, parameters=None, **more):
    truth = {
        "effects": causes,
        "parameters": {causes[0]: parameters or {}} if causes else {},
        "compliance_per_N": 3.05e-4,
        "length_m": 0.5,
        "seed": 1,
    }
    return Outcome(group, truth, report, seconds, **more)


def test_the_first_name_counts_and_a_name_of_an_unknown_does_not():
    assert scores.right_first(outcome("single", ["creep"], report("effect", "creep", "backlash")))
    assert not scores.right_first(outcome("single", ["creep"], report("effect", "backlash", "creep")))
    assert not scores.right_first(outcome("single", ["creep"], report("unknown", "creep")))
    assert not scores.right_first(outcome("single", ["creep"], None))


def test_a_tie_counts_where_it_joins_the_first_name_to_the_cause():
    joined = report("tie", "toe_region", tie=[("toe_region", "slack_take_up")])
    apart = report("tie", "creep", tie=[("toe_region", "slack_take_up")])
    assert scores.right_or_tied(outcome("half", ["slack_take_up"], joined))
    assert not scores.right_or_tied(outcome("half", ["slack_take_up"], apart))
    assert scores.tie_size(outcome("half", ["slack_take_up"], joined)) == 2
    assert scores.tie_size(outcome("half", ["slack_take_up"], apart)) == 1


def test_a_tie_is_declared_with_the_experiment_that_breaks_it():
    tie = [("viscous_drag", "straight_section_friction")]
    assert scores.tie_declared(
        outcome("G5", ["viscous_drag"], report("tie", "viscous_drag", tie=tie, breaks=["faster"]))
    )
    assert not scores.tie_declared(outcome("G5", ["viscous_drag"], report("tie", "viscous_drag", tie=tie)))
    assert not scores.tie_declared(
        outcome("G5", ["viscous_drag"], report("effect", "viscous_drag", breaks=["faster"]))
    )


def test_a_cause_without_a_channel_is_unobservable_and_never_guessed():
    silent, guess = (report("none") | {"unobservable": ["creep"]}, report("effect", "backlash"))
    assert scores.honest(outcome("partial", ["creep"], silent))
    assert scores.honest(outcome("partial", ["creep"], report("effect", "creep")))
    assert not scores.honest(outcome("partial", ["creep"], guess | {"unobservable": ["creep"]}))
    assert not scores.honest(outcome("partial", ["creep"], None))


def test_both_of_a_pair_have_to_be_named_in_any_order():
    pair = ["creep", "backlash"]
    assert scores.both_named(outcome("pair", pair, report("effect", "backlash", "creep")))
    assert not scores.both_named(outcome("pair", pair, report("effect", "creep")))


def test_the_misfit_is_what_is_beyond_the_noise():
    # tension five times its noise, elongation at its noise: (25 − 1) / 2
    assert scores.gap({"tension_in_N": 0.10, "elongation_m": 2e-6}, NOISE) == pytest.approx(math.sqrt(12.0))
    assert scores.held_out_ratio(
        report("effect", "creep", after=(0.02 * math.sqrt(7.0), 1e-6))
    ) == pytest.approx(0.5)
    assert math.isnan(scores.held_out_ratio(report("none", before=(0.02, 2e-6))))
    assert math.isnan(scores.held_out_ratio(None))


def test_numbers_of_right_names_are_held_against_the_truth():
    truth = {"angle_rad": 0.5, "at_m": 0.2}
    estimates = {"angle_rad": (0.55, 0.4, 0.6), "at_m": (0.21, 0.205, 0.215)}
    right = outcome(
        "single", ["hidden_bend"], report("effect", "hidden_bend", parameters=estimates), parameters=truth
    )
    wrong = outcome(
        "single", ["creep"], report("effect", "hidden_bend", parameters=estimates), parameters={"ratio": 0.1}
    )
    errors, held = scores.parameters([right, wrong])
    assert errors == pytest.approx([0.1, 0.05])
    assert held == [True, False]
    position, angle = scores.bends([right, wrong])
    assert (position, angle) == (pytest.approx([0.02]), pytest.approx([0.1]))


def test_the_bound_of_no_alarm_in_149_is_two_per_cent():
    assert scores.upper_bound(0, 149) == pytest.approx(1.0 - 0.05 ** (1.0 / 149.0))
    assert scores.upper_bound(0, 149) < 0.02 < scores.upper_bound(0, 148)
    assert scores.upper_bound(3, 3) == 1.0


def test_the_limit_of_detection_breaks_off_at_the_first_size_that_fails():
    assert discovery.detection_limit({1.0: 1.0, 0.5: 0.9, 0.25: 0.5}) == 0.5
    assert discovery.detection_limit({1.0: 0.5, 0.5: 1.0, 0.25: 1.0}) == math.inf
    assert discovery.detection_limit({1.0: 1.0, 0.5: math.nan, 0.25: 1.0}) == 1.0


def test_tables_say_what_was_reached_and_what_was_not_measured():
    perfect = report("effect", "creep", parameters={"ratio": (0.06, 0.05, 0.07)})
    outcomes = [
        outcome(
            "single",
            ["creep"],
            perfect,
            parameters={"ratio": 0.06},
            baselines={"peer": Baseline("creep", 0.4)},
        ),
        outcome("clean", [], report("none")),
        outcome("outside", ["bent_load_cell"], report("effect", "creep")),
        outcome("half", ["creep"], None, failure="exit 2: no such command"),
    ]
    rows = {row.metric: row for row in target_rows(outcomes)}
    assert rows["right name first, typical size"].kept
    assert not rows["outside the library: unknown"].kept
    assert rows["false alarms, clean"].text == "0 % (0 of 1), below 95 %"
    assert math.isnan(rows["both names of a pair"].value)
    table_text = targets(outcomes, markdown=False)
    assert "NO" in table_text
    assert "bent_load_cell  creep 1" in confusions(outcomes, markdown=False)
    assert limits(outcomes, markdown=False).splitlines()[-1].split() == ["creep", "100", "0", "—", "1.0"]
    assert "peer" in peers(outcomes, markdown=False)
    assert "1 of 4 campaigns have no report" in failures(outcomes)
    assert failures(outcomes[:3]) == ""


def test_every_cause_is_made_in_every_size_and_seeds_differ():
    made = cases((), 2, "development", quick=False)
    assert len(set(made)) == len(made)
    assert {case.effects[0] for case in made if case.group == "quarter"} == set(INSIDE)
    assert {case.effects[0] for case in made if case.group == "outside"} == set(OUTSIDE)
    only = cases(("clean", "creep"), 1, "test", quick=False)
    assert {case.effects for case in only} == {(), ("creep",)}
    assert Case("single", ("creep",), 1.0, "full", 0, "test") in only


def test_a_workflow_without_a_report_is_listed_with_its_message(tmp_path):
    report, said = discovered(tmp_path / "nothing here", tmp_path / "out")
    assert report is None
    assert said.startswith("exit 2")


def test_a_name_that_is_no_cause_is_refused(capsys):
    assert discovery.main(["--effects", "gremlins"]) == 2
    assert "gremlins" in capsys.readouterr().out


def test_noise_in_a_dwell_turns_nothing_and_turns_of_the_drive_stay():
    course = np.interp(np.arange(200.0), [0, 20, 60, 120, 180, 200], [0, 0, 1e-3, 1e-3, 2e-4, 6e-4])
    noisy = course + 1e-6 * np.random.default_rng(1).standard_normal(200)
    quiet = without_flicker(noisy, 8e-6)
    assert np.sum(np.diff(np.sign(np.diff(quiet)[np.diff(quiet) != 0.0])) != 0) == 2
    assert np.abs(quiet - course).max() < 4e-6  # four times the noise


def test_a_peer_that_knows_the_residual_leaves_no_misfit():
    left = {"tension_in_N": np.full(50, 5.0)}
    runs = [Residual(held, {}, {}, left) for held in (False, True)]
    assert held_out_ratio(runs, [left, left]) == 0.0
    nothing = {"tension_in_N": np.zeros(50)}
    assert held_out_ratio(runs, [nothing, nothing]) == pytest.approx(1.0)
