"""Signs of a machine's channels: inverted ones are named, in simulated and in real runs."""

import csv
import re
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from benchmarks.real_sets import BACK, FRONT, TOOL, TORQUE, read_tool, tool_file
from tests import lumped
from tssgeom.errors import SettingsError
from tssgeom.identify.machine_calibration import calibrate_machine
from tssgeom.identify.machine_run import load_remarks, machine_run
from tssgeom.mechanism import Drive, End, GivenRoute
from tssgeom.plausibility.runs import run_remarks
from tssgeom.rig import Rig, Tendon
from tssgeom.tendon.machine import route_of_rig
from tssgeom.uncertain import UNKNOWNS, Uncertain

ROBOT = Path(__file__).resolve().parents[3] / "shared" / "data" / "real" / "tdcr_tendon_tip"
R = 0.01
TIME = np.linspace(0.0, 40.0, 401)
SIGNS = {"motor_sign", "joint_sign", "torque_sign", "load_sign", "tendon_directions"}
AROUND = (0.0, 120.0, 240.0)


@cache
def joint_run():
    """A motor, a pair in a bent sheath, and a joint with a spring and a load that comes and goes."""
    motor = 0.8 * np.sin(TIME)
    load = 0.06 * np.sin(0.37 * TIME)
    path, physics = lumped.from_pieces([0.5], [3.0], cells=40), lumped.Physics(pretension_N=6.0)
    joint = lumped.Joint(R, 0.1, load=(TIME, load))
    run = lumped.simulate_machine(
        [(path, physics)] * 2, lumped.Motor("angle", TIME, motor, R), joint, TIME, 0.1
    )
    noise = np.random.default_rng(2).normal
    return {
        "time_s": TIME,
        "motor_angle_rad": motor,
        "joint_angle_rad": np.asarray(run.joint_angle) + noise(0.0, 1e-3, TIME.size),
        "motor_torque_Nm": np.asarray(run.motor_torque) + noise(0.0, 1e-3, TIME.size),
        "joint_torque_Nm": load,
    }


def signs_of(columns, rig=None) -> set[str]:
    return SIGNS & {each.rule for each in run_remarks(columns, rig)}


def inverted(columns, *names):
    return columns | {name: -columns[name] for name in names}


@pytest.mark.parametrize(
    ("names", "rules"),
    [
        ((), set()),
        (("motor_angle_rad",), {"motor_sign"}),
        (("joint_angle_rad",), {"joint_sign"}),
        (("joint_angle_rad", "motor_torque_Nm"), {"motor_sign", "load_sign"}),
        (("motor_torque_Nm",), {"torque_sign", "load_sign"}),
        (("joint_torque_Nm",), {"load_sign"}),
    ],
)
def test_the_channel_of_a_joint_that_is_inverted_is_named(names, rules):
    assert signs_of(inverted(joint_run(), *names)) == rules


@pytest.mark.parametrize(("factor", "named"), [(1.0, False), (np.pi / 180.0, True), (180.0 / np.pi, True)])
def test_a_joint_in_another_unit_is_named(factor, named):
    # an unknown lever arm takes up the factor, and the fit is as good
    run = joint_run() | {"joint_angle_rad": factor * joint_run()["joint_angle_rad"]}
    assert ("joint_unit" in {each.rule for each in run_remarks(run)}) is named


def test_a_joint_that_stands_while_its_drive_crosses_the_dead_zone_is_not_clipped():
    joint = np.minimum(joint_run()["joint_angle_rad"], 0.5)  # stands, to the digit, while the motor goes on
    assert "clipped" not in {each.rule for each in run_remarks(joint_run() | {"joint_angle_rad": joint})}
    force = {
        "time_s": TIME,
        "displacement_in_m": np.sin(TIME),
        "tension_in_N": np.minimum(2.0 + np.sin(TIME), 2.5),
    }
    assert "clipped" in {each.rule for each in run_remarks(force)}


def test_a_joint_that_moves_the_motor_has_no_sign_of_its_torque():
    end = End(kind="joint", radius_m=R, given="angle")
    run = inverted(joint_run(), "motor_torque_Nm", "joint_torque_Nm")
    assert signs_of(run) == {"torque_sign"}
    assert signs_of(run, Rig(drive=Drive(kind="pair", radius_m=R), end=end)) == set()


def test_a_run_whose_joint_is_inverted_is_not_fitted():
    rig = Rig(
        drive=Drive(kind="pair", radius_m=R),
        end=End(kind="joint", radius_m=R),
        route=GivenRoute(length_m=0.5, angle_rad=3.0),
    )
    with pytest.raises(
        SettingsError, match=r"^run: joint_angle_rad falls .*motor_angle:-rad.*\[motor_sign\]$"
    ):
        machine_run("run", inverted(joint_run(), "motor_angle_rad"), [route_of_rig(rig)], rig)


@cache
def tool(load):
    table = read_tool(tool_file(1, load))
    return {
        "time_s": table[:, 0],
        "motor_angle_rad": -BACK * table[:, 1],
        "motor_torque_Nm": TORQUE * table[:, 2],
        "joint_angle_rad": FRONT * table[:, 4],
        "joint_torque_Nm": -TORQUE * table[:, 5],
    }


@pytest.mark.skipif(not TOOL.is_dir(), reason="the measured tool is not beside this copy")
@pytest.mark.parametrize("load", range(4))
def test_of_a_real_instrument_all_signs_are_detected(load):
    right = tool(load)
    assert signs_of(right) == set()
    for names in product(*[(name, "") for name in ("motor_angle_rad", "joint_angle_rad", "motor_torque_Nm")]):
        names = tuple(filter(None, names))
        assert bool(signs_of(inverted(right, *names))) == bool(names), names
    assert "load_sign" in signs_of(inverted(right, "joint_torque_Nm"))


@pytest.mark.skipif(not TOOL.is_dir(), reason="the measured tool is not beside this copy")
def test_a_load_that_differs_from_run_to_run_shows_its_sign():
    rig = Rig(
        drive=Drive(kind="loop", radius_m=R),
        end=End(kind="joint", radius_m=R),
        route=GivenRoute(length_m=0.5, angle_rad=3.0),
    )

    def runs(*names):
        taken = [inverted(tool(load), *names) for load in range(4)]
        return [machine_run(f"{k}", each, [route_of_rig(rig)], rig) for k, each in enumerate(taken)]

    assert load_remarks(runs(), rig) == []
    (one,) = load_remarks(runs("joint_torque_Nm"), rig)
    assert one.rule == "load_sign"
    assert "over 4 runs" in one.text


def segment(**angles):
    return Rig(
        tendon=Tendon(pretension_N=3.0),
        drive=Drive(kind="tendons"),
        end=End(
            kind="segment",
            radius_m=0.0045,
            stiffness_Nm_per_rad=0.05,
            length_m=0.06,
            marker_m=0.008,
            tendon_angles_deg=angles.get("angles", AROUND),
        ),
        route=GivenRoute(length_m=0.5, angle_rad=1.0),
    )


@cache
def segment_run():
    """Three tendons that bend a segment round, and where its marker is, as the independent chains have it."""
    time = TIME[::2]
    pulls = [1.5e-3 * np.sin(time / 2 + phase) * time / 40.0 for phase in (0.0, 2.1, 4.2)]
    path, physics = lumped.from_pieces([0.5], [1.0], cells=40), lumped.Physics(pretension_N=3.0)
    made = lumped.Segment(0.0045, tuple(np.radians(AROUND)), 0.05, 0.06, 0.008)
    drives = [lumped.Drive("displacement", time, pull) for pull in pulls]
    run = lumped.simulate_machine([(path, physics)] * 3, drives, made, time)
    tip = np.asarray(run.tip) + np.random.default_rng(4).normal(0.0, 1e-4, (len(time), 3))
    columns = {f"displacement_in_{k + 1}_m": pull for k, pull in enumerate(pulls)}
    return {"time_s": time, **columns, **{f"tip_{axis}_m": tip[:, k] for k, axis in enumerate("xyz")}}


def test_tendons_that_pull_elsewhere_than_the_rig_says_are_named_with_their_directions():
    assert signs_of(segment_run(), segment()) == set()
    for angles in ((180.0, 300.0, 60.0), (90.0, 210.0, 330.0), (0.0, 240.0, 120.0)):
        assert signs_of(segment_run(), segment(angles=angles)) == {"tendon_directions"}
    (one,) = [
        each for each in run_remarks(segment_run(), segment(angles=(0.0, 240.0, 120.0))) if each.rule in SIGNS
    ]
    named, stated = re.findall(r"(\d+), (\d+), (\d+)°", one.text)
    np.testing.assert_allclose(
        [float(each) for each in named], AROUND, atol=5.0
    )  # friction turns them a little
    assert stated == ("0", "240", "120")


def test_the_marker_of_a_segment_is_met_along_the_backbone_too():
    rig = segment()
    run = machine_run("run", segment_run(), [route_of_rig(rig)], rig)
    unknown = [Uncertain(key, UNKNOWNS[key], False) for key in ("end.stiffness_Nm_per_rad",)]
    fitted = calibrate_machine([run], rig, unknown)
    assert not fitted.failures
    zero = next(each for each in fitted.estimates if each.name == "zero of tip_z_m")
    assert abs(zero.value) < 1e-3


@pytest.mark.skipif(not ROBOT.is_dir(), reason="the measured robot is not beside this copy")
def test_the_directions_of_a_real_robot_are_detected():
    with next(ROBOT.glob("tdcr_*_keypoints.csv")).open() as stream:
        rows = [row for row in csv.DictReader(stream) if row["pattern_label"].startswith("rep1_seg1")]
    read = {
        "time_s": "timestamp",
        **{f"displacement_in_{k + 1}_m": f"servo_{name}_mm" for k, name in enumerate((4, 3, 9))},
        **{f"tip_{axis}_m": f"tip_{axis}" for axis in "xyz"},
    }
    columns = {
        name: np.array([float(row[column]) for row in rows]) * (1.0 if name == "time_s" else 1e-3)
        for name, column in read.items()
    }
    assert "tendon_directions" in signs_of(columns, segment())
    assert signs_of(columns, segment(angles=(180.0, 300.0, 60.0))) == set()
