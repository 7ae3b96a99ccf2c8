"""The workflow on campaigns whose cause it does not know: names, pairs, none, unknown, what does not show."""

import re

import numpy as np
import pytest

from tssgeom.identify.finding import PHASES
from tssgeom.identify.misfit import beyond_noise
from tssgeom.identify.workflow import discover
from tssgeom.rig import Rig


def test_a_clean_campaign_lacks_no_effect_and_reports_the_refit_beside_the_nominal(result, campaign):
    finding, truth = result(4), campaign(4)[1]
    assert finding.verdict == "none"
    assert finding.effects == ()
    assert (
        finding.base["compliance_per_N"].low < truth.compliance_per_N < finding.base["compliance_per_N"].high
    )
    assert finding.rig.friction.coefficient == finding.base["friction"].value != finding.nominal["friction"]
    assert "No effect is missing" in finding.sentence


@pytest.mark.parametrize(("seed", "name"), [(1, "load_cell_crosstalk"), (0, "hidden_bend")])
def test_a_cause_of_half_its_usual_size_is_named_with_its_numbers(result, campaign, seed, name):
    finding, truth = result(seed, name, 0.5), campaign(seed, name, 0.5)[1]
    assert [one.names for one in finding.effects] == [(name,)]
    for key, value in truth.parameters[name].items():
        reported = finding.effects[0].parameters[0][key]
        assert reported.value == pytest.approx(value, rel=0.15)  # three standard errors at this size
    assert finding.rig.effects == finding.effects[0].effects
    assert finding.ranking[0].names == (name,)
    assert not re.search(r"_(m|rad|N|s)\b", finding.sentence)  # units stand beside numbers, not in names
    assert all(one.why_not for one in finding.ranking[1:])


def test_the_misfit_of_the_held_out_run_falls_with_the_cause_in_the_model(result):
    reported = result(0, "hidden_bend", 0.5).misfit
    before, after = (
        beyond_noise(side["held_out"], reported.noise) for side in (reported.before, reported.after)
    )
    assert before > 0.5
    assert after < 0.35 * before  # the project's target


@pytest.mark.parametrize(("plan", "name"), [("round_turns", "slack_take_up"), ("force_driven", "backlash")])
def test_a_cause_is_named_whatever_the_drive(result, campaign, plan, name):
    finding, truth = result(0, name, 1.0, plan), campaign(0, name, 1.0, plan)[1]
    assert [one.names for one in finding.effects] == [(name,)]
    for key, value in truth.parameters[name].items():
        assert finding.effects[0].parameters[0][key].value == pytest.approx(value, rel=0.1)


@pytest.mark.parametrize("seed", [0, 1])  # with x_out, and with a measured elongation
def test_a_late_recorder_of_all_distal_channels_is_separated_from_a_lag_of_one(result, campaign, seed):
    for name, rel in (("late_recorder", 0.01), ("channel_lag", 0.03)):
        finding, truth = result(seed, name), campaign(seed, name)[1]
        (one,) = finding.effects
        assert one.effects[0].channel == truth.parameters[name]["channel"]
        assert one.parameters[0]["lag_s"].value == pytest.approx(truth.parameters[name]["lag_s"], rel=rel)
        assert finding.rig.friction.coefficient == pytest.approx(truth.friction, rel=0.02)


def test_both_of_a_pair_are_named(result):
    pair = ("creep", "tension_out_offset")
    assert {one.names[0] for one in result(0, pair).effects} == {*pair}


def test_a_cause_that_no_effect_explains_is_unknown_and_its_shape_is_reported(result):
    finding = result(0, "slipping_encoder")
    assert finding.verdict == "unknown"
    assert finding.effects == ()
    assert finding.rig.effects == ()
    assert {"tension_N", "cycle", "s_m"} <= {shape.over for shape in finding.missing_shapes}


def test_friction_that_is_uneven_along_the_sheath_is_learnt(result, campaign):
    finding, truth = result(1, "rough_stretch"), campaign(1, "rough_stretch")[1]
    assert finding.verdict == "law"
    (one,) = finding.effects
    assert one.names == ("friction_over_arc_length",)
    assert one.law is not None
    assert one.law.over == "arc_length_m"
    rough = truth.friction * (1.0 + truth.parameters["rough_stretch"]["gain"])
    assert one.law.value.max() == pytest.approx(rough, rel=0.12)  # the edges of the stretch are smoothed
    assert one.law.value[:8].mean() == pytest.approx(truth.friction, rel=0.03)
    assert one.law.value[:8] == pytest.approx(truth.friction, rel=0.1)  # twelve knots, of 5 % each
    held = np.mean((one.law.low[:8] <= truth.friction) & (truth.friction <= one.law.high[:8]))
    assert held == 1.0
    before, after = (
        beyond_noise(side["held_out"], finding.misfit.noise)
        for side in (finding.misfit.before, finding.misfit.after)
    )
    assert after < 0.35 * before
    assert one.evidence.heldout_ratio == pytest.approx(after / before, abs=0.1)  # that of the drive as fitted
    assert finding.rig.effects == one.effects
    assert "no formula of the library" in finding.sentence
    assert "closes" in finding.sentence


def test_a_sensor_that_is_no_straight_line_is_learnt(result):
    finding = result(1, "bent_load_cell")
    assert finding.verdict == "law"
    (one,) = finding.effects
    assert (one.names, one.effects[0].channel) == (("sensor_curve",), "tension_in_N")


def test_what_was_not_measured_is_said_to_show_nothing(result):
    finding = result(0, "tension_out_offset", 1.0, "no_tension_out")
    assert finding.verdict == "none"
    assert {"tension_out_offset", "tension_out_gain", "load_cell_crosstalk"} <= finding.unobservable.keys()


def test_the_same_seed_gives_the_same_answer_and_progress_grows(campaign):
    reported = []
    runs = campaign(4)[0]
    first = discover(runs, seed=3, progress=lambda step, share: reported.append(share))
    again = discover(runs, seed=3)
    assert reported == sorted(reported)
    assert reported[-1] == 1.0
    assert [one.evidence for one in first.ranking] == [one.evidence for one in again.ranking] or all(
        a.names == b.names and a.evidence.delta_bic == b.evidence.delta_bic
        for a, b in zip(first.ranking, again.ranking, strict=True)
    )
    assert first.sentence == again.sentence


def test_traces_hold_every_run_with_its_phases_and_the_tension_along_the_route(result, campaign):
    finding, runs = result(4), campaign(4)[0].runs
    assert [trace.run for trace in finding.traces] == [run.name for run in runs]
    for trace, run in zip(finding.traces, runs, strict=True):
        assert trace.tension.shape == (len(trace.time), len(run.route.s))
        assert np.allclose(trace.tension[:, 0], trace.tension_in, atol=1e-9)  # rounding
        assert set(np.unique(trace.phase)) <= set(range(len(PHASES)))
    assert finding.heat.power.shape == (len(finding.heat.rows), len(finding.heat.columns))
    assert isinstance(finding.rig, Rig)


def test_threads_do_not_wait_for_each_other_over_small_matrices(campaign, library_threads):
    assert library_threads(lambda progress: discover(campaign(4)[0], progress=progress)) == {1}
