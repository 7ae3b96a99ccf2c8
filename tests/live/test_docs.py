"""Every example of docs/live.md is run as it stands; Slicer alone has a stand-in."""

import math
import re
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import MagicMock
from xml.etree import ElementTree

import numpy as np
import pyigtl
import pytest

from tests.live.peers import half_circle, next_answer
from tests.live_process import PATIENCE, Live, live
from tssgeom import Frame, Rig, process
from tssgeom.io.formats.jsonl import Line
from tssgeom.io.results.answers import answer

TEXT = (Path(__file__).parents[2] / "docs" / "live.md").read_text()
EXAMPLES = dict(re.findall(r"<!-- test: (\w+) -->\n```(?:\{run\} )?python\n(.*?)```", TEXT, re.DOTALL))
SENSOR = """
import math
moves = []
move_drive_to = moves.append
def shape_sensor():
    turn = [2.0 * k / 39 for k in range(40)]
    return [[250 * math.sin(a), 250 * (1 - math.cos(a)), 0] for a in turn]
"""


def ported(code: str, **ports: int) -> str:
    """Return an example with other ports."""
    for old, new in ports.items():
        code = code.replace(old.strip("_"), str(new))
    return code


def started(code: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)


def test_slicer_shows_the_elongation_of_an_answer(monkeypatch):
    (result,) = process([Frame(half_circle() / 1000.0, 1.0)], Rig(), tension_in=15.0)
    slicer, connector, text = MagicMock(), MagicMock(), MagicMock()
    slicer.mrmlScene.AddNewNodeByClass.return_value = connector
    slicer.mrmlScene.GetFirstNodeByName.return_value = text
    text.GetText.return_value = answer(result, 1.0, 0, 500.0, 0).decode()
    monkeypatch.setitem(sys.modules, "slicer", slicer)
    exec(EXAMPLES["slicer"], {})
    connector.SetTypeClient.assert_called_once_with("127.0.0.1", 18945)
    event, show = connector.AddObserver.call_args.args
    assert event is connector.DeviceModifiedEvent
    show(connector, event)
    elongation = f"elongation {1e3 * result.transmission.elongation:.2f} mm"
    slicer.util.showStatusMessage.assert_called_once_with(elongation)


def test_a_control_loop_in_one_process_gets_a_command_for_each_target():
    code = SENSOR.replace("def shape_sensor():", "def shape_sensor():\n    time.sleep(0.002)")
    code = f"import time\n{code}{EXAMPLES['process']}\nprint(len(moves), min(moves), max(moves))"
    out, _ = started(code).communicate(timeout=PATIENCE)
    count, least, most = out.split()
    assert int(count) >= 190  # of 200; a busy machine may leave the sensor without a shape
    assert 2e-3 < float(least) < float(most)


def test_sensors_that_plus_sends_as_transforms_are_a_route_in_the_order_that_is_stated():
    server = ElementTree.fromstring(re.findall(r"```xml\n(.*?)```", TEXT, re.DOTALL)[0])
    assert server.get("ListeningPort") == "18944"
    assert [each.get("Type") for each in server.iter("Message")] == ["TRANSFORM"]
    first, last = (each.get("Name") for each in server.iter("Transform"))
    names = [first, *(f"Mid{k}ToTracker" for k in range(9, 0, -1)), last]
    plus = pyigtl.OpenIGTLinkServer(port=free_port(), local_server=True)
    try:
        with live(
            "--source", f"igtl://127.0.0.1:{plus.port}?sensors={','.join(names)}", "--sink", "-"
        ) as stream:
            stream.said("connected")
            for name, position in zip(names, half_circle(11), strict=True):
                matrix = np.eye(4)
                matrix[:3, 3] = position
                plus.send_message(pyigtl.TransformMessage(matrix, timestamp=1.0, device_name=name), wait=True)
            reply = next_answer(stream)
            assert stream.stop() == 0
    finally:
        plus.stop()
    assert reply["total_angle_rad"] == pytest.approx(math.pi, rel=1e-3)


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


def test_the_keys_of_a_frame_are_named():
    keys = TEXT.partition("A frame is a line")[2].partition("The answer to a good frame")[0]
    unused = {"tension_out_N", "elongation_m"}  # measured, of which a stream makes nothing
    assert {key for key in Line.__struct_fields__ if not re.search(rf"[`\"]{key}[`\"]", keys)} == unused


def test_the_source_is_short_and_each_of_its_frames_is_answered(stream, reader):
    body = EXAMPLES["source"].partition("\n\n\n")[2]
    assert len([text for text in body.splitlines() if text.strip()]) <= 15
    process = started(ported(EXAMPLES["source"], _5000=stream.port("source", "tcp")))
    replies = reader.until("t", 0.02 * 99)
    assert process.communicate(timeout=PATIENCE) == (b"", None)
    answered = [one for one in replies if "segments" in one and one["t"] > 0]
    assert len(answered) + replies[-1]["dropped"] - replies[0]["dropped"] >= 99
    assert answered[-1]["total_angle_rad"] == pytest.approx(1.99, rel=1e-3)


@pytest.fixture(scope="module")
def ports() -> dict[str, int]:
    """Ports that nothing is bound to, each under the number that the examples have."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as frames,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as answers,
        socket.create_server(("127.0.0.1", 0)) as server,
    ):
        frames.bind(("127.0.0.1", 0))
        answers.bind(("127.0.0.1", 0))
        socks = {"_5001": frames, "_5002": answers, "_18944": server}
        return {number: sock.getsockname()[1] for number, sock in socks.items()}


@pytest.fixture(scope="module")
def served(ports: dict[str, int]) -> Iterator[Live]:
    """A stream with the ends that the examples of OpenIGTLink and of the robot want."""
    frames, answers, server = ports.values()
    sources = ("--source", f"igtl://127.0.0.1:{server}", "--source", f"udp://127.0.0.1:{frames}")
    with live(*sources, "--sink", "-", "--sink", f"udp://127.0.0.1:{answers}") as stream:
        yield stream
        assert stream.stop() == 0


def test_a_server_of_pyigtl_is_connected_and_its_route_answered(served, ports):
    process = started(ported(EXAMPLES["igtl"], **ports))
    reply = next_answer(served)
    assert reply["total_angle_rad"] == pytest.approx(2.0, rel=1e-3)
    process.communicate(timeout=PATIENCE)
    assert process.returncode == 0
    served.said("the server has gone")


def test_the_robot_gets_a_command_for_each_target(served, ports):
    code = SENSOR + EXAMPLES["robot"] + "\nprint(len(moves), min(moves), max(moves))"
    patient = code.replace("settimeout(0.01)", "settimeout(5)")  # a test machine may be busy
    out, _ = started(ported(patient, **ports)).communicate(timeout=PATIENCE)
    count, least, most = out.split()
    assert int(count) >= 150  # of 200; stale lines stand in for answers where the machine is busy
    assert 2e-3 < float(least) < float(most)
