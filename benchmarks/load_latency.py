"""Latency of a stream, from just before a frame is sent to when the first byte of its answer is received.

A time after the sending would not do: on a shared core the answer may be there before the sender goes on.
"""

from __future__ import annotations

import select
from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import msgspec
import numpy as np

from benchmarks.live_frames import retimed
from benchmarks.live_process import PATIENCE, Live

_COLD = 200  # frames at the start that are not counted, or a tenth of few
_AFTER = 1.0  # s in which the last answers come
_CHUNK = 1 << 18


class _Told(msgspec.Struct):
    seq: int
    latency_us: float = 0.0
    dropped: int = 0
    id: int = -1


@dataclass(frozen=True, slots=True)
class Latencies:
    """What became of a run of frames."""

    sent: int
    answered: int
    dropped: int
    outside: np.ndarray
    """As a peer sees them [ms]."""
    inside: np.ndarray
    """As the stream tells them itself [ms]."""
    seconds: float

    def percentiles(self, inside: bool = False) -> list[float]:
        """p50, p99, p99.9 and the greatest [ms]."""
        values = self.inside if inside else self.outside
        return [float(x) for x in np.percentile(values, (50, 99, 99.9, 100))]


class _Peer:
    """Sends frames and notes when each answer begins to arrive."""

    def __init__(self, stream: Live) -> None:
        self.source, self.sink = stream.source(), stream.reader().sock
        self.sink.settimeout(PATIENCE)
        self.rest = b""
        self.decoder = msgspec.json.Decoder(_Told)
        self.begun: float | None = None
        self.answers = dict[int, tuple[float, float]]()
        self.dropped = 0

    def listen(self, timeout: float) -> None:
        """Wait so long for answers at most, and read what is there."""
        if not select.select([self.sink], [], [], max(timeout, 0.0))[0]:
            return
        now = perf_counter()
        self.begun = self.begun if self.rest and self.begun is not None else now
        *lines, self.rest = (self.rest + self.sink.recv(_CHUNK)).split(b"\n")
        for line in lines:
            told = self.decoder.decode(line)
            if told.latency_us:
                self.answers[told.id] = (self.begun, 1e-3 * told.latency_us)
                self.dropped = told.dropped
            self.begun = now

    def close(self) -> None:
        """Hang up."""
        self.source.close()
        self.sink.close()


def synchronise(peer: _Peer, frame: bytes) -> None:
    """Send frames until one is answered: then both connections are known."""
    time = -1e6
    while not peer.answers:
        time += 1.0
        peer.source.sendall(_numbered(frame, time, -2))
        peer.listen(0.5)
    peer.answers.clear()


def paced(stream: Live, lines: Sequence[bytes], rate: float, count: int) -> Latencies:
    """Send `count` frames at a rate [Hz], the given ones over and over, and time each answer."""
    peer = _Peer(stream)
    synchronise(peer, lines[0])
    before, sent = peer.dropped, np.empty(count)
    begin = perf_counter() + 0.2
    for i in range(count):
        line = _numbered(lines[i % len(lines)], i / rate, i)
        while (left := begin + i / rate - perf_counter()) > 0:
            peer.listen(left)
        sent[i] = perf_counter()
        peer.source.sendall(line)
    seconds = perf_counter() - begin
    end = perf_counter() + _AFTER
    while count - 1 not in peer.answers and perf_counter() < end:
        peer.listen(0.1)
    peer.close()
    return _found(peer, sent, peer.dropped - before, seconds)


def flooded(stream: Live, lines: Sequence[bytes], seconds: float) -> Latencies:
    """Send each frame as soon as the one before is answered: the most that can be sustained."""
    peer = _Peer(stream)
    synchronise(peer, lines[0])
    sent = list[float]()
    begin = perf_counter()
    while perf_counter() < begin + seconds:
        i = len(sent)
        line = _numbered(lines[i % len(lines)], 1e-3 * i, i)
        sent.append(perf_counter())
        peer.source.sendall(line)
        while i not in peer.answers:
            peer.listen(PATIENCE)
    peer.close()
    return _found(peer, np.array(sent), 0, perf_counter() - begin)


def _numbered(line: bytes, time: float, number: int) -> bytes:
    return retimed(line, time)[:-2] + b',"id":%d}\n' % number


def _found(peer: _Peer, sent: np.ndarray, dropped: int, seconds: float) -> Latencies:
    kept = [i for i in sorted(peer.answers) if i >= 0]
    warm = kept[min(_COLD, len(kept) // 10) :]
    outside = np.array([1e3 * (peer.answers[i][0] - sent[i]) for i in warm])
    inside = np.array([peer.answers[i][1] for i in warm])
    return Latencies(len(sent), len(kept), dropped, outside, inside, seconds)
