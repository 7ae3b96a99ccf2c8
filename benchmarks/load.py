"""Latency, greatest rate and faults of `tssgeom live`, measured from another process over loopback.

    python -m benchmarks.load [--quick] [--minutes M] [--rate HZ] [--points N] [--faults-only] [--markdown]

The route is seven pieces that sway, the noise half a millimetre and unknown; the tension pulls and releases.
A frame's latency runs from just before it was sent to when the first byte of its answer arrived. `--view`
and `--record` are on, as said in each row. The load of the machine is printed, since other work on it
affects every number. The faults end with exit status 1 where one of them is not borne.
"""

from __future__ import annotations

import argparse
import os
import select
import socket
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import msgspec
import numpy as np

from benchmarks.live_process import PATIENCE, Live, lines, live, retimed
from benchmarks.load_faults import FAULTS, Verdict
from benchmarks.tables import machine, table

_COLD = 200  # frames at the start that are not counted, or a tenth of few
_AFTER = 1.0  # s in which the last answers come
_CHUNK = 1 << 18


class _Answer(msgspec.Struct):
    seq: int
    latency_us: float = 0.0
    dropped: int = 0
    id: int = -1


@dataclass(frozen=True, slots=True)
class Latencies:
    """Result of a run of frames."""

    sent: int
    answered: int
    dropped: int
    outside: np.ndarray
    """As a peer measures them [ms]."""
    inside: np.ndarray
    """As the stream itself reports them [ms]."""
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
        self.decoder = msgspec.json.Decoder(_Answer)
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
            answer = self.decoder.decode(line)
            if answer.latency_us:
                self.answers[answer.id] = (self.begun, 1e-3 * answer.latency_us)
                self.dropped = answer.dropped
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
    return _latencies(peer, sent, peer.dropped - before, seconds)


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
    return _latencies(peer, np.array(sent), 0, perf_counter() - begin)


def _numbered(line: bytes, time: float, number: int) -> bytes:
    return retimed(line, time)[:-2] + b',"id":%d}\n' % number


def _latencies(peer: _Peer, sent: np.ndarray, dropped: int, seconds: float) -> Latencies:
    kept = [i for i in sorted(peer.answers) if i >= 0]
    warm = kept[min(_COLD, len(kept) // 10) :]
    outside = np.array([1e3 * (peer.answers[i][0] - sent[i]) for i in warm])
    inside = np.array([peer.answers[i][1] for i in warm])
    return Latencies(len(sent), len(kept), dropped, outside, inside, seconds)


_DIFFERENT = 3000  # frames, sent over and over
_MINUTES, _QUICK = 10.0, 0.05
_FLOOD, _QUICK_FLOOD = 20.0, 2.0  # s
_HERE = "tcp://127.0.0.1:0"
_TARGETS = "targets: p50 ≤ 0.5, p99 ≤ 1, p99.9 ≤ 3 ms at 1000 frames/s, N = 200"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and return the exit code."""
    options = _options(arguments)
    begin = time.perf_counter()
    print(machine())
    if not options.faults_only:
        print(f"\n== latency [ms], {options.points} points, {options.rate:g} frames/s ({_TARGETS})\n")
        print(_latency_table(options), flush=True)
    print("\n== faults\n")
    verdicts = _verdicts(options)
    print(table(["fault", "borne", "what happened"], verdicts, text_columns=3, markdown=options.markdown))
    print(f"\n{time.perf_counter() - begin:.0f} s; load {os.getloadavg()[0]:.1f} at the end")
    return 0 if all(row[1] == "yes" for row in verdicts) else 1


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    summary = (__doc__ or "").split("\n")[0]
    parser = argparse.ArgumentParser(prog="python -m benchmarks.load", description=summary)
    parser.add_argument("--quick", action="store_true", help="some seconds instead of ten minutes")
    parser.add_argument("--minutes", type=float, default=0.0, help=f"of the long run ({_MINUTES:g})")
    parser.add_argument("--rate", type=float, default=1000.0, help="frames a second")
    parser.add_argument("--points", type=int, default=200, help="points of a frame")
    parser.add_argument("--faults-only", action="store_true", help="no latencies")
    parser.add_argument("--markdown", action="store_true", help="tables to paste into documents")
    return parser.parse_args(arguments)


def _latency_table(options: argparse.Namespace) -> str:
    frames = lines(options.points, min(_DIFFERENT, 300 if options.quick else _DIFFERENT), options.rate)
    minutes = options.minutes or (_QUICK if options.quick else _MINUTES)
    count = int(60.0 * minutes * options.rate)
    flood = _QUICK_FLOOD if options.quick else _FLOOD
    rows = list[list[str]]()
    with tempfile.TemporaryDirectory() as folder:
        beside = ["--view", "--view-port", str(_free_port()), "--record", str(Path(folder) / "load.rrd")]
        runs = (("nothing beside", [], min(count, 20_000)), ("--view --record", beside, count))
        for name, more, frames_of_run in runs:
            with live("--source", _HERE, "--sink", _HERE, *more) as stream:
                memory = stream.memory()
                result = paced(stream, frames, options.rate, frames_of_run)
                grown = stream.memory() - memory
                rows += _rows(name, result, grown)
                most = flooded(stream, frames, flood)
                rows.append(_row(f"{name}, one after the other", most, most.percentiles(), ""))
                stream.stop()
    header = ["run", "frames", "answered/s", "dropped", "p50", "p99", "p99.9", "max", "memory [MiB]"]
    return table(header, rows, text_columns=1, markdown=options.markdown)


def _rows(name: str, result: Latencies, grown: float) -> list[list[str]]:
    return [
        _row(name, result, result.percentiles(), f"{grown:+.1f}"),
        _row(f"{name}, told by the stream", result, result.percentiles(inside=True), ""),
    ]


def _row(name: str, result: Latencies, percentiles: Sequence[float], grown: str) -> list[str]:
    times = [f"{value:.2f}" for value in percentiles]
    return [
        name,
        str(result.sent),
        f"{result.answered / result.seconds:.0f}",
        str(result.sent - result.answered),
        *times,
        grown,
    ]


def _verdicts(options: argparse.Namespace) -> list[list[str]]:
    rows = list[list[str]]()
    for fault in FAULTS:
        verdict: Verdict = fault(options.quick)
        rows.append([verdict.name, "yes" if verdict.borne else "NO", verdict.text])
    return rows


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


if __name__ == "__main__":
    sys.exit(main())
