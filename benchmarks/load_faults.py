"""What may break around a stream, brought about on purpose, and whether the stream bears it."""

from __future__ import annotations

import json
import os
import resource
import signal
import socket
import subprocess
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep

import pyigtl
import rerun_cli

from benchmarks.live_process import PATIENCE, Live, Reader, line, live, malformed, points_mm, retimed
from tssgeom.errors import TssgeomError
from tssgeom.io.formats.states import read_state
from tssgeom.io.network.listener import LIMITS
from tssgeom.tendon.state import TendonState

_HERE = "tcp://127.0.0.1:0"
_GOOD = line(points_mm(60, 0.0), 0.0)
_STEP = 0.001  # s between two frames
_DISK = 2_000_000  # bytes of a disk that is soon full


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a fault was borne, and what happened."""

    name: str
    borne: bool
    text: str


class Exchange:
    """A source and a reader of one stream; each good frame has a time of its own."""

    def __init__(self, stream: Live) -> None:
        self.stream, self.source = stream, stream.source()
        self.sent = self.good = self.wrong = 0
        self.answers: list[dict] = []
        sock = stream.reader().sock
        sock.settimeout(1.0)
        self.reader = Reader(sock)
        while not self.answers:
            with suppress(TimeoutError):
                self.ask()
        sock.settimeout(PATIENCE)
        self.answers, self.sent = self.answers[-1:], 0
        self.first = self.answers[0]["seq"]

    def frame(self) -> bytes:
        """Return one more good frame, with an id."""
        self.good += 1
        self.sent += 1
        return retimed(_GOOD, _STEP * (self.good + 1_000_000))[:-2] + b',"id":%d}\n' % self.good

    def ask(self) -> dict:
        """Send a good frame and wait until it is answered."""
        self.source.sendall(self.frame())
        return self.heard()

    def heard(self) -> dict:
        """Read up to the answer to the last good frame."""
        self.answers += self.reader.until("id", self.good)
        assert "segments" in self.answers[-1], self.answers[-1]
        return self.answers[-1]

    def bad(self, text: bytes) -> None:
        """Send a bad line."""
        self.sent += 1
        self.wrong += 1
        self.source.sendall(text + b"\n")

    def refused(self, text: bytes) -> None:
        """Send a bad line and wait until it is rejected."""
        self.bad(text)
        self.answers.append(self.reader.answer())
        assert "rejected" in self.answers[-1], self.answers[-1]

    def accounted(self) -> tuple[bool, str]:
        """Whether each frame was answered, rejected or counted as dropped, and the numbers."""
        last = self.answers[-1]
        answers = [one for one in self.answers if one["seq"] > self.first and one.get("stale") is not True]
        answered = sum("segments" in one for one in answers)
        rejected = sum("rejected" in one for one in answers)
        dropped = last["dropped"] - self.answers[0]["dropped"]
        whole = answered + rejected + dropped == self.sent and rejected <= self.wrong
        sound = whole and self.stream.alive
        return sound, f"{self.sent} sent: {answered} answered, {rejected} rejected, {dropped} dropped"

    def close(self) -> None:
        """Hang up."""
        self.source.close()
        self.reader.sock.close()


def bad_lines(quick: bool) -> Verdict:
    """Send bad lines of every kind among good ones."""
    count = 20 if quick else 10_000
    with live("--source", _HERE, "--sink", _HERE) as stream:
        exchange = Exchange(stream)
        before, memory = exchange.answers[-1]["tension_out_N"], stream.memory()
        for _, text in malformed():
            most = count if len(text) < 10_000 else max(count // 100, 5)
            for i in range(most):
                if i % 20 < 10:
                    exchange.refused(text)
                else:  # so many at once that the newest wins
                    exchange.bad(text)
                if i % 20 == 19:
                    exchange.ask()
        after = exchange.ask()["tension_out_N"]
        sound, text = exchange.accounted()
        grown = stream.memory() - memory
        exchange.close()
    sound = sound and after == before
    return Verdict(f"{count} bad lines of each kind", sound, f"{text}; memory {grown:+.1f} MiB")


def huge_line(quick: bool) -> Verdict:
    """Send a line that never ends."""
    with live("--source", _HERE, "--sink", _HERE) as stream:
        exchange = Exchange(stream)
        with stream.source() as other, suppress(OSError):
            for _ in range(100):
                other.sendall(b"[" * (1 << 18))
        text = stream.said("cut off")
        sound = "segments" in exchange.ask()
        exchange.close()
    return Verdict("a line that never ends", sound, text.partition("cut off: ")[2])


def source_returns(quick: bool) -> Verdict:
    """Let a source die inside a frame and come back, its clock beginning anew."""
    count = 5 if quick else 200
    with live("--source", _HERE, "--sink", _HERE) as stream:
        exchange = Exchange(stream)
        answered = 0
        for i in range(count):
            with stream.source() as source:
                source.sendall(retimed(_GOOD, 1.0)[:-2] + b',"id":"back %d"}\n' % i + _GOOD[:500])
                answered += "segments" in exchange.reader.until("id", f"back {i}")[-1]
            sleep(1.2 / LIMITS.new_per_second)  # a client that comes back more often is turned away
        exchange.close()
    return Verdict("source dies and returns", answered == count, f"{answered} of {count} times answered")


def deaf_reader(quick: bool) -> Verdict:
    """Connect a reader that never reads."""
    with live("--source", _HERE, "--sink", _HERE) as stream:
        exchange = Exchange(stream)
        with stream.reader().sock:
            end = monotonic() + PATIENCE
            while monotonic() < end and not any("has not read" in said for said in stream.errors):
                exchange.bad(b'{"t":1,"points":[],"id":"%s"}' % (b"x" * 250))
                if exchange.sent % 8 == 0:
                    exchange.ask()
        said = [one for one in stream.errors if "has not read" in one]
        exchange.ask()
        sound, text = exchange.accounted()
        exchange.close()
    return Verdict("sink reader never reads", sound and bool(said), f"cut off; the other: {text}")


def time_jumps(quick: bool) -> Verdict:
    """Let time jump back between good frames."""
    with live("--source", _HERE, "--sink", _HERE) as stream:
        exchange = Exchange(stream)
        back = 50 if quick else 1000
        for _ in range(back):
            exchange.refused(retimed(_GOOD, 0.5).rstrip())
            exchange.ask()
        sound, text = exchange.accounted()
        exchange.close()
    return Verdict("time jumps back", sound, text)


def points_change(quick: bool) -> Verdict:
    """Send another number of points in each frame."""
    counts = [8, 500, 12, 200, 30, 1000, 60] * (3 if quick else 50)
    with live("--source", _HERE, "--sink", _HERE) as stream:
        exchange = Exchange(stream)
        answered = 0
        for i, n in enumerate(counts):
            text = line(points_mm(n, 0.01 * i, i), 2e6 + i)
            exchange.source.sendall(text[:-2] + b',"id":"n %d"}\n' % i)
            answered += "segments" in exchange.reader.until("id", f"n {i}")[-1]
        exchange.close()
    return Verdict(
        "points change each frame", answered == len(counts), f"{answered} of {len(counts)} answered"
    )


def viewer(quick: bool) -> Verdict:
    """Attach a viewer, stop it, and kill it."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with live("--source", _HERE, "--sink", _HERE, "--view", "--view-port", str(port)) as stream:
        exchange = Exchange(stream)
        address = next(text for kind, text in stream.addresses if kind == "view")
        program = Path(rerun_cli.__file__).parent / "rerun"
        command = [program, "--headless", "--window-size", "800x600", "--port", "0", "--connect", address]
        attached = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            took = {"attached": _slowest(exchange, quick)}
            attached.send_signal(signal.SIGSTOP)
            took["stopped"] = _slowest(exchange, quick)
        finally:
            attached.kill()
        took["killed"] = _slowest(exchange, quick)
        attached.wait(PATIENCE)
        sound, _ = exchange.accounted()
        exchange.close()
    text = ", ".join(f"{name} {value:.2f}" for name, value in took.items())
    return Verdict("viewer attached, stopped, killed", sound, f"p99 [ms] {text}")


def _slowest(exchange: Exchange, quick: bool) -> float:
    """Ask many times; return the time that 99 of 100 answers take no longer than [ms]."""
    count = 300 if quick else 3000
    latencies = sorted(exchange.ask()["latency_us"] for _ in range(count))
    return latencies[int(0.99 * count)] / 1e3


def killed_while_saving(quick: bool) -> Verdict:
    """Kill stream and saver at any moment of a save."""
    rounds = 2 if quick else 10
    whole = 0
    with tempfile.TemporaryDirectory() as folder:
        state = Path(folder) / "tendon.json"
        for i in range(rounds):
            with live("--source", _HERE, "--sink", _HERE, "--state", state) as stream:
                exchange = Exchange(stream)
                end = monotonic() + PATIENCE
                while not state.exists() and monotonic() < end:  # the first save makes the file
                    exchange.ask()
                for _ in range(40 + 17 * i):
                    exchange.ask()
                for number in (*stream.children(), stream.process.pid):
                    os.kill(number, signal.SIGKILL)
                exchange.close()
            with suppress(TssgeomError):
                saved = read_state(state)
                whole += isinstance(saved, TendonState) and saved.tension_in > 0.0
    return Verdict("kill -9 while the state is saved", whole == rounds, f"{whole} of {rounds} states whole")


def full_disk(quick: bool) -> Verdict:
    """Record on a disk with room for a short recording only."""

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (_DISK, _DISK))

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "full.rrd"
        ends = ("--source", _HERE, "--sink", _HERE, "--record", path)
        with live(*ends, preexec_fn=limited) as stream:
            exchange = Exchange(stream)
            end = monotonic() + PATIENCE
            while monotonic() < end and not any("full.rrd" in said for said in stream.errors):
                exchange.ask()
            sound, text = exchange.accounted()
            exchange.close()
            status = stream.stop()
        size = path.stat().st_size
    sound = sound and status == 1 and 0 < size <= _DISK
    return Verdict("disk full for --record", sound, f"{text}; {size} bytes kept, exit status {status}")


def wrong_messages(quick: bool) -> Verdict:
    """Send OpenIGTLink messages with a wrong checksum or length among good ones."""
    count = 20 if quick else 1000
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with live("--source", f"igtl://127.0.0.1:{port}", "--sink", "-") as stream:
            peer, _ = server.accept()
            answered = rejected = 0
            for i in range(count):
                good = _message(1.0 + i)
                damaged = good[:-1] + bytes([good[-1] ^ 1])
                peer.sendall(damaged)
                rejected += "checksum" in json.loads(stream.output.readline()).get("rejected", "")
                peer.sendall(good)
                answered += "segments" in json.loads(stream.output.readline())
            good = _message(1.0 + count)
            short = good[:42] + (len(good) - 58 - 7).to_bytes(8, "big") + good[50:]
            peer.sendall(short + good)
            rejected += "rejected" in json.loads(stream.output.readline())
            peer.close()
            peer, _ = server.accept()  # it comes back
            peer.sendall(good)
            answered += _answer(stream)
            peer.close()
    sound = answered == count + 1 and rejected == count + 1
    text = f"{2 * count + 2} sent: {answered} answered, {rejected} rejected, reconnected"
    return Verdict("OpenIGTLink: wrong checksum, length", sound, text)


def _message(time: float) -> bytes:
    return pyigtl.PointMessage(points_mm(60, 0.0), timestamp=time, device_name="route").pack()


def _answer(stream: Live) -> bool:
    """Read up to the next answer to a good frame."""
    while "segments" not in (answer := json.loads(stream.output.readline())):
        if not answer:
            return False
    return True


def flat_memory(quick: bool) -> Verdict:
    """Send as many frames as an hour of an endoscope brings, as fast as they are answered."""
    count = 2000 if quick else 108_000
    with live("--source", _HERE, "--sink", _HERE) as stream:
        exchange = Exchange(stream)
        for _ in range(min(count // 4, 5000)):
            exchange.ask()
        memory = stream.memory()
        for _ in range(count):
            exchange.ask()
            exchange.answers = exchange.answers[-1:]
        grown = stream.memory() - memory
        exchange.close()
    borne = grown < 2.0  # MiB: an allocator's pages, not a leak of some bytes a frame
    return Verdict(f"{count} frames", borne, f"memory {grown:+.2f} MiB")


FAULTS: tuple[Callable[[bool], Verdict], ...] = (
    bad_lines,
    huge_line,
    source_returns,
    deaf_reader,
    time_jumps,
    points_change,
    viewer,
    killed_while_saving,
    full_disk,
    wrong_messages,
    flat_memory,
)
