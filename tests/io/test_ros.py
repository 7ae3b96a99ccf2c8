"""ROS 2 bags and MCAP files, written by rosbags."""

import math
import shutil
import struct
import sys
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from tssgeom.errors import ShapeError, SourceError
from tssgeom.io.formats.files import Recording, find_inputs, open_recording
from tssgeom.stream import Frame, Rejected

CORPUS = Path(__file__).parent / "corpus"
STORE = get_typestore(Stores.ROS2_HUMBLE)
ARRAY, PATH = "geometry_msgs/msg/PoseArray", "nav_msgs/msg/Path"
POINTS = np.random.default_rng(4).normal(size=(3, 6, 3))


def header(time: float):
    whole = math.floor(time)
    stamp = STORE.types["builtin_interfaces/msg/Time"](sec=whole, nanosec=round(1e9 * (time - whole)))
    return STORE.types["std_msgs/msg/Header"](stamp=stamp, frame_id="base_link")


def message(kind: str, points: np.ndarray, time: float):
    turn = STORE.types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
    poses = []
    for x, y, z in points.tolist():
        location = STORE.types["geometry_msgs/msg/Point"](x=x, y=y, z=z)
        pose = STORE.types["geometry_msgs/msg/Pose"](position=location, orientation=turn)
        if kind == PATH:
            pose = STORE.types["geometry_msgs/msg/PoseStamped"](header=header(time), pose=pose)
        poses.append(pose)
    return STORE.types[kind](header=header(time), poses=poses)


def recorded(
    folder: Path, topics: dict[str, str], *, stamps=(10.0, 10.5, 11.0), plugin=StoragePlugin.MCAP
) -> Path:
    bag = folder / "bag"
    with Writer(bag, version=9, storage_plugin=plugin) as writer:
        for topic, kind in topics.items():
            connection = writer.add_connection(topic, kind, typestore=STORE)
            for k, (points, time) in enumerate(zip(POINTS, stamps, strict=True)):
                writer.write(
                    connection, (500 + k) * 10**9, STORE.serialize_cdr(message(kind, points, time), kind)
                )
    return bag


def frames(recording: Recording) -> list[Frame]:
    return [item for item in recording.frames if isinstance(item, Frame)]


@pytest.mark.parametrize("kind", [ARRAY, PATH])
@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_a_bag_comes_back_bit_for_bit_with_the_stamps_of_its_messages(tmp_path, kind, plugin):
    bag = recorded(tmp_path, {"/fibre/shape": kind}, plugin=plugin)
    recording = open_recording(bag, "m")
    assert (recording.name, recording.kind, recording.timed, recording.frame_count) == (
        "bag",
        "ros2",
        True,
        3,
    )
    np.testing.assert_array_equal([frame.points for frame in frames(recording)], POINTS)
    assert [frame.time for frame in frames(recording)] == [10.0, 10.5, 11.0]
    again = [frame.points for frame in frames(recording)]
    np.testing.assert_array_equal(again, POINTS)


@pytest.mark.parametrize("name", ["shape.mcap", "shape.db3"])
def test_a_file_without_its_metadata_is_read_too_and_nan_is_a_missing_point(name):
    outcome = frames(open_recording(CORPUS / name, "mm"))
    assert [frame.time for frame in outcome] == [100.5, 101.5, 102.5]
    np.testing.assert_allclose(outcome[0].points[:, 0], 0.01 * np.arange(6), atol=0)
    assert np.isnan(outcome[1].points).all(axis=1).tolist() == [False, False, True, False, False, False]


def test_the_unit_has_to_be_said(tmp_path):
    with pytest.raises(ShapeError, match=r"a ROS bag states no unit of length: give --unit mm\|m"):
        open_recording(CORPUS / "shape.mcap")


def test_of_several_topics_one_has_to_be_named(tmp_path):
    bag = recorded(tmp_path, {"/plan": PATH, "/fibre/shape": ARRAY})
    with pytest.raises(
        ShapeError, match=r"several topics with poses: name one of /fibre/shape, /plan, as .*#/fibre"
    ):
        open_recording(bag, "m")
    recording = open_recording(f"{bag}#/fibre/shape", "m")
    assert recording.name == "bag-fibre_shape"
    np.testing.assert_array_equal(frames(recording)[0].points, POINTS[0])
    with pytest.raises(ShapeError, match="no topic 'shape' with poses"):
        open_recording(f"{bag}#shape", "m")


def test_a_topic_named_for_a_folder_is_read_in_each_bag(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        recorded(tmp_path / name, {"/plan": PATH, "/shape": ARRAY})
    outcome = find_inputs([f"{tmp_path}#/shape"])
    assert [str(path.relative_to(tmp_path)) for path in outcome] == ["one/bag#/shape", "two/bag#/shape"]
    assert all(open_recording(path, "m").frame_count == 3 for path in outcome)


def test_a_search_takes_a_bag_as_one_recording(tmp_path):
    bag = recorded(tmp_path, {"/shape": ARRAY})
    shutil.copy(CORPUS / "shape.mcap", tmp_path / "loose.mcap")
    assert find_inputs([tmp_path]) == [bag, tmp_path / "loose.mcap"]


def test_messages_without_a_stamp_have_the_time_of_the_bag(tmp_path):
    recording = open_recording(recorded(tmp_path, {"/shape": ARRAY}, stamps=(0.0, 0.0, 0.0)), "m")
    assert [frame.time for frame in frames(recording)] == [500.0, 501.0, 502.0]
    assert "no stamp" in recording.warnings[0]


def test_a_stamp_that_does_not_advance_rejects_its_frame_only(tmp_path):
    recording = open_recording(recorded(tmp_path, {"/shape": ARRAY}, stamps=(5.0, 5.0, 6.0)), "m")
    (rejected,) = [item for item in recording.frames if isinstance(item, Rejected)]
    assert (rejected.seq, rejected.reason) == (
        1,
        "time 5 s comes after 5 s: put the frames in order, each once",
    )


def test_a_bag_without_poses_is_refused(tmp_path):
    with Writer(tmp_path / "bag", version=9) as writer:
        connection = writer.add_connection("/clock", "builtin_interfaces/msg/Time", typestore=STORE)
        tick = STORE.types["builtin_interfaces/msg/Time"](sec=1, nanosec=0)
        writer.write(connection, 1, STORE.serialize_cdr(tick, "builtin_interfaces/msg/Time"))
    with pytest.raises(ShapeError, match="no message of geometry_msgs/msg/PoseArray or nav_msgs/msg/Path"):
        open_recording(tmp_path / "bag", "mm")


@pytest.mark.parametrize("cut", [0, 10])
@pytest.mark.parametrize("name", ["shape.mcap", "shape.db3"])
def test_a_file_that_is_no_bag_is_refused_in_one_line(tmp_path, name, cut):
    (tmp_path / name).write_bytes((CORPUS / name).read_bytes()[:cut])
    with pytest.raises(SourceError, match="cannot be read as a ROS 2 bag") as caught:
        open_recording(tmp_path / name, "mm")
    assert "\n" not in str(caught.value)


def test_a_bag_that_states_more_messages_than_it_can_hold_is_refused(tmp_path):
    raw = (CORPUS / "shape.mcap").read_bytes()
    stated = raw.rindex(struct.pack("<Q", 3))  # of the channel, in the statistics at the end
    (tmp_path / "run.mcap").write_bytes(raw[:stated] + struct.pack("<Q", 1 << 40) + raw[stated + 8 :])
    with pytest.raises(
        SourceError, match=r"run\.mcap: cannot be read .* 1099511627776 messages in 4262 bytes"
    ):
        open_recording(tmp_path / "run.mcap", "m")


def test_without_rosbags_the_hint_is_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(SourceError, match=r"pip install 'tssgeom\[ros\]'"):
        open_recording(CORPUS / "shape.mcap", "mm")
