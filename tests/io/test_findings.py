"""report.json and rig.updated.toml: every promised key, finite numbers, and a rig that reads back."""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.worked_finding import BEND, CHANNELS, without_held_out, worked_finding
from tssgeom.io.results.findings import report_object, write_report, write_updated_rig
from tssgeom.rig import read_rig

VERDICTS = ("none", "effect", "tie", "unknown")
PROMISED = {
    "verdict",
    "effects",
    "tie",
    "breaks_tie",
    "unobservable",
    "where",
    "gap",
    "base",
    "ranking",
    "rig",
}


def read(tmp_path: Path, verdict: str) -> dict[str, Any]:
    return json.loads(write_report(tmp_path, worked_finding(verdict), "1.2.3").read_text("utf-8"))


@pytest.mark.parametrize("verdict", VERDICTS)
def test_every_promised_key_is_there_for_every_verdict(tmp_path, verdict):
    report = read(tmp_path, verdict)
    assert report.keys() >= PROMISED
    assert (report["verdict"], report["rig"]) == (verdict, "rig.updated.toml")
    assert bool(report["effects"]) == (verdict in ("effect", "tie"))
    assert bool(report["tie"]) == bool(report["breaks_tie"]) == (verdict == "tie")


def test_an_effect_has_parameters_with_intervals_and_evidence(tmp_path):
    (effect,) = read(tmp_path, "effect")["effects"]
    assert effect["name"] == "hidden_bend"
    assert effect["parameters"]["angle_rad"] == {"value": 0.598, "unit": "rad", "ci95": [0.571, 0.627]}
    assert effect["evidence"] == {
        "delta_bic": 412.3,
        "held_out_fall": 0.0,
        "threshold": 41.5,
        "size_over_guard": 6.2,
        "heldout_ratio": 0.11,
    }


def test_misfits_are_listed_by_runs_and_channel(tmp_path):
    gap = read(tmp_path, "effect")["gap"]
    assert gap["noise"].keys() == set(CHANNELS)
    for when in ("before", "after"):
        assert gap[when].keys() == {"fitted", "held_out"}
        assert gap[when]["held_out"].keys() == set(CHANNELS)
    assert gap["after"]["held_out"]["tension_out_N"] < gap["before"]["held_out"]["tension_out_N"]


def numbers(value: Any) -> Iterator[float]:
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        for item in value:
            yield from numbers(item)
    elif isinstance(value, float):
        yield value


def test_what_is_not_known_is_null_and_every_number_finite(tmp_path):
    report = read(tmp_path, "effect")
    assert all(math.isfinite(number) for number in numbers(report))
    assert report["effects"][0]["parameters"]["width_m"]["ci95"] == [None, None]
    assert report["ranking"][1]["evidence"]["heldout_ratio"] is None


def test_where_says_channel_phase_run_and_ranges(tmp_path):
    first, second = read(tmp_path, "effect")["where"]
    assert first == {
        "channel": "tension_out_N",
        "phase": "pull",
        "run": "half_slow",
        "tension_range_N": [8.0, 16.0],
        "route_range_m": [0.19, 0.23],
        "share": 0.41,
    }
    assert second["route_range_m"] is None


def test_the_ranking_says_of_each_why_it_was_passed_over():
    ranking = report_object(worked_finding(), "1.2.3")["ranking"]
    assert ranking[0]["name"] == "hidden_bend"
    assert [bool(each["why_not"]) for each in ranking] == [False, True, True]


def test_the_updated_rig_reads_back_with_the_identified_effect(tmp_path):
    finding = worked_finding()
    path = write_updated_rig(tmp_path, finding, "1.2.3")
    rig = read_rig(path)
    assert rig == finding.rig
    assert rig.effects == (BEND,)
    comments = [line for line in path.read_text("utf-8").splitlines() if line.startswith("#")]
    assert "tssgeom 1.2.3 discover from the campaign campaign_hidden_bend" in comments[0]
    assert finding.sentence in comments[1]
    assert any("friction: 0.145 → 0.1491" in line for line in comments)
    before, after = (
        getattr(finding.misfit, when)["held_out"]["tension_out_N"] for when in ("before", "after")
    )
    assert any(f"tension_out_N: {before:.3g} → {after:.3g} (0.02)" in line for line in comments)


def test_without_held_out_runs_the_rig_states_the_misfit_of_the_fitted_ones(tmp_path):
    text = write_updated_rig(tmp_path, without_held_out(worked_finding()), "1.2.3").read_text("utf-8")
    assert "on the runs that were fitted" in text


def test_a_report_gives_way_only_when_the_new_one_is_whole(tmp_path):
    (tmp_path / "report.json").write_text("old")
    write_report(tmp_path, worked_finding(), "1.2.3")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["report.json"]
    assert json.loads((tmp_path / "report.json").read_text("utf-8"))["version"] == "1.2.3"
