"""OpenIGTLink as its own library speaks it, and as no one should."""

import json
import socket
from collections.abc import Iterator
from dataclasses import replace
from time import process_time

import numpy as np
import pyigtl
import pytest
from pyigtl.messages import CRC64, MessageBase

from tests.live.conftest import Shared
from tests.live.peers import half_circle, next_answer
from tests.live_process import PATIENCE, Reader, live
from tssgeom.errors import ShapeError
from tssgeom.io.network.igtl import HEADER, Message, header_of, message_of, route_message, text_message
from tssgeom.io.network.igtl_peers import _string
from tssgeom.io.network.igtl_rounds import Rounds
from tssgeom.io.network.mailbox import LIMITS

POSITIONS = half_circle(29)  # not as many points as from other senders: the filter in time begins anew
WHEN = 7000.0
"""Time of a frame, which no other source has: answers to all of them are read."""


@pytest.fixture
def peer(shared: Shared, reader: Reader) -> Iterator[socket.socket]:
    """The server's end of the connection that the stream's OpenIGTLink source has made."""
    sock, _ = shared.server.accept()
    with sock:
        yield sock


def reported(reader: Reader, time: float) -> dict:
    """Return the answer to the frame of a time."""
    return reader.until("t", time)[-1]


def transform(name: str, position: np.ndarray, time: float) -> bytes:
    matrix = np.eye(4)
    matrix[:3, 3] = position
    return pyigtl.TransformMessage(matrix, timestamp=time, device_name=name).pack()


def own_position(name: str, position: np.ndarray, time: float) -> bytes:
    """The protocol's own POSITION: a position and a quaternion."""
    message = pyigtl.StringMessage("", timestamp=time, device_name=name)
    message._message_type = "POSITION"
    message._pack_content = lambda: np.array([*position, 0, 0, 0, 1], ">f4").tobytes()
    return message.pack()


def tools(kind: str, named: dict[str, np.ndarray], time: float) -> bytes:
    """Tracked tools in one TDATA or QTDATA, which the library lacks: name, type, a turn and a position."""
    turn = {"TDATA": (np.eye(3).ravel(), True), "QTDATA": (np.array([0.0, 0.0, 0.0, 1.0]), False)}
    numbers, is_first = turn[kind]
    rows = (
        (numbers, position) if is_first else (position, numbers)  # a matrix is sent column by column
        for position in named.values()
    )
    content = b"".join(
        name.encode().ljust(20, b"\0") + b"\2\0" + np.concatenate(row).astype(">f4").tobytes()
        for name, row in zip(named, rows, strict=True)
    )
    message = pyigtl.StringMessage("", timestamp=time, device_name="Tracker")
    message._message_type, message._pack_content = kind, lambda: content
    return message.pack()


@pytest.mark.parametrize(
    "message",
    [
        pyigtl.PointMessage(POSITIONS, timestamp=WHEN, device_name="route"),
        pyigtl.PolyDataMessage(points=POSITIONS.astype(np.float32), timestamp=WHEN, device_name="route"),
        pyigtl.PositionMessage(POSITIONS, np.zeros((29, 4)), timestamp=WHEN, device_name="route"),
    ],
    ids=["POINT", "POLYDATA", "POSITION"],
)
def test_a_message_with_a_whole_route_is_a_frame(peer, reader, message):
    peer.sendall(message.pack())
    assert reported(reader, WHEN)["length_m"] == pytest.approx(0.5, rel=1e-5)  # single precision


@pytest.mark.parametrize("one", [transform, own_position], ids=["TRANSFORM", "POSITION"])
def test_sensors_of_one_position_each_make_frames_in_the_order_of_their_names(peer, reader, one):
    for time in (20.0, 21.0, 22.0):
        order = np.random.default_rng(int(time)).permutation(12)
        for i in order:
            peer.sendall(one(f"Sensor{i + 1}", POSITIONS[2 * i], time))
    outcome = reported(reader, 22.0)
    assert outcome["total_angle_rad"] == pytest.approx(
        np.pi * 22 / 28, rel=1e-3
    )  # of the part that is sensed


def test_named_sensors_make_a_frame_in_the_order_named_and_a_silent_one_is_a_missing_point():
    rounds = Rounds(("base", "middle", "tip"), learning=False)

    def sensed(name: str, x: float) -> tuple[Message, np.ndarray] | None:
        data = transform(name, np.array([x, 0.0, 0.0]), 1.0)
        message = message_of(header_of(data), data[HEADER:])
        assert message is not None
        return rounds.shape(message)

    assert sensed("tip", 3.0) is None
    assert sensed("elsewhere", 9.0) is None
    assert sensed("base", 1.0) is None
    _, positions = sensed("middle", 2.0)
    np.testing.assert_allclose(1e3 * positions[:, 0], (1.0, 2.0, 3.0), rtol=1e-6)  # single precision
    assert sensed("base", 1.0) is None
    assert sensed("tip", 3.0) is None
    _, positions = sensed("base", 1.5)
    np.testing.assert_allclose(1e3 * positions[:, 0], (1.0, np.nan, 3.0), rtol=1e-6)


def test_metadata_of_any_message_are_those_of_the_frame_and_the_newest_counts():
    rounds, shape = Rounds(("base", "middle", "tip"), learning=False), None
    for name, known in (
        ("base", {"tension_in_N": "9", "id": "a"}),
        ("middle", {"tension_in_N": "8"}),
        ("tip", {}),
    ):
        data = transform(name, POSITIONS[0], 1.0)
        message = message_of(header_of(data), data[HEADER:])
        assert message is not None
        shape = rounds.shape(replace(message, metadata=known))
    assert shape is not None
    assert shape[0].metadata == {"tension_in_N": "8", "id": "a"}


@pytest.mark.parametrize("kind", ["TDATA", "QTDATA"])
def test_each_message_that_lists_sensors_is_a_frame_in_the_order_of_their_names(peer, reader, kind):
    order = np.random.default_rng(1).permutation(12)
    peer.sendall(tools(kind, {f"Sensor{i + 1}": POSITIONS[2 * i] for i in order}, 24.0))
    assert reported(reader, 24.0)["total_angle_rad"] == pytest.approx(np.pi * 22 / 28, rel=1e-3)
    peer.sendall(tools(kind, {"Sensor1": POSITIONS[0], "sensor": POSITIONS[1]}, 25.0)[:-1] + b"?")
    assert f"{kind} of 'Tracker': wrong checksum" in reader.answer()["rejected"]


@pytest.mark.parametrize("kind", ["TDATA", "QTDATA"])
def test_of_listed_sensors_those_named_make_the_frame_and_one_that_is_left_out_is_missing(kind):
    def shape(rounds: Rounds, named: dict[str, np.ndarray]) -> np.ndarray:
        data = tools(kind, named, 1.0)
        message = message_of(header_of(data), data[HEADER:])
        assert message is not None
        return 1e3 * rounds.listed(message)

    base, tip, other = POSITIONS[:3].astype(np.float32).astype(float)
    unknown = [np.nan] * 3
    named = Rounds(("tip", "base"), learning=False)
    np.testing.assert_allclose(
        shape(named, {"base": base, "other": other, "tip": tip}), [tip, base], rtol=1e-12
    )
    learned = Rounds((), learning=True)
    np.testing.assert_allclose(shape(learned, {"S10": tip, "S9": base}), [base, tip], rtol=1e-12)
    np.testing.assert_allclose(shape(learned, {"S10": tip}), [unknown, tip], rtol=1e-12)
    assert shape(Rounds((), learning=True), {}).shape == (0, 3)
    data = tools(kind, {"S1": base, "S2": tip}, 1.0).replace(b"S2", b"S1")
    message = message_of(replace(header_of(data), checksum=CRC64(data[HEADER:])), data[HEADER:])
    assert message is not None
    with pytest.raises(ShapeError, match=f"{kind}: two sensors are named 'S1': give each"):
        learned.listed(message)


def test_a_server_that_is_not_reached_and_messages_that_are_not_read_are_reported_once_each(free_port):
    with live("--source", f"igtl://127.0.0.1:{free_port}", "--sink", "-") as stream:
        first = stream.said("not reachable")
        assert f"igtl://127.0.0.1:{free_port}: not reachable yet (Connection refused): trying again" in first
        with socket.create_server(("127.0.0.1", free_port)) as server:
            server.settimeout(PATIENCE)
            peer, _ = server.accept()
            with peer:
                for time in (1.0, 2.0):
                    peer.sendall(pyigtl.StringMessage("hello", timestamp=time, device_name="chat").pack())
                    image = pyigtl.ImageMessage(
                        np.zeros((2, 2, 2), np.uint8), timestamp=time, device_name="us"
                    )
                    peer.sendall(image.pack())
                peer.sendall(pyigtl.PointMessage(POSITIONS, timestamp=3.0, device_name="route").pack())
                assert next_answer(stream)["t"] == 3.0
        assert stream.stop() == 0
    reports = [text for text in stream.errors if "not re" in text]
    assert len(reports) == 3
    read = "messages are not read, only POINT, POLYDATA, POSITION, TRANSFORM, TDATA, QTDATA"
    assert f"'STRING' {read}" in reports[1]
    assert f"'IMAGE' {read}" in reports[2]


def test_a_server_that_names_each_message_anew_is_refused_in_time_and_memory():
    rounds, error = Rounds((), learning=True), None
    data = transform("sensor", POSITIONS[0], 1.0)
    message = message_of(header_of(data), data[HEADER:])
    assert message is not None
    begun = process_time()
    for number in range(3 * LIMITS.points):
        try:
            shape = rounds.shape(replace(message, header=replace(message.header, device=f"sensor {number}")))
        except ShapeError as caught:
            error = caught
        else:
            assert shape is None
    assert "more than 10000 sensors" in str(error)
    assert process_time() - begun < 5.0  # chosen: as a square of their number it took minutes
    assert rounds.shape(message) is None
    assert rounds.shape(message) is not None


def test_numbers_in_the_metadata_drive_the_tendon(peer, reader):
    message = pyigtl.PointMessage(POSITIONS, timestamp=30.0, device_name="route")
    message.header_version = 2
    message.metadata = {"tension_in_N": "7.5", "noise_m": "0.0004", "id": "with metadata"}
    peer.sendall(message.pack())
    outcome = reported(reader, 30.0)
    assert outcome["tension_in_N"] == pytest.approx(7.5)
    assert outcome["id"] == "with metadata"


@pytest.mark.parametrize("version", [2, 3])
def test_extended_headers_of_any_length_and_metadata_of_any_encoding_are_read(version):
    message = pyigtl.PointMessage(POSITIONS, timestamp=30.5, device_name="route")
    message.header_version = 2
    message.metadata = {"tension_in_N": "7.5", "room": "Zuerich"}
    data = bytearray(message.pack())
    body = bytes(data[HEADER:])
    longer = (16).to_bytes(2, "big") + body[2:12] + b"more" + body[12:]
    at = longer.rindex(b"Zuerich")
    index = longer.rindex((7).to_bytes(4, "big"), 0, at) - 2
    latin = (
        longer[:index] + (4).to_bytes(2, "big") + longer[index + 2 : at] + b"Z\xfcrich." + longer[at + 7 :]
    )
    data[:2], data[42:50] = version.to_bytes(2, "big"), len(latin).to_bytes(8, "big")
    data[14:34] = b"\xb2".ljust(20, b"\0")  # a device of Latin-1
    data[50:58] = CRC64(latin).to_bytes(8, "big")
    read = message_of(header_of(data), latin)
    assert read is not None
    assert read.header.time == 30.5
    assert read.metadata == {"tension_in_N": "7.5", "room": "Zürich."}
    np.testing.assert_allclose(1e3 * read.positions, POSITIONS, rtol=1e-5, atol=1e-3)  # single precision


def test_metadata_that_resemble_a_number_have_a_warning_and_those_of_other_programs_have_none(peer, reader):
    message = pyigtl.PointMessage(POSITIONS, timestamp=32.0, device_name="route")
    message.header_version = 2
    other = ("FrameNumber", "Timestamp", "UnfilteredTimestamp", "ProbeToTrackerTransformStatus")  # of PLUS
    message.metadata = dict.fromkeys(other, "1") | {"tension_in_N": "7.5", "noise_mm": "0.4"}
    peer.sendall(message.pack())
    warning, of_exact_points = reported(reader, 32.0)["warnings"]
    assert "less noise than sensors" in of_exact_points
    assert warning == "'noise_mm' is not read: the nearest name is noise_m"
    message.metadata, message.timestamp = {"tension_in": "7.5"}, 33.0
    peer.sendall(message.pack())
    assert "nearest name is tension_in_N; nothing else drives" in reported(reader, 33.0)["rejected"]


def test_damaged_messages_are_rejected_and_the_next_good_one_is_answered(peer, reader):
    good = pyigtl.PointMessage(POSITIONS, timestamp=40.0, device_name="route").pack()
    peer.sendall(good[:-1] + bytes([good[-1] ^ 1]))
    assert "checksum" in reader.answer()["rejected"]
    peer.sendall(good)
    assert "segments" in reported(reader, 40.0)


def test_after_a_wrong_length_the_server_is_called_anew(shared, peer, reader):
    good = pyigtl.PointMessage(POSITIONS, timestamp=50.0, device_name="route").pack()
    peer.sendall(good[:42] + (len(good) - 58 - 9).to_bytes(8, "big") + good[50:] + good)
    assert "rejected" in reader.answer()
    again, _ = shared.server.accept()
    with again:
        again.sendall(good)
        assert "segments" in reported(reader, 50.0)


def test_messages_of_other_kinds_are_passed_over(peer, reader):
    peer.sendall(pyigtl.StringMessage("hello", timestamp=1.0, device_name="chat").pack())
    peer.sendall(pyigtl.ImageMessage(np.zeros((2, 2, 2), np.uint8), timestamp=1.0, device_name="us").pack())
    peer.sendall(pyigtl.PointMessage(POSITIONS, timestamp=60.0, device_name="route").pack())
    assert reported(reader, 60.0)["seq"] > 0


def test_clients_of_the_server_get_each_answer_as_text_and_each_route_as_lines(shared, peer, reader):
    port = shared.stream.port("sink", "igtl")
    with socket.create_connection(("127.0.0.1", port), PATIENCE) as client:
        time, kinds = 70.0, dict[str, bytes]()
        client.settimeout(1.0)
        while len(kinds) < 2:
            time += 1.0
            peer.sendall(pyigtl.PointMessage(POSITIONS, timestamp=time, device_name="route").pack())
            reported(reader, time)
            try:
                while len(kinds) < 2:
                    kind, content = received(client)
                    kinds[kind] = content
            except TimeoutError:
                continue
    text = pyigtl.StringMessage()
    text._unpack_content(kinds["STRING"])
    result = json.loads(text.string)
    assert "rejected" in result or result["length_m"] == pytest.approx(0.5, rel=1e-5)
    count = int.from_bytes(kinds["POLYDATA"][:4], "big")
    first = np.frombuffer(kinds["POLYDATA"], ">f4", 3, 40)
    assert count > 2
    assert first == pytest.approx(POSITIONS[0], abs=1.0)  # mm; the fit smooths


def received(client: socket.socket) -> tuple[str, bytes]:
    """Read one message as the library reads it."""
    header = MessageBase.parse_header(exactly(client, 58))
    return header["message_type"], exactly(client, header["body_size"])


def exactly(client: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        data += client.recv(size - len(data))
    return data


def test_messages_are_those_of_the_protocols_own_library():
    line = np.array([29, *range(29)], np.uint32)
    points = POSITIONS.astype(np.float32)
    wanted = pyigtl.PolyDataMessage(points=points, lines=line, timestamp=7000.5, device_name="tssgeom_route")
    assert route_message(1e-3 * points.astype(float), 7000.5) == wanted.pack()
    wanted = pyigtl.StringMessage('{"t": 1}', timestamp=7000.5, device_name="tssgeom")
    assert text_message('{"t": 1}', 7000.5) == wanted.pack()
    message = text_message("5 µm", 1.0)
    read = message_of(header_of(message[:HEADER]), message[HEADER:])
    assert read is not None
    assert read.text == "5 µm"


def test_an_answer_that_is_too_long_for_a_string_has_its_numbers_alone():
    answer = {"t": 1.0, "seq": 3, "segments": [{"length_m": 0.1}] * 5000, "stale": False, "id": "x" * 70_000}
    message = _string(json.dumps(answer).encode() + b"\n")
    read = message_of(header_of(message[:HEADER]), message[HEADER:])
    assert read is not None
    kept = json.loads(read.text)
    assert "a STRING holds 65535 bytes" in kept.pop("warnings")[0]
    assert kept == {"t": 1.0, "seq": 3, "stale": False}
