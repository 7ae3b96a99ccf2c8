"""Where a drive is that is read with noise, beside drives whose way is known."""

import numpy as np
import pytest

from tests.twins.machine import machine, motion
from tests.twins.mechanisms import strokes
from tssgeom.adapt.trailed_drive import TRAIL, TrailedDrive


def drives(seed):
    """Yield two drives and their noise: strokes of a motor, and slow ones of a tendon."""
    yield strokes(seed, 200.0, -0.5, 0.5)[1], 1e-3
    given = machine(seed)
    yield motion(given, seed, 300.0)[1], given.noise["displacement_in_m"]


def read(true, noise, seed=0):
    """Yield the drive after each noisy reading, and where it has turned, if it has; it is committed there."""
    drive = TrailedDrive(noise)
    for one in true + noise * np.random.default_rng(seed).standard_normal(len(true)):
        turned = drive.take(float(one))
        if turned is not None:
            drive.committed = turned
        elif drive.needs_commit():
            drive.committed = drive.safe()
        yield drive, turned


@pytest.mark.parametrize("seed", [2, 4])
def test_a_drive_turns_where_it_does_and_nowhere_else(seed):
    for true, noise in drives(seed):
        turned = np.array([one for _, one in read(true, noise) if one is not None])
        moved = true[np.concatenate(([True], np.diff(true) != 0.0))]
        ways = np.sign(np.diff(moved))
        ends = moved[1:-1][ways[1:] != ways[:-1]]
        assert len(turned) == len(ends)
        assert np.abs(turned - ends).max() < 4.0 * noise
        assert (turned - ends).std() < noise


@pytest.mark.parametrize("seed", [2, 4])
def test_where_it_is_by_now_has_no_bias_in_motion_or_hold(seed):
    for true, noise in drives(seed):
        off = np.array([drive.value for drive, _ in read(true, noise)]) - true
        way, still = np.sign(np.gradient(true)), np.gradient(true) == 0.0
        forward = np.where(way == 0.0, 1.0, way) * off / noise
        for part in (still, ~still):
            assert abs(forward[part].mean()) < 0.2  # 1.5 before in holds, as noise pushed on and on
            assert forward[part].std() < 1.2


def test_what_is_committed_trails_the_drive_closely():
    true, noise = strokes(3, 100.0, -0.5, 0.5)[1], 1e-3
    for i, (drive, turned) in enumerate(read(true, noise)):
        if turned is None and not drive.may_have_turned and drive.way:
            assert drive.way * (true[i] - drive.committed) > -TRAIL.margin * noise
            assert drive.way * (drive.value - drive.committed) <= 2.0 * TRAIL.margin * noise


def test_a_drive_that_may_stand_is_not_said_to_move():
    true = np.concatenate((np.linspace(0.0, 1.0, 100), np.ones(100)))
    states = [drive.moves for drive, _ in read(true, 1e-3)]
    assert all(states[20:95])
    assert sum(states[110:]) <= 2
