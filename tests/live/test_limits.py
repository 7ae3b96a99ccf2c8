"""A client that sends too much, reads too little or has no token is cut off, and no other is affected."""

import json
import os
import signal
import socket
import struct
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from itertools import count

import pytest

from tests.live.peers import frame
from tests.live_process import PATIENCE, Reader, live, malformed
from tssgeom.errors import SettingsError
from tssgeom.io.network.addresses import access
from tssgeom.io.network.listener import LIMITS
from tssgeom.io.network.mailbox import LIMITS as FRAMES

_times = count(10_000)


def answered(source, reader, name):
    """Send one good frame, later than all before it, and return its answer."""
    source.sendall(frame(float(next(_times)), id=name))
    return reader.until("id", name)[-1]


def test_a_line_over_a_mebibyte_is_refused_and_its_sender_cut_off(stream, source, reader):
    with stream.source() as huge:
        huge.sendall(b"[" * ((1 << 20) + 1))
        reply = reader.answer()
        assert b"1048576 bytes" in huge.recv(1000)
        assert huge.recv(1000) == b""
    assert "1048576 bytes" in reply["rejected"]
    assert "cut off" in stream.said("1 MiB")
    assert answered(source, reader, "still here")["total_angle_rad"] > 0


def test_a_reader_that_never_reads_is_cut_off_and_the_others_are_not(stream, source, reader):
    with stream.reader().sock as deaf:
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        long = b'{"t":1,"unit":"km","points":[],"id":"%s"}\n' % (b"x" * 250)
        while not any("has not read" in reason for reason in stream.errors):
            source.sendall(long * FRAMES.waiting)
            assert answered(source, reader, "in between")["total_angle_rad"] > 0
    assert answered(source, reader, "unharmed")["total_angle_rad"] > 0


def test_one_client_too_many_is_refused_with_the_reason(stream, source, reader):
    with ExitStack() as stack:
        port = stream.port("sink", "tcp")
        clients = [
            stack.enter_context(socket.create_connection(("127.0.0.1", port), PATIENCE))
            for _ in range(LIMITS.peers)
        ]
        reply = json.loads(clients[-1].recv(1000))
        assert str(LIMITS.peers) in reply["closed"]
        assert clients[-1].recv(1000) == b""
        assert answered(source, reader, "among many")["total_angle_rad"] > 0


def test_good_frames_among_many_bad_ones_are_answered_or_counted(source, reader):
    bad = [text for _, text in malformed() if len(text) < 1000]
    start = answered(source, reader, "go")
    rounds, sent = 20, 0
    for i in range(rounds):
        lines = [*bad * 5, frame(float(next(_times)), id=i).rstrip()]
        sent += len(lines)
        source.sendall(b"\n".join(lines) + b"\n")
    replies = reader.until("id", rounds - 1)
    counts = {
        "answered": sum("segments" in one for one in replies),
        "rejected": sum("rejected" in one for one in replies),
        "dropped": replies[-1]["dropped"] - start["dropped"],
    }
    assert replies[-1]["seq"] - start["seq"] == sent
    assert sum(counts.values()) == sent, counts


@pytest.mark.parametrize(
    "uri", ["tcp://0.0.0.0:0", "udp://0.0.0.0:0", "tcp://[::]:0", "igtl://192.0.2.1:18944"]
)
def test_no_address_of_another_machine_is_taken(run, uri):
    outcome = run("live", "--source", uri, "--sink", "none")
    assert outcome.status == 2
    assert "--allow-remote" in outcome.errors[0]


def test_a_system_that_cannot_poll_is_refused_in_one_line(run, monkeypatch):
    monkeypatch.delattr("select.poll")  # as on Windows
    outcome = run("live")
    assert (outcome.status, len(outcome.errors)) == (2, 1)
    assert "use Linux, macOS, or tssgeom.Engine" in outcome.errors[0]


def run_alone(sink, given):
    program = "from pipelines.cli import main; main()"
    command = [sys.executable, "-c", program, "live", "--source", "-", "--sink", sink]
    return subprocess.run(command, input=given, capture_output=True, timeout=60, check=True)


def test_a_stream_may_give_nothing():
    outcome = run_alone("none", frame(0.0))
    assert outcome.stdout == b""
    assert b"sink none" in outcome.stderr
    assert b"rejected" not in outcome.stderr


def test_a_stream_whose_frames_are_all_rejected_states_it_once_with_a_reason():
    outcome = run_alone("-", b"".join(frame(time, unit="furlong") for time in (0.0, 1.0, 2.0)))
    assert outcome.stdout.count(b"rejected") == 3
    (line,) = (one for one in outcome.stderr.splitlines() if b"rejected" in one)
    assert b"are rejected: " in line
    assert b"furlong" in line


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        (("--sink", "udp://127.0.0.1:0"), "cannot be sent to port 0: give a port"),
        (("--source", "-", "--source", "-"), "--source - is given twice"),
        (("--sink", "none", "--sink", "none"), "--sink none is given twice"),
    ],
)
def test_an_address_that_cannot_be_used_is_refused(run, given, reason):
    outcome = run("live", *given)
    assert outcome.status == 2
    assert reason in outcome.errors[0]


def test_remote_access_needs_a_token_that_cannot_be_guessed(run, tmp_path):
    alone = run("live", "--source", "tcp://0.0.0.0:0", "--allow-remote")
    assert "--token-file" in alone.errors[0]
    weak = tmp_path / "token"
    weak.write_text("hunter2\n")
    outcome = run("live", "--source", "tcp://0.0.0.0:0", "--allow-remote", "--token-file", weak)
    assert outcome.status == 2
    assert "7 bytes" in outcome.errors[0]
    assert "hunter2" not in outcome.errors[0]


def test_a_pipe_may_bring_the_token_and_one_without_a_writer_delays_the_start_no_longer(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(SettingsError, match="the token has 0 bytes"):
        access(allow_remote=False, token_file=pipe)
    with ThreadPoolExecutor(1) as other:
        other.submit(pipe.write_text, "0123456789abcdef0123456789abcdef\n")
        assert access(allow_remote=False, token_file=pipe).admits(b"0123456789abcdef0123456789abcdef")


def test_a_client_without_the_token_gets_nothing_and_one_with_it_is_served(tmp_path):
    token = tmp_path / "token"
    token.write_text("0123456789abcdef0123456789abcdef\n")
    here = "127.0.0.1"
    ends = ("--source", f"tcp://{here}:0", "--source", f"udp://{here}:0", "--sink", f"tcp://{here}:0")
    with live(*ends, "--token-file", token, "--stats") as stream:
        port = stream.port("sink", "tcp")
        with socket.create_connection((here, port), PATIENCE) as wrong:
            wrong.sendall(b"0123456789abcdef0123456789abcdeX\n")
            assert b"wrong token" in wrong.recv(1000)
            assert wrong.recv(1000) == b""
        for _ in range(3):  # gone, with a reset, before the reason arrives
            with socket.create_connection((here, port), PATIENCE) as reset:
                reset.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                reset.sendall(b"0123456789abcdef0123456789abcdeX\n")
        with (
            socket.create_connection((here, port), PATIENCE) as right,
            stream.source() as source,
            stream.source("udp") as datagrams,
        ):
            right.sendall(token.read_bytes())
            datagrams.send(frame(1.0, id="without"))
            reader, reply, time = Reader(right), {}, 0.0
            right.settimeout(2.0)
            source.sendall(token.read_bytes())
            while reply.get("id") != "with":
                time += 1.0
                source.sendall(frame(time, id="with"))
                with suppress(TimeoutError):  # the reader may not have been let in yet
                    reply = reader.answer()
                assert reply.get("id") != "without"
            datagrams.send(token.read_bytes() + frame(1.0, id="datagram"))
            assert reader.until("id", "datagram")
        numbers = json.loads(stream.said('"rate_hz"'))
        assert set(numbers) >= {
            "latency_p50_us",
            "latency_p99_us",
            "answered",
            "rejected",
            "dropped",
            "stale",
        }
        assert stream.stop(signal.SIGINT) == 0
        assert not any("0123456789abcdef" in reason for reason in stream.errors)
