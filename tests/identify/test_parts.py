"""Parts of the workflow: readings, error model, thresholds, corners of the drive."""

from dataclasses import replace

import numpy as np
import pytest

from tssgeom.effects import KINDS, with_size
from tssgeom.errors import SettingsError
from tssgeom.identify.drive import calmed, turning_points, with_corners
from tssgeom.identify.fit import base_fit
from tssgeom.identify.law_fit import LawFit
from tssgeom.identify.prediction import stacked
from tssgeom.identify.readings import reading_noise, readings
from tssgeom.identify.screening import screening, threshold, variants
from tssgeom.identify.ties import MENU
from tssgeom.identify.verdict import judged_laws


@pytest.fixture(scope="module")
def fitted(campaign):
    runs, _ = readings(campaign(4)[0])
    return base_fit([run for run in runs if not run.held_out], campaign(4)[0].rig)


def without(campaign, *columns):
    runs = tuple(
        replace(run, columns={k: v for k, v in run.columns.items() if k not in columns})
        for run in campaign.runs
    )
    return replace(campaign, runs=runs)


def test_whitened_residuals_are_the_likelihood_with_shared_errors_integrated_out(fitted):
    problem, errors, fit = fitted
    rows = np.arange(0, problem.stack.size, 9)
    modes, left = errors.modes[rows], (fit.left / errors.sigma)[rows]
    covariance = np.eye(len(rows)) + modes @ modes.T
    basis, _ = np.linalg.qr(np.vstack([modes, np.eye(modes.shape[1])]))
    stacked_left = np.concatenate([left, np.zeros(modes.shape[1])])
    projected = stacked_left - basis @ (basis.T @ stacked_left)
    assert projected @ projected == pytest.approx(
        left @ np.linalg.solve(covariance, left), rel=1e-9
    )  # rounding
    whole = problem.whitening.whitened(fit.left)
    assert np.sum(whole**2) == pytest.approx(np.sum(fit.residual**2), rel=1e-12)  # rounding


def test_a_clean_campaign_leaves_white_noise(fitted):
    problem, _, fit = fitted
    assert fit.chi2 / problem.stack.size == pytest.approx(1.0, abs=0.1)  # 3600 readings: 0.024; cells differ
    white = fit.residual[: problem.stack.size]
    for block in problem.stack.blocks:
        part = white[block.rows]
        assert abs(np.corrcoef(part[1:], part[:-1])[0, 1]) < 0.25  # four standard errors of 300 readings


def test_the_threshold_is_that_of_its_seed_and_no_lower_than_ten(fitted):
    problem, errors, fit = fitted
    view = screening(problem, fit, variants(problem.stack)[0])
    reported = [threshold(problem, errors, view, seed) for seed in (1, 1, 2)]
    assert reported[0] == reported[1]
    assert min(reported) >= 10.0


def test_a_lag_is_tried_of_each_channel_that_answers_and_not_of_the_drive(fitted):
    (reading, *_) = fitted[0].stack.readings
    lags = [each.effect.channel for each in variants(stacked([reading]))[0] if each.name == "channel_lag"]
    assert sorted(lags) == sorted(({*reading.measured} - {reading.drive}) | {"distal"})
    alone = {
        name: each for name, each in reading.measured.items() if name in ("tension_in_N", "tension_out_N")
    }
    tried = variants(stacked([replace(reading, measured=alone)]))[0]
    assert "distal" not in {each.effect.channel for each in tried if each.name == "channel_lag"}


@pytest.mark.parametrize(("noise", "verdict"), [(1.0, "effect"), (3.0, "partial")])
def test_formulae_that_leave_more_than_the_noise_are_a_part_of_what_is_missing(fitted, noise, verdict):
    problem, _, fit = fitted
    at = replace(fit.at, effects=(with_size(KINDS["backlash"]),))
    rest = (fit.residual, fit.jacobian, np.eye(at.size))
    judged = judged_laws(
        problem, replace(fit, left=1e3 * fit.left), LawFit(at, (), 0.0, 0.0, noise * fit.left, *rest), None
    )
    assert judged.verdict == verdict
    assert bool(judged.reason) == (noise > 1.0)


def test_where_no_run_is_held_out_the_one_alone_on_its_route_is(campaign):
    runs = campaign(4)[0].runs
    plain = replace(campaign(4)[0], runs=tuple(replace(run, held_out=False) for run in runs))
    chosen, notes = readings(plain)
    assert [run.held_out for run in chosen] == [False] * 4 + [True]
    assert any("held out before anything was fitted" in note for note in notes)


def test_dropouts_and_saturation_are_left_out_and_noted(campaign):
    runs = campaign(4)[0].runs
    columns = {name: np.array(column) for name, column in runs[0].columns.items()}
    columns["displacement_in_m"][50:55] = np.nan
    columns["tension_out_N"][100:103] = 30.0
    marred = replace(campaign(4)[0], runs=(replace(runs[0], columns=columns), *runs[1:]))
    read, notes = readings(marred)
    before = readings(campaign(4)[0])[0]
    lost = stacked(before[:1]).size - stacked(read[:1]).size
    assert lost == 3 * 5 + 3
    assert any("5 of 300 samples" in note for note in notes)
    assert any("end of the scale" in note for note in notes)


@pytest.mark.parametrize(
    ("gone", "reason"),
    [
        (("displacement_in_m", "tension_in_N"), "no drive in common"),
        (("tension_in_N", "tension_out_N", "displacement_out_m", "elongation_m"), "nothing answers"),
    ],
)
def test_what_cannot_be_used_is_refused_with_the_reason(campaign, gone, reason):
    with pytest.raises(SettingsError, match=reason):
        readings(without(campaign(4)[0], *gone))


def test_a_turn_between_two_samples_is_put_where_the_legs_meet():
    time = np.linspace(0.0, 2.0, 41) + 0.013
    drive = 1e-3 * (1.0 - np.abs(time - 1.0))  # turns at 1 s, off the grid
    noise = 1e-7
    when, what, added = with_corners(time, calmed(drive, noise), noise)
    assert when[added] == pytest.approx([1.0], abs=1e-3)  # the noise that is allowed for over the speed
    assert what[added] == pytest.approx([1e-3], abs=1e-6)
    assert turning_points(what, noise) == [int(np.flatnonzero(added)[0])]


def test_a_round_turn_is_followed_to_within_its_noise():
    rng, time = np.random.default_rng(6), np.linspace(0.0, 3.0, 301)
    drive = 1e-3 * np.sin(2 * np.pi * time / 1.5)
    calm = calmed(drive + 1e-6 * rng.standard_normal(len(drive)), 1e-6, time)
    near = np.abs(drive) > 0.99e-3  # some seven readings about each of four turns
    assert near.sum() > 20
    assert np.sqrt(np.mean((calm - drive)[near] ** 2)) < 0.8e-6  # less than the readings' own noise
    assert np.abs(calm - drive)[near].max() < 2.5e-6


def test_a_drive_that_swings_like_a_sine_is_no_noise():
    rng, time = np.random.default_rng(3), np.linspace(0.0, 30.0, 300)
    drive = 3e-3 * np.sin(2 * np.pi * time / 10.0)
    uneven = np.sort(time + rng.uniform(-0.04, 0.04, 300))
    for when in (time, uneven):
        swing = 3e-3 * np.sin(2 * np.pi * when / 10.0)
        observed = reading_noise(swing + 1e-6 * rng.standard_normal(300), when)
        assert observed == pytest.approx(1e-6, rel=0.35)  # the median of 300 is accurate to 8 %
    assert reading_noise(drive, time) < 1e-9
    assert reading_noise(np.round(np.linspace(0.0, 1.0, 300), 1), time) == pytest.approx(0.1 / np.sqrt(12))


def test_noise_of_a_coarse_display_is_its_digit_and_not_the_rounding_of_its_sums():
    force = np.interp(np.linspace(0.0, 20.0, 400), [0.0, 10.0, 20.0], [0.0, 15.0, 0.3])
    for noise in (0.003, 0.01, 0.05):
        display = 0.05 * np.round((force + noise * np.random.default_rng(3).standard_normal(400)) / 0.05)
        expected = np.hypot(noise, 0.05 / np.sqrt(12))
        assert 0.5 * expected < reading_noise(display) < 2.2 * expected


def test_a_hold_at_a_turn_is_level():
    rng = np.random.default_rng(4)
    ramp = np.linspace(0.0, 1e-3, 50)
    drive = np.concatenate([ramp, np.full(60, 1e-3), ramp[::-1]]) + 1e-6 * rng.standard_normal(160)
    held = calmed(drive, 1e-6)[52:108]
    assert np.ptp(held) == 0.0
    assert held[0] == pytest.approx(1e-3, abs=5e-7)  # four standard errors of the mean of 60


@pytest.mark.parametrize("plan", MENU, ids=lambda each: each.words)
def test_each_run_that_may_be_measured_next_has_a_later_time_for_each_sample(fitted, plan):
    run = plan.changed(fitted[0].stack.readings[0])
    assert len(run.time) == len(run.given[run.drive])
    assert np.all(np.diff(run.time) > 0.0)
