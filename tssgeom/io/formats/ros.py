"""ROS 2 bags and MCAP files with shapes as `PoseArray` or `Path`; needs the extra `[ros]`.

A bag states no unit: REP 103 prescribes m, practice is mm, so the user has to state it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tssgeom.arrays import read_only
from tssgeom.errors import ShapeError, SourceError, TssgeomError
from tssgeom.io.formats.paths import size_of, split, stem
from tssgeom.io.formats.recording import PER_METRE, Frames, Recording, given_unit
from tssgeom.stream import Frame, Rejected

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

METADATA = "metadata.yaml"
TYPES = ("geometry_msgs/msg/PoseArray", "nav_msgs/msg/Path")
_PER_SECOND = 1e9  # ROS counts nanoseconds
_MARK = b"rosbag2_bagfile_information"
_BY_BAG = "the messages have no stamp: the time at which the bag got them is taken"


def is_bag(folder: Path) -> bool:
    """Whether a folder is a ROS 2 bag."""
    try:
        with (folder / METADATA).open("rb") as file:
            return _MARK in file.read(1 << 16)
    except OSError:
        return False


@dataclass(frozen=True, slots=True)
class PoseFrames(Frames):
    """The messages of one topic."""

    bag: Path
    topic: str
    per_metre: float
    stamped: bool
    """True where time is the stamp of the message, False where it is the time of the bag."""

    def read(self) -> Iterator[Frame | Rejected]:
        """Yield the frames as the bag holds them."""
        try:
            with _opened(self.bag) as reader:
                wanted = [connection for connection in reader.connections if connection.topic == self.topic]
                for connection, received, raw in reader.messages(connections=wanted):
                    yield self._frame_or_rejected(reader, connection.msgtype, received, raw)
        except SourceError as error:
            yield Rejected(0, 0.0, f"the bag ends here: {error}")

    def _frame_or_rejected(self, reader: AnyReader, kind: str, received: int, raw: bytes) -> Frame | Rejected:
        try:
            return self._frame(reader.deserialize(raw, kind), received)
        except Exception as error:  # a broken message can raise anything
            return Rejected(
                0, received / _PER_SECOND, f"the message cannot be read ({_text(error)}): record it anew"
            )

    def _frame(self, message: Any, received: int) -> Frame:
        positions = [pose.position for pose in map(_pose_of, message.poses)]
        points = np.array([(p.x, p.y, p.z) for p in positions], dtype=np.float64).reshape(-1, 3)
        points[np.isnan(points).any(axis=1)] = np.nan
        time = _stamp(message) if self.stamped else received / _PER_SECOND
        return Frame(read_only(points / self.per_metre), time)


def open_bag(path: Path, unit: str | None) -> Recording:
    """Open one topic of a bag: of a folder with `metadata.yaml`, or of an .mcap or .db3 file by itself.

    Raises ShapeError where no unit is given, where there is no topic with poses, or several and none is
    named; SourceError where the bag cannot be read, or the extra is not installed.
    """
    bag, topic = split(path)
    agreed = given_unit(path, unit, "a ROS bag")
    with _opened(bag) as reader:
        connections = [c for c in reader.connections if c.msgtype in TYPES and c.msgcount]
        topic = _selected_topic(bag, sorted({c.topic for c in connections}), topic)
        wanted = [c for c in connections if c.topic == topic]
        count = sum(connection.msgcount for connection in wanted)
        if count > (size := _size(bag)):  # a message takes more than one byte, packed too
            raise ValueError(f"it states {count} messages in {size} bytes")
        connection, _, raw = next(iter(reader.messages(connections=wanted)))
        stamped = _stamp(reader.deserialize(raw, connection.msgtype)) > 0.0
    frames = PoseFrames(bag, topic, PER_METRE[agreed], stamped)
    return Recording(stem(path), path, agreed, "ros2", True, count, frames, () if stamped else (_BY_BAG,))


def _size(bag: Path) -> int:
    """Size of a bag [B], which is one file, or all in a folder."""
    return sum(size_of(file) for file in (bag.iterdir() if bag.is_dir() else [bag]))


def _selected_topic(bag: Path, topics: list[str], wanted: str | None) -> str:
    if not topics:
        raise ShapeError(f"{bag}: no message of {' or '.join(TYPES)}: record the shape as one of them")
    if wanted is None and len(topics) == 1:
        return topics[0]
    named = [topic for topic in topics if wanted is not None and topic.strip("/") == wanted.strip("/")]
    if not named:
        what = "several topics with poses" if wanted is None else f"no topic {wanted!r} with poses"
        raise ShapeError(f"{bag}: {what}: name one of {', '.join(topics)}, as {bag}#{topics[0]}")
    return named[0]


@contextmanager
def _opened(bag: Path) -> Iterator[AnyReader]:
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise SourceError(f"{bag}: bags need rosbags: pip install 'tssgeom[ros]'") from error
    try:
        with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            yield reader
    except TssgeomError:
        raise
    except Exception as error:  # a broken bag raises errors of YAML, SQLite, zstd, MCAP and Python
        raise SourceError(f"{bag}: cannot be read as a ROS 2 bag ({_text(error)}): record it anew") from error


def _text(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _pose_of(pose: Any) -> Any:
    """Return the pose of a `PoseStamped`, or the pose itself."""
    return getattr(pose, "pose", pose)


def _stamp(message: Any) -> float:
    stamp = message.header.stamp
    return stamp.sec + stamp.nanosec / _PER_SECOND
