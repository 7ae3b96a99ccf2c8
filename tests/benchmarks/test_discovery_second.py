"""The count on the second generator, on reports written by hand."""

import math

import numpy as np
import pytest

from benchmarks import discovery
from benchmarks import discovery_scores as scores
from benchmarks.discovery_campaigns import second_cases as cases
from benchmarks.discovery_scores import (
    Outcome,
    law_held,
    mechanism,
    right_formula,
    right_mechanism,
)
from tests.bristle import CAUSES, MECHANISMS, PAIR_CAUSES
from tssgeom.effects import KINDS
from tssgeom.identify.machine_parts import MEANINGS
from tssgeom.identify.mechanism_names import MECHANISM_OF

X = np.linspace(0.0, 0.04, 30)
FALLING = 1.0 + 0.25 * np.exp(-X / 4e-3)


def outcome(report, kind="friction_over_speed", formula=None, law=None, group="single"):
    truth = {"mechanism": kind, "formula": formula, "known": formula is not None, "law": law}
    return Outcome(group, truth | {"cause": "one", "size": 1.0, "effects": ("one",), "seed": 0}, report, 5.0)


def report(verdict, *effects, tie=()):
    rms = {"held_out": {"tension_in_N": 0.1}}
    noise = {"noise": {"tension_in_N": 0.02}, "before": rms, "after": rms}
    return {"verdict": verdict, "effects": list(effects), "tie": [list(names) for names in tie], "gap": noise}


def law(value, half):
    return {"x": X.tolist(), "value": value.tolist(), "unit": "1"} | {
        "lo": (value - half).tolist(),
        "hi": (value + half).tolist(),
    }


def test_every_effect_of_the_library_and_number_of_a_machine_has_a_mechanism():
    assert set(KINDS) | set(MEANINGS) == set(MECHANISM_OF)
    formulae = {cause.formula for cause in CAUSES.values()} - {None}
    assert formulae <= set(MECHANISM_OF)
    assert {"play_in_joint", "friction_in_joint"} < {kind for kind, _ in PAIR_CAUSES.values()}
    assert {MECHANISM_OF["end_play"], MECHANISM_OF["joint_friction"]} == {
        "play_in_joint",
        "friction_in_joint",
    }
    for cause in CAUSES.values():
        assert cause.mechanism in MECHANISMS
        assert cause.formula is None or MECHANISM_OF[cause.formula] == cause.mechanism


def test_the_mechanism_is_that_of_the_report_or_else_of_the_name():
    assert mechanism({"name": "viscous_drag"}) == "friction_over_speed"
    assert mechanism({"name": "friction_law", "mechanism": "friction_over_time"}) == "friction_over_time"
    assert mechanism({"name": "no such name"}) == ""


def test_only_a_verdict_that_names_counts():
    drag = {"name": "viscous_drag"}
    assert right_mechanism(outcome(report("effect", drag)))
    assert right_mechanism(outcome(report("law", {"name": "x", "mechanism": "friction_over_speed"})))
    assert not right_mechanism(outcome(report("unknown", drag)))
    assert not right_mechanism(outcome(None))
    assert not right_mechanism(outcome(report("none"), kind=""))
    assert right_formula(outcome(report("effect", {"name": "backlash"}), formula="backlash"))
    assert not right_formula(outcome(report("effect", drag), formula="backlash"))


def test_a_tie_counts_where_it_holds_the_first_name_and_the_mechanism():
    tied = report("tie", {"name": "toe_region"}, tie=[("toe_region", "slack_take_up")])
    assert scores.mechanism_or_tied(outcome(tied, kind="stretch_at_end"))
    assert not scores.mechanism_or_tied(outcome(tied, kind="preload"))


def test_a_band_holds_a_law_up_to_what_the_base_model_may_take():
    true = {"over": "speed", "x": X.tolist(), "value": FALLING.tolist(), "unit": "1"}
    named = {"name": "friction_law", "mechanism": "friction_over_speed"}
    scaled = named | {"law": law(0.9 * FALLING, 0.01)}
    assert law_held(outcome(report("law", scaled), law=true)) == 1.0
    flat = named | {"law": law(np.ones(len(X)), 0.01)}
    assert law_held(outcome(report("law", flat), law=true)) < 0.5
    assert math.isnan(law_held(outcome(report("law", named), law=true)))
    metres = named | {"law": law(FALLING, 0.01) | {"unit": "m"}}
    assert law_held(outcome(report("law", metres), law=true)) == 0.0


def test_zero_and_slope_of_a_cell_are_free_and_its_bow_is_not():
    bow = 0.3 * (X / 0.04) * (1.0 - X / 0.04)
    true = {"over": "tension_in", "x": X.tolist(), "value": bow.tolist(), "unit": "1"}
    named = {"name": "x", "mechanism": "sensor_curve", "law": law(bow + 0.2 - 3.0 * X, 0.005)}
    assert law_held(outcome(report("law", named), kind="sensor_curve", law=true)) == 1.0
    straight = named | {"law": law(0.0 * X, 0.005)}
    assert law_held(outcome(report("law", straight), kind="sensor_curve", law=true)) < 0.5


def test_every_cause_is_made_in_both_sizes_and_seeds_differ():
    made = cases((), 2, "development", quick=False)
    assert len(set(made)) == len(made)
    assert {case.effects[0] for case in made if case.group == "half"} == set(CAUSES)
    assert {case.effects[0] for case in made if case.group == "machine"} == set(PAIR_CAUSES)
    assert {case.effects for case in cases(("clean", "wear"), 1, "test", quick=False)} == {(), ("wear",)}


def test_tables_say_what_was_named_and_what_the_law_was_worth():
    true = {"over": "speed", "x": X.tolist(), "value": FALLING.tolist(), "unit": "1"}
    named = {"name": "friction_law", "mechanism": "friction_over_speed", "law": law(FALLING, 0.01)}
    outcomes = [
        outcome(report("law", named), law=true),
        outcome(report("effect", {"name": "backlash"}), kind="play_at_drive", formula="backlash"),
        outcome(report("effect", {"name": "backlash"}), kind="", group="clean"),
    ]
    text = scores.printed_by_mechanism(outcomes, markdown=False)
    assert "law: friction_law 1" in text
    assert "100 % (2 of 2)" in text
    assert "100 % (1 of 1), below 100 %" in text


def test_the_peers_read_no_file_of_the_second_generator():
    with pytest.raises(SystemExit):
        discovery.main(["--generator", "second", "--baselines"])
