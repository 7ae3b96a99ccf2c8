"""Designed experiments: what is left to separate, limits, and what is expected beside what comes true."""

from dataclasses import replace
from functools import partial

import msgspec
import numpy as np
import pytest
from scipy.optimize import minimize

from tssgeom.errors import SettingsError
from tssgeom.identify import workflow
from tssgeom.identify.candidate_models import BASE, left_by
from tssgeom.identify.expected_evidence import (
    expected_delta_bic,
    information_of,
    linear,
    predicted,
    size_over_limits,
)
from tssgeom.identify.experiment_design import proposed
from tssgeom.identify.experiment_search import EFFORT
from tssgeom.identify.fit import Problem, refined
from tssgeom.identify.prediction import run_channels, stacked
from tssgeom.identify.proposal import Asked
from tssgeom.identify.proposal_words import amount
from tssgeom.identify.readings import readings
from tssgeom.identify.run_limits import limits_of
from tssgeom.identify.screening import size_over_limit
from tssgeom.identify.ties import MENU, MOST_REPORTED
from tssgeom.mechanism import Drive, DriveLimits


@pytest.fixture(scope="module")
def worked(campaign):
    """A campaign at one rate with viscous drag (G5), and what the steps of the workflow leave of it."""
    runs = campaign(0, "viscous_drag", 1.0, "one_rate")[0]
    started = workflow._started(runs, None)
    return runs, started, workflow._worked(runs, started, 0)


@pytest.fixture(scope="module")
def proposal(worked):
    runs, started, work = worked
    return proposed(work, started.runs, runs.rig, Asked(1, {"speed_mm_per_s": 3.0}), 0)


def test_drag_that_one_rate_hides_is_left_beside_the_base_model(worked):
    left = left_by(worked[2])
    assert left.models[0].name == BASE
    assert not left.models[0].may_be_true
    assert "viscous_drag" in [model.name for model in left.models[1:]]


def test_expected_evidence_is_what_a_refit_of_the_measured_run_gives(worked):
    """The run is made by the model with drag, without noise, and base is refitted to old and new runs."""
    runs, started, work = worked
    left = left_by(work)
    drag = next(k for k, model in enumerate(left.models) if model.name == "viscous_drag")
    models = (left.models[0], left.models[drag])
    slower = MENU[1].changed(started.runs[0])
    run = linear(predicted(slower, runs.rig, models), models)
    added = information_of(run, models)
    expected = expected_delta_bic(added, models)[1, 0]
    channels = run_channels(slower, models[1].at.rig(runs.rig), models[1].at.effects)
    made = replace(slower, measured={name: channels[name] for name in slower.measured})
    own = stacked([made])
    new = Problem(own, run.problem.whitening, runs.rig, own.measured)
    problem = work.chosen.problem

    def off(at):
        """Return both residuals, old and new, whitened."""
        old = problem.whitening.whitened(problem.left(at))
        return np.concatenate([old, new.whitening.whitened(new.left(at))])

    start = models[0].at
    best = minimize(lambda by: float(np.sum(off(start.moved(by)) ** 2)), np.zeros(2), method="Nelder-Mead")
    assert 10.0 < expected < MOST_REPORTED
    assert expected == pytest.approx(best.fun - refined(problem, start).chi2, rel=0.1)  # straight lines
    change = new.left(start.moved(best.x))
    size = size_over_limits(added, models, (1, 0), left.limits)
    assert size == pytest.approx(size_over_limit(own, change, left.limits), rel=0.1)


def test_the_proposed_run_keeps_its_limits_and_is_worth_more_than_the_menu(worked, proposal):
    runs, started, work = worked
    (run,) = proposal.runs
    limits = limits_of(started.runs, runs.rig, work.base.at, {"speed_mm_per_s": 3.0})
    assert proposal.stated == ("speed_mm_per_s",)
    assert proposal.limits == limits.values
    assert 1e3 * np.abs(np.diff(run.values[:, 0]) / np.diff(run.time)).max() <= 3.0 * EFFORT.over
    assert run.time[-1] <= limits.duration_s
    for channels in run.channels.values():
        assert channels["tension_in_N"].max() <= EFFORT.over * limits.tension_N
    gain = next(each.delta_bic for each in run.expected if (each.true, each.other) == ("viscous_drag", BASE))
    assert gain > left_by(work).needed
    assert any("for viscous drag" in words for words in run.outcomes), run.outcomes
    assert set(run.differences) == set(proposal.candidates[1:])


def test_the_same_seed_proposes_the_same_run(worked, proposal):
    runs, started, work = worked
    again = proposed(work, started.runs, runs.rig, Asked(1, {"speed_mm_per_s": 3.0}), 0)
    np.testing.assert_array_equal(again.runs[0].values, proposal.runs[0].values)


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"tension_N": 2.0}, "tension_N=2 is not above the pretension"),
        ({"least_tension_N": 12.0}, "above the pretension"),
        ({"duration_s": 0.01}, "duration_s=0.01 is less than 20 samples"),
        ({"travel_mm": 1e-6}, "forbid every run"),
        ({"speed_mm_per_s": 1e-6}, "forbid every run"),
        ({"current_A": 2.0}, "known are tension_N"),
        ({"travel_mm": -1.0}, "give a finite value > 0"),
    ],
)
def test_limits_that_forbid_everything_are_refused_with_what_to_allow(worked, limits, words):
    runs, started, work = worked
    with pytest.raises(SettingsError, match=words):
        proposed(work, started.runs, runs.rig, Asked(1, limits), 0)


def test_proposed_runs_keep_to_the_limits_of_the_drive(worked):
    runs, started, work = worked
    free = limits_of(started.runs, runs.rig, work.base.at, {})
    drive = DriveLimits(
        tension_N=0.9 * free.tension_N, displacement_m=(0.0, 1.0), speed_m_per_s=0.5e-3 * free.speed_mm_per_s
    )
    rig = msgspec.structs.replace(runs.rig, drive=Drive(limits=drive))
    kept = limits_of(started.runs, rig, work.base.at, {})
    assert kept.tension_N == pytest.approx(0.9 * free.tension_N)
    assert kept.speed_mm_per_s == pytest.approx(0.5 * free.speed_mm_per_s)
    assert kept.travel_mm == free.travel_mm
    with pytest.raises(SettingsError, match=r"--limits tension_N=.* is beyond drive\.limits"):
        limits_of(started.runs, rig, work.base.at, {"tension_N": free.tension_N})


def test_where_nothing_is_left_an_interval_is_narrowed(campaign):
    runs = campaign(4)[0]
    finding = workflow.discover(runs, propose=Asked(1, {}))
    proposal = finding.proposal
    assert proposal is not None
    assert "Nothing is left to separate" in proposal.sentence
    assert proposal.narrowed is not None
    assert 0.0 < proposal.narrowed.expected < proposal.narrowed.half_width
    assert proposal.runs[0].expected == ()


def test_held_out_runs_stay_when_runs_are_read_as_decided(campaign):
    runs = campaign(4)[0]
    free = replace(runs, runs=tuple(replace(run, held_out=False) for run in runs.runs))
    fixed = replace(free, held_out_fixed=True)
    held = partial(lambda one: [run.held_out for run in readings(one)[0]])
    assert sum(held(free)) == 1
    assert sum(held(fixed)) == 0


def test_of_the_gains_over_several_models_the_least_is_stated():
    assert amount({1: 300.0, 2: 12.4}) == "12 or more"
    assert amount({1: 2000.0, 2: 3000.0}) == "more than 1000"
