"""Peers that hurt: browsers, floods, half a connection, readers that do not read, storms of connections."""

from __future__ import annotations

import json
import socket
import struct
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from itertools import count

from tests.attack.live_target import Target, beside, said
from tests.live_process import line, points_mm, retimed
from tssgeom.io.network.listener import LIMITS

HERE = "127.0.0.1"
_FRAME = line(points_mm(60, 0.0), 1.0)
_PAUSE = 1.2 / LIMITS.new_per_second  # s between connections that are all admitted
_SHORT, _LONG = 1.0, 5.0  # s of a flood

Fault = Callable[[Target, bool], bool]
"""Brings one fault about, longer if so wanted; returns whether the stream reacted as it has to."""


def _connected(target: Target, what: str = "source") -> socket.socket:
    sock = socket.create_connection((HERE, target.stream.port(what, "tcp")), 5.0)
    time.sleep(_PAUSE)
    return sock


def _refused(what: str, greeting: bytes) -> Fault:
    """Send a greeting of another protocol; a reason has to come back."""

    def fault(target: Target, long: bool) -> bool:
        with _connected(target, what) as sock:
            sock.sendall(greeting)
            return b"no web server" in said(sock)

    return fault


def _rejected(greeting: bytes) -> Fault:
    """Send a greeting that is neither JSON nor HTTP; a line has to reject it."""

    def fault(target: Target, long: bool) -> bool:
        begin = len(target.lines)
        with _connected(target) as sock:
            sock.sendall(greeting)
        return target.reaction(lambda one: "rejected" in one, begin)

    return fault


def _half_open(target: Target, long: bool) -> bool:
    """Take all connections and send nothing: a sender gets one all the same."""
    with ExitStack() as stack:
        for _ in range(LIMITS.peers):
            stack.enter_context(_connected(target))
        for _ in range(40):
            begin = len(target.lines)
            with _connected(target) as late:
                with suppress(OSError):
                    late.sendall(retimed(_FRAME, 2.0)[:-2] + b',"id":"late"}\n')
                time.sleep(0.5)
                if any(one.get("id") == "late" for one in target.lines[begin:]):
                    return True
    return False


def _storm(target: Target, long: bool) -> bool:
    """Connect and reset, more often than is admitted."""
    for _ in range(1000 if long else 150):
        with suppress(OSError), socket.create_connection((HERE, target.stream.port("source", "tcp"))) as sock:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            sock.send(b'{"t"')
    time.sleep(1.1)  # then new ones are admitted again
    return True


def _byte_by_byte(target: Target, long: bool) -> bool:
    begin = len(target.lines)
    with _connected(target) as sock:
        for byte in retimed(_FRAME, 3.0)[:-2] + b',"id":"slow"}\n':
            sock.sendall(bytes([byte]))
        return target.reaction(lambda one: one.get("id") == "slow", begin)


def _half_a_line(reset: bool) -> Fault:
    def fault(target: Target, long: bool) -> bool:
        begin = len(target.lines)
        with _connected(target) as sock:
            sock.sendall(_FRAME[:500])
            if reset:
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        return reset or target.reaction(lambda one: "rejected" in one, begin)

    return fault


def _endless_line(target: Target, long: bool) -> bool:
    with _connected(target) as sock:
        with suppress(OSError):
            for _ in range(400 if long else 20):
                sock.sendall(b"[" * (1 << 17))
        with suppress(AssertionError):
            return "1 MiB" in target.stream.said("longer than")
    return False


def _deaf(readers: int) -> Fault:
    """Connect readers that do not read until they are cut off, or for a while."""

    def fault(target: Target, long: bool) -> bool:
        with ExitStack() as stack:
            for _ in range(readers):
                stack.enter_context(_connected(target, "sink")).setsockopt(
                    socket.SOL_SOCKET, socket.SO_RCVBUF, 4096
                )
            time.sleep(_LONG if long else _SHORT)
        return True

    return fault


def _reader_sends(target: Target, long: bool) -> bool:
    """Send frames to the sink: they are no frames there."""
    begin = len(target.lines)
    with _connected(target, "sink") as sock:
        for k in range(100):
            sock.sendall(retimed(_FRAME, float(k))[:-2] + b',"id":"to the sink"}\n')
    return not any(one.get("id") == "to the sink" for one in target.lines[begin:])


def _flood(scheme: str, texts: Callable[[int], bytes], ports: int = 1) -> Fault:
    """Send as fast as a core does, from one port or from many."""

    def fault(target: Target, long: bool) -> bool:
        begin = len(target.lines)

        def work() -> None:
            socks = [target.stream.source(scheme) for _ in range(ports)]
            for k in count():
                with suppress(OSError):
                    socks[k % ports].send(texts(k))

        with beside(work):
            time.sleep(_LONG if long else _SHORT)
        return target.reaction(lambda one: one.get("dropped", 0) > 0, begin)

    return fault


def _new_ports(target: Target, long: bool) -> bool:
    """Send each datagram from another port."""
    begin = len(target.lines)
    for k in range(2000 if long else 300):
        with target.stream.source("udp") as sock:
            sock.send(retimed(_FRAME, 1.0 + k)[:-2] + b',"id":"port"}')
        time.sleep(5e-3)
    return target.reaction(lambda one: one.get("id") == "port", begin)


def _datagram(data: bytes, silent: bool = False) -> Fault:
    def fault(target: Target, long: bool) -> bool:
        begin = len(target.lines)
        with target.stream.source("udp") as sock:
            sock.send(data)
            time.sleep(0.1)
        return silent or target.reaction(lambda one: "rejected" in one, begin)

    return fault


def _urgent(target: Target, long: bool) -> bool:
    begin = len(target.lines)
    with _connected(target) as sock:
        sock.send(b"!", socket.MSG_OOB)
        sock.sendall(retimed(_FRAME, 4.0)[:-2] + b',"id":"urgent"}\n')
        return target.reaction(lambda one: one.get("id") == "urgent", begin)


def _many_frames_at_once(target: Target, long: bool) -> bool:
    """Send thousands of frames in one go: the newest has its answer."""
    many, begin = (20_000 if long else 2000), len(target.lines)
    with _connected(target) as sock:
        sock.sendall(b"".join(retimed(_FRAME, 1e-3 * k) for k in range(1, many)))
        sock.sendall(retimed(_FRAME, 1e3)[:-2] + b',"id":"newest"}\n')
        return target.reaction(lambda one: one.get("id") == "newest", begin)


def _clock_jumps(target: Target, long: bool) -> bool:
    """Let the clock of another client leap and return."""
    begin, name = len(target.lines), "leap"
    with _connected(target) as sock:
        for k in range(50):
            moment = (-1.0) ** k * 10.0 ** (k % 20)
            sock.sendall(retimed(_FRAME, moment)[:-2] + f',"id":"{name}"}}\n'.encode())
            time.sleep(0.01)
    return target.reaction(lambda one: one.get("id") == name, begin)


def _walks(target: Target, long: bool) -> bool:
    """Send a route that leaps in each frame, as fast as a camera."""
    texts = [json.dumps(json.loads(line(points_mm(200, 1.3 * k, k), 0.0))).encode() for k in range(20)]
    until, k, begin = time.monotonic() + (_LONG if long else _SHORT), 0, len(target.lines)
    with _connected(target) as sock:
        while time.monotonic() < until:
            k += 1
            sock.sendall(retimed(texts[k % 20].replace(b": ", b":"), float(k))[:-1] + b',"id":"leaping"}\n')
            time.sleep(0.02)
    return target.reaction(lambda one: one.get("id") == "leaping", begin)


_POST = b"POST / HTTP/1.1\r\nContent-Length: %d\r\n\r\n" % len(_FRAME) + _FRAME
PEERS: dict[str, Fault] = {
    "POST to a source": _refused("source", _POST),
    "GET to a source": _refused("source", b"GET / HTTP/1.1\r\nHost: a\r\n\r\n"),
    "GET of a long path": _refused("source", b"GET /" + b"x" * 5000 + b" HTTP/1.1\r\n\r\n" + _FRAME),
    "OPTIONS to a source": _refused("source", b"OPTIONS * HTTP/1.1\r\n\r\n"),
    "POST to a sink": _refused("sink", _POST),
    "GET to a sink": _refused("sink", b"GET / HTTP/1.1\r\nHost: a\r\n\r\n"),
    "TLS to a source": _rejected(b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + b"a" * 100 + b"\n"),
    "SSH to a source": _rejected(b"SSH-2.0-OpenSSH_9.2\r\n"),
    "OpenIGTLink to a TCP source": _rejected(b"\0\1TRANSFORM\0\0\0" + b"\0" * 100 + b"\n"),
    "half-open connections": _half_open,
    "a storm of connections": _storm,
    "byte by byte": _byte_by_byte,
    "half a line, closed": _half_a_line(False),
    "half a line, reset": _half_a_line(True),
    "an endless line": _endless_line,
    "a deaf reader": _deaf(1),
    "eight deaf readers": _deaf(8),
    "frames to a sink": _reader_sends,
    "urgent data": _urgent,
    "thousands of frames at once": _many_frames_at_once,
    "a clock that leaps": _clock_jumps,
    "a route that leaps": _walks,
    "an empty datagram": _datagram(b"", silent=True),
    "the largest datagram": _datagram(b"[" * 65_507),
    "a binary datagram": _datagram(bytes(range(256))),
    "a flood of bad datagrams": _flood("udp", lambda k: b'{"t":1}'),
    "a flood of good datagrams": _flood("udp", lambda k: retimed(_FRAME, 1e-4 * (k + 1))),
    "a flood from 200 ports": _flood("udp", lambda k: retimed(_FRAME, 1e-4 * (k + 1)), 200),
    "a datagram from each port": _new_ports,
    "a flood of frames by TCP": _flood("tcp", lambda k: retimed(_FRAME, 1e-4 * (k + 1))),
    "a flood of bad lines by TCP": _flood("tcp", lambda k: b'{"t":1}\n' * 100),
    "a flood of empty lines": _flood("tcp", lambda k: b"\n" * 10_000 + b"[]\n"),
}
