"""Where members go again once it is known that a drive has turned, beside drives whose way is known."""

import numpy as np
import pytest

from tssgeom.adapt.drive_path import DrivePath
from tssgeom.adapt.members import Standing
from tssgeom.adapt.trailed_drive import TrailedDrive

NOISE, MEMBERS = 1e-3, 5


def begun():
    """Return members that stand anywhere."""
    none = np.empty((MEMBERS, 0))
    return Standing(none, none, none, np.zeros(MEMBERS), False, 0.0)


@pytest.mark.parametrize("seed", range(8))
def test_the_others_stand_at_a_turn_where_they_were_by_then(seed):
    random, count = np.random.default_rng(seed), 400
    turning = 0.2 + 0.1 * np.sin(np.linspace(0.0, np.pi, count))
    going = np.linspace(0.0, 2.0, count)  # five noises a reading
    drives, path, known = [TrailedDrive(NOISE), TrailedDrive(NOISE)], None, None
    for i in range(count):
        turned = [
            one.take(float(true[i]) + NOISE * random.standard_normal())
            for one, true in zip(drives, (turning, going), strict=True)
        ]
        if path is not None:
            path.take(drives)
        if turned[0] is not None:
            known = i, turned[0]
            break
        if any(one.needs_commit() for one in drives):
            for one in drives:
                one.committed = one.safe(alone=False)
            if path is not None:
                path.step()
        if path is None and drives[0].is_behind:
            committed = np.tile([one.committed for one in drives], (MEMBERS, 1))
            path = DrivePath(begun(), committed, drives)
    assert path is not None
    assert known is not None
    now, turn = known
    when = now - turn.ago
    assert abs(turning[when] - turning.max()) < NOISE
    drives[0].committed = turn.value
    ends = turn.value + turn.error * random.standard_normal(MEMBERS)
    path.turn(0, turn.ago, ends)
    stops = np.array(path.again(drives))  # [stops, members, drives]
    at = next(i for i, one in enumerate(stops) if (one[:, 0] == ends).all())
    begin = now + 1 - len(path.values)
    assert np.abs(stops[at, :, 1] - going[max(when, begin)]).max() < 3.0 * NOISE
    assert (np.diff(stops[:, :, 1], axis=0) >= 0.0).all()
    assert (stops[at + 1 :, :, 0] <= ends).all()
    assert (stops[-1, :, 1] <= drives[1].safe(alone=False)).all()


def test_a_path_is_the_same_when_it_was_saved():
    drives = [TrailedDrive(NOISE), TrailedDrive(NOISE)]
    for value in (0.0, 0.1, 0.2):
        for one in drives:
            one.take(value)
    path = DrivePath(begun(), np.zeros((MEMBERS, 2)), drives)
    path.take(drives)
    path.step()
    path.take(drives)
    path.turn(1, 1, np.linspace(0.1, 0.2, MEMBERS))
    again = DrivePath.of(path.start, path.plain())
    assert (again.values, again.steps) == (path.values, path.steps)
    assert [one.tolist() for one in again.again(drives)] == [one.tolist() for one in path.again(drives)]
