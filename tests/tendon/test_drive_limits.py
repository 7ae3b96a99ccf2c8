"""Commands keep to force, travel and speed of the drive, and say what cut them."""

import itertools
import math

import pytest

from tssgeom.errors import SettingsError
from tssgeom.mechanism import Drive, DriveLimits
from tssgeom.rig import Rig, read_rig, write_rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.command import compensate
from tssgeom.tendon.state import pretensioned, step, transmit

ROUTE = Arcs.exact([0.5], [math.pi])


def limited(**limits):
    return Rig(drive=Drive(limits=DriveLimits(**limits)))


def test_a_command_within_all_limits_is_that_without_limits():
    rig = limited(tension_N=50.0, displacement_m=(-0.01, 0.05), speed_m_per_s=1.0)
    free = compensate(pretensioned(Rig()), ROUTE, Rig(), displacement_out=5e-3)
    kept = compensate(pretensioned(rig), ROUTE, rig, displacement_out=5e-3, elapsed=0.1)
    assert kept.limited == ""
    assert kept.displacement_in == free.displacement_in
    assert kept.displacement_reached == pytest.approx(5e-3, rel=1e-9)


def test_too_great_a_tension_is_cut_to_the_limit():
    rig = limited(tension_N=6.0)
    command = compensate(pretensioned(rig), ROUTE, rig, displacement_out=5e-3)
    assert command.limited == "tension_N"
    assert command.tension_in == pytest.approx(6.0, rel=1e-12)
    forward = transmit(step(pretensioned(rig), ROUTE, rig, tension_in=6.0), rig)
    assert command.displacement_reached == pytest.approx(forward.displacement_out, rel=1e-12)
    assert command.tension_reached == pytest.approx(6.0 * math.exp(-0.145 * math.pi), rel=1e-9)


def test_the_drive_stays_within_its_travel():
    rig = limited(displacement_m=(0.0, 2e-3))
    command = compensate(pretensioned(rig), ROUTE, rig, displacement_out=5e-3)
    assert command.limited == "displacement_m"
    assert command.displacement_in == pytest.approx(2e-3, abs=1e-12)
    assert 0.0 < command.displacement_reached < 2e-3


def test_a_fast_move_takes_as_many_commands_as_the_speed_needs():
    rig = limited(speed_m_per_s=0.01)
    state, positions, flags = pretensioned(rig), [0.0], []
    for _ in range(9):
        command = compensate(state, ROUTE, rig, displacement_out=5e-3, elapsed=0.1)
        state = command.state
        positions.append(command.displacement_in)
        flags.append(command.limited)
    moves = [after - before for before, after in itertools.pairwise(positions)]
    assert max(moves) <= 1e-3 + 1e-9
    assert flags[:5] == ["speed_m_per_s"] * 5
    assert flags[-1] == ""
    assert command.displacement_reached == pytest.approx(5e-3, rel=1e-9)


def test_the_speed_counts_from_where_the_drive_is_measured():
    rig = limited(speed_m_per_s=0.01)
    command = compensate(pretensioned(rig), ROUTE, rig, displacement_out=5e-3, position=3e-3, elapsed=0.1)
    assert command.displacement_in == pytest.approx(4e-3, abs=1e-9)


def test_several_limits_are_named_together_and_the_speed_counts_most():
    rig = limited(tension_N=2.0, displacement_m=(0.0, 1e-3), speed_m_per_s=0.01)
    command = compensate(pretensioned(rig), ROUTE, rig, displacement_out=9e-3, position=8e-3, elapsed=0.1)
    assert command.limited == "tension_N, displacement_m, speed_m_per_s"
    assert command.displacement_in == pytest.approx(7e-3, abs=1e-9)


def test_a_limit_of_the_speed_needs_the_time():
    with pytest.raises(SettingsError, match=r"drive\.limits\.speed_m_per_s needs the time"):
        compensate(pretensioned(Rig()), ROUTE, limited(speed_m_per_s=0.01), displacement_out=5e-3)


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        ({"tension_N": 0.0}, r"drive\.limits\.tension_N is 0"),
        ({"speed_m_per_s": math.nan}, r"drive\.limits\.speed_m_per_s is nan"),
        ({"displacement_m": (1e-3, 2e-3)}, r"drive\.limits\.displacement_m is \[0\.001, 0\.002\]"),
        ({"displacement_m": (-1e-3, math.inf)}, r"drive\.limits\.displacement_m"),
    ],
)
def test_limits_that_forbid_every_command_are_refused(limits, said):
    with pytest.raises(SettingsError, match=said):
        DriveLimits(**limits)


def test_limits_are_read_from_a_rig_file_and_written_back(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text("[drive]\nlimits = { tension_N = 20.0, displacement_m = [-0.001, 0.03] }\n")
    rig = read_rig(path)
    assert rig.drive.limits == DriveLimits(tension_N=20.0, displacement_m=(-0.001, 0.03))
    assert not rig.is_machine
    write_rig(tmp_path / "again.toml", rig)
    assert read_rig(tmp_path / "again.toml") == rig
    path.write_text("[drive]\nlimits = { force_N = 20.0 }\n")
    with pytest.raises(SettingsError, match=r"force_N"):
        read_rig(path)
