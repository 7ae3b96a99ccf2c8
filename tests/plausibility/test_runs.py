"""Spoilt runs are refused or warned about by the right rule, and sound runs of many rigs are not refused."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from tests.campaigns.causes import INSIDE
from tests.campaigns.make import PLANS, make_campaign
from tests.plausibility.spoilt import ON_ANY, SAMPLES, Bench, by_position, by_tension
from tssgeom.io.formats.campaigns import read_campaign
from tssgeom.plausibility.kinds import Remark
from tssgeom.plausibility.machine_rules import MACHINE_RULES
from tssgeom.plausibility.rules import RULES
from tssgeom.plausibility.runs import run_remarks

BENCHES = {"by_position": by_position(), "by_tension": by_tension()}
TOOL = Path(__file__).resolve().parents[3] / "shared" / "data" / "davinci_tool"


def remarks(bench: Bench, columns) -> list[Remark]:
    return run_remarks(columns, bench.rig, length=bench.length, angle=bench.angle)


@pytest.mark.parametrize("bench", BENCHES)
@pytest.mark.parametrize("spoilt", ON_ANY)
def test_a_spoilt_run_is_named_by_its_rule(bench, spoilt):
    change, rules = ON_ANY[spoilt]
    broken = {each.rule for each in remarks(BENCHES[bench], change(BENCHES[bench].columns))}
    assert rules & broken


def test_seventy_runs_or_more_are_spoilt_in_ways_that_break_most_rules_on_runs():
    assert len(BENCHES) * len(ON_ANY) >= 70
    on_runs = {name for name, rule in RULES.items() if "run" in rule.severity}
    covered = set().union(*(rules for _, rules in ON_ANY.values()))
    assert covered <= on_runs
    assert on_runs - covered == {
        "beyond_law",  # its test stands in test_rules.py
        "high_strain",
        "beyond_scale",
        "stretch_size",
        "inconsistent_stretch",
        "missing",
        *MACHINE_RULES,  # their tests stand in test_machines.py
    }


@pytest.mark.parametrize("bench", BENCHES)
def test_the_sound_runs_break_no_rule(bench):
    assert remarks(BENCHES[bench], BENCHES[bench].columns) == []


def test_rules_that_need_a_run_of_their_own_name_it():
    bench = BENCHES["by_tension"]
    for change, rule in (
        ({"tension_in_N": 30.0 * bench.columns["tension_in_N"]}, "high_strain"),
        ({"elongation_m": 12.0 * bench.columns["elongation_m"]}, "stretch_size"),
        ({"displacement_out_m": 3.0 * bench.columns["displacement_out_m"]}, "inconsistent_stretch"),
        (
            {"tension_out_N": np.where(np.arange(901) == 40, np.nan, bench.columns["tension_out_N"])},
            "missing",
        ),
    ):
        assert rule in {each.rule for each in remarks(bench, bench.columns | change)}
    sample = BENCHES["by_position"]
    above = sample.columns | {"tension_in_N": 2.2 * sample.columns["tension_in_N"]}
    assert "beyond_scale" in {each.rule for each in remarks(sample, above)}


def of_campaigns(folders) -> tuple[int, Counter[str]]:
    """Count the runs of campaigns, and the rules that they break."""
    runs, broken = 0, Counter[str]()
    for folder in folders:
        campaign = read_campaign(folder)  # raises where a run is refused
        for run in campaign.runs:
            arcs = run.route.arcs
            known = {"length": arcs.total_length, "angle": arcs.total_angle}
            runs += 1
            broken.update(each.rule for each in run_remarks(run.columns, campaign.rig, **known))
    return runs, broken


def test_no_run_of_the_samples_breaks_a_rule():
    assert of_campaigns(sorted(SAMPLES.glob("campaign_*"))) == (20, Counter())


def test_of_ninety_simulated_runs_with_every_effect_none_is_refused_and_few_break_a_rule(tmp_path):
    chosen = list(INSIDE)[::2]
    for seed, effect in enumerate(chosen):
        make_campaign(tmp_path / effect, seed, effect)
    for plan in PLANS:
        make_campaign(tmp_path / plan, 77, None, plan=plan)
    runs, broken = of_campaigns(tmp_path / name for name in (*chosen, *PLANS))
    assert runs >= 90
    # At a turn noise passes for a lag in some; a cell whose zero is off is named as such.
    assert set(broken) <= {"lag", "zero_at_rest"}
    assert sum(broken.values()) <= 0.05 * runs


@pytest.mark.skipif(not TOOL.is_dir(), reason="the measured tool is not beside this copy")
def test_a_measured_tool_is_not_refused(tmp_path):
    from tests.measured import write_tool_campaign

    for load in (1, 2, 3, 4):
        write_tool_campaign(tmp_path / str(load), load)
    runs, broken = of_campaigns(tmp_path / str(load) for load in (1, 2, 3, 4))
    assert runs == 12
    assert sum(broken.values()) <= 8
