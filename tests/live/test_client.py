"""That the client in C times what a little server does with its frames."""

import json
import socket
import subprocess
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from benchmarks.load import compiled_client, measured
from tests.live_process import lines
from tssgeom.core.build import NoCompilerError, compiler

FRAMES = lines(12, 5, 500.0)
LOST, LATE = 30, 50  # ids of frames: one without answer, one whose answer is late
DELAY = 1.0  # s: more than a busy machine keeps a process waiting


@pytest.fixture
def client(tmp_path):
    try:
        compiler()
    except NoCompilerError as error:
        pytest.skip(str(error))
    return compiled_client(tmp_path)


class Echo:
    """Answers each frame on another connection, in two parts, and sends other lines between them."""

    def __init__(self) -> None:
        self.source, self.sink = (socket.create_server(("127.0.0.1", 0)) for _ in range(2))
        self.ports = (self.source.getsockname()[1], self.sink.getsockname()[1])
        self.frames = list[dict]()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        with self.source, self.sink:
            source, sink = self.source.accept()[0], self.sink.accept()[0]
        sink.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with source, sink, source.makefile("rb") as texts:
            for text in texts:
                self.frames.append(json.loads(text))
                number = self.frames[-1]["id"]
                if number == LOST:
                    sink.sendall(b'{"t":0.0,"seq":1,"rejected":"no reason","id":30}\n')
                    continue
                time.sleep(DELAY if number == LATE else 0.0)
                answer = b'{"t":0.0,"latency_us":%d.5,"stale":false,"id":%d}\n' % (number, number)
                sink.sendall(answer[:9])
                sink.sendall(answer[9:] + b'{"t":0.0,"stale":true}\n')

    def join(self) -> None:
        self._thread.join(30)
        assert not self._thread.is_alive()


@pytest.fixture
def echo():
    server = Echo()
    yield server
    server.join()


def test_frames_come_whole_in_their_order_and_at_their_times(client, echo):
    measured(client, echo.ports, FRAMES, 500.0, 100)
    echo.join()
    counted = [frame for frame in echo.frames if frame["id"] >= 0]
    assert [frame["id"] for frame in counted] == list(range(100))
    np.testing.assert_allclose([frame["t"] for frame in counted], np.arange(100) / 500.0, atol=1e-6)
    sent = {json.dumps(frame["points"]) for frame in counted}
    assert sent == {json.dumps(json.loads(line)["points"]) for line in FRAMES}


def test_each_answer_is_matched_to_its_frame_and_a_refusal_is_none(client, echo):
    result = measured(client, echo.ports, FRAMES, 500.0, 100)
    assert (result.sent, result.answered) == (100, 99)
    counted = np.delete(np.arange(100), LOST)[9:]  # a tenth is left out
    np.testing.assert_allclose(result.inside, 1e-3 * (counted + 0.5))
    assert np.all(result.outside > 0.0)
    assert result.outside[counted == LATE] >= 1e3 * DELAY
    assert np.median(result.outside[counted < LATE]) < 1e3 * DELAY
    assert result.seconds >= 0.198


def test_frames_are_sent_on_a_schedule_that_late_answers_do_not_shift(client, echo):
    late = measured(client, echo.ports, FRAMES, 500.0, 100).late
    assert late.shape == (100,)
    assert np.all(late >= 0.0)
    assert np.median(late[LATE + 1 :]) < 1e3 * DELAY


def test_without_a_rate_each_frame_waits_for_the_answer_to_the_one_before(client, echo):
    result = measured(client, echo.ports, FRAMES, 0.0, LOST)
    assert result.answered == LOST
    assert result.seconds >= 1e-3 * result.outside[:-1].sum()


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ([], "usage: live_client SOURCE_PORT SINK_PORT FRAMES RATE COUNT"),
        (["1", "1", "missing", "1", "1"], "missing: No such file or directory"),
        (["0", "1", "frames", "1", "1"], "an argument is no number in its bounds"),
        (["1", "1", "frames", "-1", "1"], "an argument is no number in its bounds"),
        (["1", "1", "frames", "1", "1e99"], "an argument is no number in its bounds"),
        (["1", "1", "unended", "1", "1"], "unended"),
    ],
)
def test_what_is_wrong_ends_the_program_with_one_line(tmp_path, arguments, reason):
    try:
        compiler()
    except NoCompilerError as error:
        pytest.skip(str(error))
    Path(tmp_path / "frames").write_bytes(b'"unit":"mm"\n')
    Path(tmp_path / "unended").write_bytes(b'"unit":"mm"')
    program = compiled_client(tmp_path)
    ended = subprocess.run([program, *arguments], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (1, f"live_client: {reason}\n")
