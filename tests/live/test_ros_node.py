"""docs/ros2_node.py: routes of ROS messages in, tension and commands out, as `process` gives them."""

import math
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.live.peers import half_circle
from tests.live.ros_interface import STORE, Topics
from tssgeom import Frame, FrameResult, Rejected, Rig, process, read_rig

NODE = Path(__file__).parents[2] / "docs" / "ros2_node.py"


def header(time: float):
    whole = math.floor(time)
    stamp = STORE.types["builtin_interfaces/msg/Time"](sec=whole, nanosec=round(1e9 * (time - whole)))
    return STORE.types["std_msgs/msg/Header"](stamp=stamp, frame_id="fibre")


def shape(points: np.ndarray, time: float):
    turn = STORE.types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
    at, pose = STORE.types["geometry_msgs/msg/Point"], STORE.types["geometry_msgs/msg/Pose"]
    poses = [pose(position=at(x=x, y=y, z=z), orientation=turn) for x, y, z in points.tolist()]
    return STORE.types["geometry_msgs/msg/PoseArray"](header=header(time), poses=poses)


def drive(**fields: list):
    empty = {"name": [], "position": [], "velocity": [], "effort": []}
    fields = {name: value if name == "name" else np.array(value) for name, value in (empty | fields).items()}
    return STORE.types["sensor_msgs/msg/JointState"](header=header(0.0), **fields)


def target(position: float):
    return STORE.types["std_msgs/msg/Float64"](data=position)


def ran(monkeypatch: pytest.MonkeyPatch, *coming: tuple, **parameters: object) -> Topics:
    """Run the file as a program among these messages."""
    topics = Topics(parameters, list(coming))
    for name, module in topics.modules().items():
        monkeypatch.setitem(sys.modules, name, module)
    runpy.run_path(str(NODE), run_name="__main__")
    assert topics.calls == ["node tssgeom", "destroyed"]
    return topics


def expected(frames: list[Frame], rig: Rig) -> list[FrameResult | Rejected]:
    return list(process(frames, rig, tension_in=15.0))


def noisy(count: int) -> list[np.ndarray]:
    rng = np.random.default_rng(2)
    return [half_circle() + rng.normal(0.0, 0.1, (40, 3)) for _ in range(count)]


def test_each_shape_is_published_with_its_stamp_and_what_process_gives(monkeypatch, tmp_path):
    rig = tmp_path / "rig.toml"
    rig.write_text("[friction]\ncoefficient = 0.2\n")
    routes, tensions, stamps = noisy(6), (5.0, 12.0, 15.0, 9.0, 4.0, 8.0), [1e9 + 0.02 * k for k in range(6)]
    coming = list[tuple]()
    for points, tension, stamp in zip(routes, tensions, stamps, strict=True):
        coming += [
            ("drive", drive(name=["fan", "motor"], effort=[0.5, tension])),
            ("shape", shape(points, stamp)),
        ]
    topics = ran(monkeypatch, *coming, rig=str(rig), unit="mm", drive_joint="motor")
    frames = [
        Frame(points / 1000.0, stamp, tension_in=tension)
        for points, tension, stamp in zip(routes, tensions, stamps, strict=True)
    ]
    wanted = expected(frames, read_rig(rig))
    assert len(topics.published) == len(wanted) == 6
    for (topic, message), one, stamp in zip(topics.published, wanted, stamps, strict=True):
        assert (topic, message.header.frame_id) == ("tendon", "fibre")
        assert message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec == stamp
        assert message.name == ["proximal", "distal", "elongation", "elongation_se", "command"]
        of = one.transmission
        assert message.effort[:2].tolist() == [of.tension_in, of.tension_out]
        assert message.position[:4].tolist() == [
            *(of.displacement_in, of.displacement_out, of.elongation, of.elongation_se)
        ]
        assert np.isnan(message.position[4])  # without a target there is no command
        assert np.isnan(message.effort[2:]).all()


def test_a_target_is_published_as_the_command_that_reaches_it(monkeypatch):
    points = half_circle() / 1000.0
    coming = [("target", target(0.002)), ("shape", shape(points, 1.0)), ("shape", shape(points, 1.1))]
    (_, message), _ = ran(monkeypatch, *coming).published
    (one,) = expected([Frame(points, 1.0, displacement_target=0.002)], Rig())
    assert message.position[4] == one.displacement_command
    assert message.effort[4] == one.tension_command
    assert message.position[1] == pytest.approx(0.002, rel=1e-9)


def test_a_drive_by_position_and_a_shape_that_is_refused(monkeypatch):
    points = half_circle() / 1000.0
    coming = [
        ("drive", drive(name=["motor"], position=[0.004], effort=[99.0])),
        ("drive", drive(name=["motor"])),  # without a reading: the last one stays
        ("shape", shape(points, 1.0)),
        ("shape", shape(points[:2], 1.1)),
        ("shape", shape(points[:0], 1.2)),
        ("shape", shape(points, 1.3)),
    ]
    topics = ran(monkeypatch, *coming, drive_field="position")
    assert [message.position[0] for _, message in topics.published] == pytest.approx([0.004, 0.004])
    few, none = topics.logged
    assert "a route needs at least 4" in few
    assert "no points: give them, or [route]" in none  # of the rig, which states none here


def test_warnings_of_a_result_are_logged(monkeypatch):
    points = half_circle()  # millimetres, where metres are expected
    topics = ran(monkeypatch, ("drive", drive(name=["motor"], effort=[5.0])), ("shape", shape(points, 1.0)))
    (text,) = topics.logged
    assert "check the unit of the coordinates" in text


def test_a_drive_that_cannot_be_is_logged_and_not_answered(monkeypatch):
    points = half_circle() / 1000.0
    strong = drive(name=["motor"], effort=[3000.0])
    topics = ran(monkeypatch, ("drive", strong), ("shape", shape(points, 1.0)))
    (text,) = topics.logged
    assert text.startswith("3000 N would stretch the tendon by 94.8%")
    assert not topics.published


def test_a_joint_that_never_comes_is_logged(monkeypatch):
    topics = ran(monkeypatch, ("drive", drive(name=["motor"], effort=[5.0])), drive_joint="mottor")
    assert topics.logged == ["drive_joint 'mottor' is not among ['motor']: the drive is not read"]
