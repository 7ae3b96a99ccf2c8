"""Where a drive is that is read with noise, beside drives whose way is known."""

import numpy as np
import pytest

from tests.twins.machine import machine, motion
from tests.twins.mechanisms import strokes
from tssgeom.adapt.trailed_drive import TRAIL, TrailedDrive
from tssgeom.core.constants import CHANCE


def drives(seed):
    """Yield two drives and their noise: strokes of a motor, and slow ones of a tendon."""
    yield strokes(seed, 200.0, -0.5, 0.5)[1], 1e-3
    given = machine(seed)
    yield motion(given, seed, 300.0)[1], given.noise["displacement_in_m"]


def read(true, noise, seed=0, *, alone=True):
    """Yield the drive after each noisy reading, and where it has turned, if it has; it is committed there."""
    drive = TrailedDrive(noise)
    for one in true + noise * np.random.default_rng(seed).standard_normal(len(true)):
        turned = drive.take(float(one))
        if turned is not None:
            drive.committed = turned.value
        elif drive.needs_commit():
            drive.committed = drive.safe(alone=alone)
        yield drive, turned


@pytest.mark.parametrize("seed", [2, 4])
def test_a_drive_turns_where_it_does_and_nowhere_else(seed):
    for true, noise in drives(seed):
        turned = np.array([one.value for _, one in read(true, noise) if one is not None])
        moved = true[np.concatenate(([True], np.diff(true) != 0.0))]
        ways = np.sign(np.diff(moved))
        ends = moved[1:-1][ways[1:] != ways[:-1]]
        assert len(turned) == len(ends)
        assert np.abs(turned - ends).max() < 4.0 * noise
        assert (turned - ends).std() < noise


@pytest.mark.parametrize("seed", [2, 4, 6])
@pytest.mark.parametrize("every", [1, 4])
def test_where_it_is_by_now_is_known_within_its_error(seed, every):
    for path, noise in drives(seed):
        true = path[::every]
        known = np.array([(drive.value, drive.error) for drive, _ in read(true, noise)])[20:]
        off = known[:, 0] - true[20:]
        way, still = np.sign(np.gradient(true))[20:], np.gradient(true)[20:] == 0.0
        forward = np.where(way == 0.0, 1.0, way) * off / noise
        for part in (still, ~still):
            assert abs(forward[part].mean()) < 0.2
        assert off.std() < 1.05 * noise  # a reading by itself has 1
        assert 0.6 < np.mean((off / known[:, 1]) ** 2) < 1.25


def test_what_is_committed_trails_the_drive_closely():
    true, noise = strokes(3, 100.0, -0.5, 0.5)[1], 1e-3
    for i, (drive, turned) in enumerate(read(true, noise)):
        if turned is None and not drive.may_have_turned and drive.way:
            assert drive.way * (true[i] - drive.committed) > -CHANCE.rare * noise
            assert drive.way * (drive.value - drive.committed) <= TRAIL.most_behind * noise


@pytest.mark.parametrize("seed", [3, 5])
def test_a_drive_beside_others_is_left_behind_by_less_and_seldom_passed(seed):
    true, noise = strokes(seed, 100.0, -0.5, 0.5)[1], 1e-3
    behind = {alone: list[float]() for alone in (True, False)}
    for alone, kept in behind.items():
        farthest = true[0]
        for i, (drive, turned) in enumerate(read(true, noise, alone=alone)):
            way = drive.way
            farthest = true[i] if turned is not None or not way else way * max(way * farthest, way * true[i])
            if turned is None and not drive.may_have_turned and way:
                kept.append(way * (farthest - drive.committed) / noise)
    passed = np.array(behind[False]) < 0.0
    assert passed.mean() < 0.05  # two of its errors are 0.023
    assert min(behind[False]) > -CHANCE.clear
    assert np.mean(behind[False]) < np.mean(behind[True]) - 0.5


def test_a_turn_is_likely_by_what_was_read_before_the_drive_shows_it():
    noise = 1e-3
    drive = TrailedDrive(noise)
    for one in np.linspace(0.0, 1.0, 100):
        drive.take(float(one))
        drive.weigh(0.0)
    assert drive.turn_probability == 0.0
    for off in (0.3, -0.7, 1.2):
        drive.take(1.0)
        drive.weigh(off)
    assert not drive.may_have_turned  # it may stand, and the readings are those of a drive that does
    drive.take(1.0)
    drive.weigh(-6.0)
    assert drive.may_have_turned
    drive.take(1.0 - 2.0 * noise)
    assert drive.position == pytest.approx(1.0, abs=noise)
    drive.take(1.01)
    drive.weigh(-6.0)  # it goes on: what is read has another cause
    assert not drive.may_have_turned
