"""The level of a turn of a drive: its intervals hold the true one, whatever the shape of the turn is."""

import numpy as np
import pytest

from tssgeom.identify.drive_noise import sampled_drives
from tssgeom.identify.turning import legs

CYCLES = 4


def triangle(phase):
    return 1.0 - np.abs(1.0 - 2.0 * phase)


def saw(phase):
    return np.where(phase < 0.3, phase / 0.3, (1.0 - phase) / 0.7)


def sine(phase):
    return 0.5 - 0.5 * np.cos(2.0 * np.pi * phase)


def trapezoid(phase):
    return np.clip(1.5 * triangle(phase) - 0.25, 0.0, 1.0)


def rounded(phase, width=0.1):
    top, bottom = np.abs(1.0 - 2.0 * phase), 2.0 * np.minimum(phase, 1.0 - phase)
    upper = 1.0 - np.where(top < width, (top**2 + width**2) / (2.0 * width), top)
    return np.where(bottom < width, (bottom**2 + width**2) / (2.0 * width), upper)


def scores(wave, samples, noise, trials=12):
    """Return errors of the levels of turns, outwards, over their standard errors."""
    over = wave(np.linspace(0.0, 1.0, 100_001))
    out = []
    for seed in range(trials):
        rng = np.random.default_rng(seed)
        time = np.arange(CYCLES * samples) / samples + rng.uniform(0.0, 1.0 / samples)
        drive = legs(0.1 + wave(time % 1.0) + noise * rng.standard_normal(len(time)), time)
        high = drive.turn_values > 0.6
        truth = 0.1 + np.where(high, over.max(), over.min())
        out += list((drive.turn_values - truth) / drive.turn_se * np.where(high, 1.0, -1.0))
    return np.array(out)


@pytest.mark.parametrize("wave", [triangle, saw, sine, trapezoid, rounded])
def test_intervals_of_the_level_hold_it_for_sharp_and_round_turns_and_holds(wave):
    score = np.concatenate([scores(wave, 60, 0.003), scores(wave, 60, 0.012)])
    assert len(score) == 2 * 12 * (2 * CYCLES - 1)
    assert np.mean(np.abs(score) < 1.96) > 0.9  # 168 turns: 95 % less three deviations of chance
    assert abs(score.mean()) < 0.6


def test_the_drive_about_a_turn_has_less_than_the_noise_of_its_readings():
    rng, time = np.random.default_rng(4), np.arange(240) / 60.0
    true = 0.1 + sine(time % 1.0)
    near = np.abs(np.abs(true - 0.6) - 0.5) < 0.03
    off = legs(true + 0.01 * rng.standard_normal(240), time).values - true
    inner = near & (time > 0.25) & (time < 3.75)
    assert np.sqrt(np.mean(off[inner] ** 2)) < 0.006  # the readings have 0.01


def test_a_turn_of_few_readings_has_the_error_of_a_step():
    drive = legs(np.array([0.0, 1.0, 2.0, 1.0, 0.0, 1.0, 2.0]), np.arange(7.0))
    np.testing.assert_allclose(drive.turn_values, [2.0, 0.0])
    np.testing.assert_allclose(drive.turn_se, 0.5, rtol=0.5)


def test_the_level_of_a_drive_by_stairs_is_that_of_its_stair():
    stairs = np.repeat([0.0, 12.0, 28.0, 41.0, 48.0, 38.0, 28.0, 21.0, 10.0, 5.0], 50)
    time = np.arange(float(len(stairs)))
    for seed in range(6):
        rng = np.random.default_rng(seed)
        wander = 0.4 * np.sin(2.0 * np.pi * time / 23.0 + rng.uniform(0.0, 6.0))  # of a hand that holds
        read = stairs + wander + 0.2 * rng.standard_normal(len(time))
        drive = legs(read, time, of_position=True)
        away = np.abs(drive.values - stairs).reshape(10, 50)[:, 5:-5]  # from the steps
        assert away.max() < 1.5  # a shape that met the stair below: 8
        assert drive.turn_values.max() == pytest.approx(48.0, abs=1.5)


@pytest.mark.parametrize(("wave", "sharp"), [(triangle, True), (trapezoid, False)])
def test_readings_beside_sharp_turns_may_lie_on_either_side_of_them_and_none_beside_holds(wave, sharp):
    time = np.arange(CYCLES * 60) / 60.0
    beside = sampled_drives(0.1 + wave(time % 1.0), 1e-3, time).beside_turns
    turns = np.arange(30, len(time), 30)
    expected = np.isin(np.arange(len(time)), turns[:, None] + [-1, 0, 1]) if sharp else 0.0
    np.testing.assert_array_equal(beside, expected)
