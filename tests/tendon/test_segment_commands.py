"""Drives of segments and blocked ends as commanded: the end goes there, also that of independent chains."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace as changed

from tests import lumped
from tests.tendon.test_machine import HALF_CIRCLE
from tests.tendon.test_machine_against_lumped import route, tendons
from tests.test_machine_stream import POINTS
from tssgeom import Engine, Frame, compensate
from tssgeom.api.machine_calls import commanded_machine
from tssgeom.errors import SettingsError
from tssgeom.io.formats.runs import MeasuredRun
from tssgeom.mechanism import Drive, DriveLimits, End, tip
from tssgeom.rig import Friction, Rig, Sensor, Tendon, with_values
from tssgeom.sensed_route import fit_frame
from tssgeom.tendon.commander import commander_of
from tssgeom.tendon.machine import machine_of, routed
from tssgeom.tendon.machine_command import command_machine
from tssgeom.tendon.machine_error import outside_plane
from tssgeom.tendon.machine_simulation import simulate_machine
from tssgeom.uncertain import Prior, Uncertain
from tssgeom.view.figures.machine import computed_figure

TIME = np.linspace(0.0, 10.0, 101)
SPIRAL = {
    "bending_x_rad": 0.6 * np.sin(TIME),
    "bending_y_rad": 0.6 * TIME / 10.0 * np.sin(1.7 * TIME + 0.3),
}


def segment(angles=(0.0, 120.0, 240.0), pretension=6.0, **drive):
    """The rig of the chains in `test_machine_against_lumped`."""
    end = End(
        kind="segment",
        radius_m=0.0045,
        stiffness_Nm_per_rad=0.05,
        tendon_angles_deg=angles,
        length_m=0.06,
        marker_m=0.008,
    )
    return Rig(
        drive=Drive(**{"kind": "tendons"} | drive),
        end=end,
        tendon=Tendon(pretension_N=pretension, compliance_per_N=2.5e-4),
        friction=Friction(coefficient=0.12),
    )


def blocked(**drive):
    return changed(segment(), drive=Drive(kind="pair", **drive), end=End(kind="blocked"))


def forward(hardware, commands, arcs=HALF_CIRCLE):
    run = {"time_s": TIME} | dict(zip(commands.follows.inputs, commands.inputs.T, strict=True))
    return simulate_machine(machine_of(hardware, [arcs]), run)


@pytest.mark.parametrize(
    "angles", [(0.0, 120.0, 240.0), (10.0, 100.0, 190.0, 280.0), (0.0, 50.0, 130.0, 230.0, 300.0)]
)
@pytest.mark.parametrize("pretension", [0.5, 6.0, 30.0])
def test_a_segment_bends_as_wanted_and_no_drive_moves_without_need(angles, pretension):
    hardware = segment(angles, pretension)
    commands = command_machine(machine_of(hardware, [HALF_CIRCLE]), TIME, SPIRAL)
    assert commands.reached.all()
    done = forward(hardware, commands)
    for name, values in SPIRAL.items():
        np.testing.assert_allclose(done[name], values, atol=1e-6)
    modes = np.column_stack([np.cos(np.radians(angles)), np.sin(np.radians(angles))])
    common = commands.inputs - commands.inputs @ np.linalg.pinv(modes).T @ modes.T
    assert np.abs(common).max() < 1e-12  # as tendons would move that neither stretch nor rub


def test_independent_chains_bend_where_they_are_wanted_and_not_without_the_commands():
    hardware = segment()
    commands = command_machine(machine_of(hardware, [route()], 24), TIME, SPIRAL)
    around, arm = hardware.end.tendon_angles_deg, hardware.end.radius_m
    modes = arm * np.column_stack([np.cos(np.radians(around)), np.sin(np.radians(around))])
    wanted = np.column_stack([*SPIRAL.values()])
    chain, miss = lumped.Segment(arm, tuple(np.radians(around)), 0.05, 0.06, 0.008), []
    for moved in (commands.inputs, wanted @ modes.T):
        drives = [lumped.Drive("displacement", TIME, each) for each in moved.T]
        run = lumped.simulate_machine(tendons(3), drives, chain, TIME)
        miss.append(np.sqrt(np.mean((run.bending - wanted) ** 2)))
    assert miss[0] < 1e-3  # rad; bars and cells differ by as much
    assert miss[1] > 50.0 * miss[0]


def test_a_target_that_tendons_cannot_pull_to_brings_the_nearest_one_that_they_can():
    hardware = segment((0.0, 90.0), 1.0)
    target = {"bending_x_rad": np.array([0.3, 0.3, 0.3]), "bending_y_rad": np.array([0.1, -0.5, 0.2])}
    commands = command_machine(machine_of(hardware, [HALF_CIRCLE]), np.arange(3.0), target)
    np.testing.assert_array_equal(commands.reached, [True, False, True])
    slack = -1.0 * 0.0045 / 0.05  # the backbone against the pretension alone
    np.testing.assert_allclose(commands.outputs[1], [0.3, slack], atol=1e-6)
    assert commands.ends[1, 1, 0] == 0.0
    assert np.abs(commands.inputs).max() < 5e-3  # slack is let out no further than need be


@pytest.mark.parametrize("kind", ["pair", "loop"])
@pytest.mark.parametrize("which", [1, 2])
def test_one_motor_gives_one_of_two_blocked_tendons_its_tension(kind, which):
    hardware = changed(blocked(), drive=Drive(kind=kind, radius_m=0.01, play_rad=0.02))
    target = {f"tension_out_{which}_N": 6.0 + 3.0 * np.sin(TIME)}
    commands = command_machine(machine_of(hardware, [HALF_CIRCLE]), TIME, target)
    assert commands.reached.all()
    name, values = next(iter(target.items()))
    np.testing.assert_allclose(forward(hardware, commands)[name], values, atol=1e-5)
    both = {"tension_out_1_N": TIME, "tension_out_2_N": TIME}
    with pytest.raises(SettingsError, match="give one of them"):
        command_machine(machine_of(hardware, [HALF_CIRCLE]), TIME, both)


def test_two_drives_give_both_blocked_tendons_their_tensions():
    target = {"tension_out_1_N": 6.0 + 3.0 * np.sin(TIME), "tension_out_2_N": 5.0 + 4.0 * np.cos(TIME)}
    machine = machine_of(blocked(), [HALF_CIRCLE])
    commands = command_machine(machine, TIME, target)
    assert commands.reached.all()
    done = forward(blocked(), commands)
    for name, values in target.items():
        np.testing.assert_allclose(done[name], values, atol=1e-5)
    with pytest.raises(SettingsError, match="each drive needs a target"):
        command_machine(machine, TIME, {"tension_out_2_N": TIME})
    none = {"tension_out_1_N": np.full(101, -1.0), "tension_out_2_N": np.full(101, 5.0)}
    commands = command_machine(machine, TIME, none)
    assert not commands.reached.any()
    np.testing.assert_allclose(commands.outputs[-1], [0.0, 5.0], atol=1e-6)


def test_a_pair_on_one_pulley_bends_a_segment_in_its_plane_alone():
    hardware = segment((30.0, 210.0), kind="pair", radius_m=0.01, play_rad=0.03)
    way = np.array([np.cos(np.pi / 6), np.sin(np.pi / 6)])
    inside = dict(zip(SPIRAL, np.outer(way, 0.5 * np.sin(TIME)), strict=True))
    commands = command_machine(machine_of(hardware, [HALF_CIRCLE]), TIME, inside)
    assert commands.reached.all()
    done = forward(hardware, commands)
    np.testing.assert_allclose(done["bending_y_rad"], inside["bending_y_rad"], atol=1e-6)
    across = {"bending_x_rad": np.full(101, 0.2)}
    commands = command_machine(machine_of(hardware, [HALF_CIRCLE]), TIME, across)
    assert not commands.reached.any()
    np.testing.assert_allclose(commands.outputs[0], 0.2 * way[0] * way, atol=1e-6)  # the nearest in the plane


def test_no_command_of_a_segment_exceeds_a_limit_of_its_drives():
    limits = DriveLimits(tension_N=14.0, displacement_m=(-2e-3, 3e-3), speed_m_per_s=0.004)
    for one in ("tension_N", "displacement_m", "speed_m_per_s"):
        alone = DriveLimits(**{one: getattr(limits, one)})
        hardware = segment(limits=alone)
        commands = command_machine(machine_of(hardware, [HALF_CIRCLE]), TIME, SPIRAL)
        assert set(commands.limited) == {"", one}
        done, moved = forward(hardware, commands), commands.inputs
        if one == "tension_N":
            assert max(done[f"tension_in_{k}_N"].max() for k in (1, 2, 3)) <= 14.0 * (1.0 + 1e-6)
        if one == "displacement_m":
            assert -2e-3 - 1e-9 <= moved.min() < moved.max() <= 3e-3 + 1e-9
        if one == "speed_m_per_s":
            assert np.abs(np.diff(moved, axis=0)).max() <= 0.004 * (TIME[1] - TIME[0]) + 1e-9
        assert np.abs(moved.sum(axis=1)).max() < 1e-12  # what the drives have in common stays


def test_drives_that_pull_more_than_their_limit_still_go_where_they_pull_less():
    hardware = segment(limits=DriveLimits(tension_N=14.0))
    engine = Engine(hardware, tension_in=6.0)
    pulled = {f"displacement_in_{k}_m": each for k, each in ((1, 16e-3), (2, -8e-3), (3, -8e-3))}
    first = engine.push(Frame(POINTS, 0.0, of_machine=pulled)).machine
    assert max(first.channels[f"tension_in_{k}_N"] for k in (1, 2, 3)) > 14.0
    bent = 0.95 * first.channels["bending_x_rad"]
    asked = pulled | {"bending_x_target_rad": bent, "bending_y_target_rad": 0.0}
    command = engine.push(Frame(POINTS, 1.0, of_machine=asked)).machine.command
    assert command.limited == "tension_N"
    assert command.outputs["bending_x_rad"] == pytest.approx(bent, abs=1e-6)


def test_a_limit_of_travel_is_followed_along_not_stopped_at():
    hardware = segment(limits=DriveLimits(displacement_m=(-1.0, 1e-3)))
    target = {"bending_x_rad": np.array([0.0, 0.5, 0.5]), "bending_y_rad": np.array([0.0, 0.0, 0.3])}
    commands = command_machine(machine_of(hardware, [HALF_CIRCLE]), np.arange(3.0), target)
    assert commands.limited == ("", "displacement_m", "displacement_m")
    assert commands.inputs[:, 0].max() == pytest.approx(1e-3, abs=1e-9)
    assert commands.outputs[2, 1] > commands.outputs[1, 1] + 0.05


def test_tendons_with_drives_of_their_own_have_no_motor():
    hardware = segment((0.0, 180.0), radius_m=0.01)
    commands = command_machine(
        machine_of(hardware, [HALF_CIRCLE]), TIME, {"bending_x_rad": 0.1 * TIME / 10.0}
    )
    assert commands.follows.inputs == ("displacement_in_1_m", "displacement_in_2_m")
    assert commands.reached.all()


def test_frames_bring_what_the_run_brings_and_keep_what_drives_have_in_common():
    hardware = changed(segment(), sensors={"displacement_in_2_m": Sensor(zero=1e-3, gain=1.1)})
    arcs = fit_frame(Frame(POINTS, 0.0), hardware)[1].fit.arcs
    run = MeasuredRun("target", Path("target.csv"), TIME, of_machine=SPIRAL)
    expected = commanded_machine(run, [arcs], hardware)
    engine = Engine(hardware, tension_in=6.0)
    for i, time in enumerate(TIME):
        targets = {each.replace("_rad", "_target_rad"): values[i] for each, values in SPIRAL.items()}
        numbers = engine.push(Frame(POINTS, time, of_machine=targets)).machine.numbers
        for k in (1, 2, 3):
            got, name = numbers[f"displacement_in_{k}_command_m"], f"displacement_in_{k}_m"
            assert got == pytest.approx(expected.channels[name][i], abs=1e-7)
        assert numbers["bending_x_rad"] == pytest.approx(SPIRAL["bending_x_rad"][i], abs=1e-5)
    lifted = Engine(segment(), tension_in=6.0)
    given = {f"displacement_in_{k}_m": 1e-3 for k in (1, 2, 3)}
    lifted.push(Frame(POINTS, 0.0, of_machine=given))
    asked = given | {"bending_x_target_rad": 0.2, "bending_y_target_rad": 0.0}
    numbers = lifted.push(Frame(POINTS, 1.0, of_machine=asked)).machine.numbers
    moved = [numbers[f"displacement_in_{k}_command_m"] for k in (1, 2, 3)]
    assert np.mean(moved) == pytest.approx(1e-3, rel=1e-9)
    after = dict(zip(given, moved, strict=True))
    numbers = lifted.push(Frame(POINTS, 2.0, of_machine=after)).machine.numbers
    assert numbers["bending_x_rad"] == pytest.approx(0.2, abs=1e-6)


def test_a_target_of_another_end_is_refused_by_name():
    engine = Engine(segment(), tension_in=6.0)
    for name in ("joint_angle_target_rad", "tension_out_1_target_N"):
        reason = engine.push(Frame(POINTS, 0.0, of_machine={name: 0.1})).reason
        assert name in reason
        assert "bending_x_target_rad" in reason
    with pytest.raises(SettingsError, match="no target: give bending_x_rad or bending_y_rad"):
        compensate(HALF_CIRCLE, {"time_s": TIME, "joint_angle_rad": 0.1 * TIME}, segment())
    with pytest.raises(SettingsError, match="bending_y_rad has no target"):
        compensate(HALF_CIRCLE, {"time_s": TIME, "bending_x_rad": TIME, "bending_x_mm": TIME}, segment())
    with pytest.raises(SettingsError, match="this one is blocked"):
        commander_of(blocked(radius_m=0.01), tolerance=1e-3)


def test_errors_hold_what_an_uncertain_friction_does_to_the_marker():
    hardware, sd = segment(), 0.03
    known = Uncertain("friction.coefficient", Prior(0.12, sd, log=False), stated=True)
    arcs = fit_frame(Frame(POINTS, 0.0), hardware)[1].fit.arcs
    arcs = replace(arcs, covariance=0.0 * arcs.covariance)
    run = MeasuredRun("target", Path("target.csv"), TIME, of_machine=SPIRAL)
    done = commanded_machine(run, [arcs], hardware, [known], tolerance=1e-4)
    read = {"time_s": TIME} | {name: done.channels[name] for name in done.channels if "displacement" in name}
    low, high = (
        simulate_machine(machine_of(rig, [routed(arcs, rig)]), read)
        for rig in (with_values(hardware, {"friction.coefficient": 0.12 + by}) for by in (-sd, sd))
    )
    for name in SPIRAL:
        error = done.channels[name.replace("_rad", "_se_rad")]
        close = np.isclose(error, 0.5 * np.abs(high[name] - low[name]), rtol=0.05, atol=2e-4)
        assert np.mean(close) > 0.95  # all but where a tendon turns back, which is no straight line
    ends = [tip(np.column_stack([each[name] for name in SPIRAL]), hardware.end) for each in (low, high)]
    far = 0.5 * np.linalg.norm(ends[1] - ends[0], axis=1)
    risk = done.channels["out_of_tolerance"]
    assert risk[far < 2e-5].max() < 1e-3
    np.testing.assert_allclose(risk[far > 2e-4], 0.8, atol=0.2)
    assert "may be missed by more than 0.1 mm by the end of the segment" in done.warnings[-1]


def test_the_probability_in_a_plane_is_that_of_draws():
    rng = np.random.default_rng(7)
    for _ in range(20):
        root, miss, tolerance = rng.normal(size=(2, 2)), rng.normal(size=2), rng.uniform(0.5, 3.0)
        draws = miss + rng.normal(size=(200_000, 2)) @ root.T
        share = np.mean(np.hypot(*draws.T) > tolerance)
        assert outside_plane(miss, root @ root.T, tolerance) == pytest.approx(share, abs=5e-3)
    line = np.outer([0.6, 0.8], [0.6, 0.8])
    assert outside_plane(np.zeros(2), line, 1.0) == pytest.approx(0.3173, abs=1e-3)
    assert outside_plane(np.array([0.5, 0.0]), np.zeros((2, 2)), 1.0) == 0.0


def test_drives_that_wait_stand_while_the_target_trembles_inside_the_tolerance():
    tremble = 0.9 + 0.005 * (-1.0) ** np.arange(20)
    target = np.concatenate((np.linspace(0.0, 0.9, 5), tremble, [0.1]))
    run = {"time_s": 0.1 * np.arange(len(target)), "bending_x_rad": target, "bending_y_rad": 0.0 * target}
    moved = {
        policy: compensate(HALF_CIRCLE, run, segment(), tolerance=1e-3, policy=policy).channels
        for policy in ("wait", "cross")
    }
    drive = "displacement_in_1_m"
    assert np.ptp(moved["wait"][drive][8:25]) < 1e-12
    far = tip(np.column_stack([target, 0.0 * target]), segment().end)
    got = tip(np.column_stack([moved["wait"][each] for each in SPIRAL]), segment().end)
    assert np.linalg.norm(got - far, axis=1).max() < 1e-3 + 1e-6
    assert np.ptp(moved["cross"][drive][8:25]) > 3e-4
    assert moved["wait"]["bending_x_rad"][-1] == pytest.approx(0.1, abs=1e-6)


def test_the_figure_of_commands_has_targets_and_bounds_of_both_bendings():
    hardware = segment()
    known = Uncertain("friction.coefficient", Prior(0.12, 0.03, log=False), stated=True)
    run = MeasuredRun("circle", Path("circle.csv"), TIME, of_machine=SPIRAL)
    done = commanded_machine(run, [HALF_CIRCLE], hardware, [known])
    rows = computed_figure("a segment", done.channels, run.columns, "target").axes
    assert rows[0].get_title(loc="left") == "a segment"
    assert [len(axes.collections) for axes in rows] == [0, 1, 1, 0]
