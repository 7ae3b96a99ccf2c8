"""Every example of docs/live.md is run as it stands; what needs another program is checked for its syntax."""

import json
import re
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.live_process import PATIENCE, Live, live
from tssgeom.io.formats.jsonl import Line

TEXT = (Path(__file__).parents[2] / "docs" / "live.md").read_text()
EXAMPLES = dict(re.findall(r"<!-- test: (\w+) -->\n```python\n(.*?)```", TEXT, re.DOTALL))
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


@pytest.mark.parametrize("name", ["ros", "slicer"])
def test_examples_for_other_programs_are_python(name):
    compile(EXAMPLES[name], name, "exec")


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
    reply = json.loads(served.output.readline())
    assert reply["total_angle_rad"] == pytest.approx(2.0, rel=1e-3)
    process.communicate(timeout=PATIENCE)
    assert process.returncode == 0
    served.said("the server has gone")


def test_the_robot_gets_a_command_for_each_target(served, ports):
    code = SENSOR + EXAMPLES["robot"] + "\nprint(len(moves), min(moves), max(moves))"
    patient = code.replace("settimeout(0.01)", "settimeout(5)")  # a test machine may be busy
    out, _ = started(ported(patient, **ports)).communicate(timeout=PATIENCE)
    count, least, most = out.split()
    assert int(count) >= 190  # of 200; a stale line may stand in for an answer
    assert 2e-3 < float(least) < float(most)
