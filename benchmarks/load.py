"""Latency, greatest rate and faults of `tssgeom live`, measured from another process over loopback.

    python -m benchmarks.load [--quick] [--minutes M] [--rate HZ] [--points N] [--faults-only] [--markdown]

The route sways, the noise is half a millimetre and unknown; the tension pulls and releases. A frame's latency
runs from just before it was sent to when the first byte of its answer arrived, by the clock of a client in C;
`sent late` is how late the client itself was, in the 99th percentile. `--view` and `--record` are on where a
row states it. The load of the machine is printed, since other work on it affects every number. The faults end
with exit status 1 where one of them is not borne.
"""

from __future__ import annotations

import argparse
import os
import select
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import msgspec
import numpy as np

from benchmarks import machine, options_parser, table
from benchmarks.live_process import PATIENCE, ROUTES, lines, live, retimed
from benchmarks.load_faults import FAULTS, Verdict
from tssgeom.core.build import NoCompilerError, compiler

_DIFFERENT = 3000  # frames, sent over and over
_MINUTES, _QUICK = 10.0, 0.05
_FLOOD, _QUICK_FLOOD = 20_000, 2000  # frames, one after the other
_BRIEF = 20_000  # frames of all other runs than that of seven pieces with `--view --record`
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
    parser = options_parser(__doc__, "some seconds instead of ten minutes")
    parser.add_argument("--minutes", type=float, default=0.0, help=f"of the long run ({_MINUTES:g})")
    parser.add_argument("--rate", type=float, default=1000.0, help="frames a second")
    parser.add_argument("--points", type=int, default=200, help="points of a frame")
    parser.add_argument("--faults-only", action="store_true", help="no latencies")
    return parser.parse_args(arguments)


def _latency_table(options: argparse.Namespace) -> str:
    different, flood = (300, _QUICK_FLOOD) if options.quick else (_DIFFERENT, _FLOOD)
    minutes = options.minutes or (_QUICK if options.quick else _MINUTES)
    count = int(60.0 * minutes * options.rate)
    rows = list[list[str]]()
    with tempfile.TemporaryDirectory() as folder:
        program = compiled_client(Path(folder))
        beside = ["--view", "--view-port", str(_free_port()), "--record", str(Path(folder) / "load.rrd")]
        for route in ROUTES:
            frames = lines(options.points, different, options.rate, route)
            for name, more in (("nothing beside", []), ("--view --record", beside)):
                most = count if more and route == "7 pieces" else min(count, _BRIEF)
                with live("--source", _HERE, "--sink", _HERE, *more) as stream:
                    memory = stream.memory()
                    ports = (stream.port("source", "tcp"), stream.port("sink", "tcp"))
                    result = measured(program, ports, frames, options.rate, most)
                    grown = f"{stream.memory() - memory:+.1f}"
                    rows.append(_row(name, route, result, result.outside, grown))
                    rows.append(_row(f"{name}, by the stream itself", route, result, result.inside, ""))
                    result = measured(program, ports, frames, 0.0, flood)
                    rows.append(_row(f"{name}, one after the other", route, result, result.outside, ""))
                    stream.stop()
    counts = ["run", "route", "frames", "answered/s", "dropped", "sent late"]
    header = [*counts, "p50", "p90", "p99", "p99.9", "max", "memory [MiB]"]
    return table(header, rows, text_columns=2, markdown=options.markdown)


def _row(name: str, route: str, result: Latencies, latencies: np.ndarray, grown: str) -> list[str]:
    times = np.percentile(latencies, (50, 90, 99, 99.9, 100))
    return [
        name,
        route,
        str(result.sent),
        f"{result.answered / result.seconds:.0f}",
        str(result.sent - result.answered),
        f"{np.percentile(result.late, 99):.2f}" if len(result.late) else "",
        *(f"{value:.2f}" for value in times),
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


_SOURCE = Path(__file__).with_name("live_client.c")
_FLAGS = ("-std=c11", "-O2", "-Wall", "-Wextra", "-Werror")
_COLD = 200  # frames at the start that are not counted, or a tenth of few
_AFTER = 1.0  # s in which the last answers come
_CHUNK = 1 << 18


@dataclass(frozen=True, slots=True)
class Latencies:
    """Result of a run of frames, latencies without those of the first frames."""

    sent: int
    answered: int
    outside: np.ndarray
    """As a peer measures them [ms]."""
    inside: np.ndarray
    """As the stream itself reports them [ms]."""
    late: np.ndarray
    """By how much the client missed the time at which a frame was due [ms]; none without a rate."""
    seconds: float


def compiled_client(folder: Path) -> Path | None:
    """Compile the client into a folder; where there is no compiler, print that and return None."""
    program = folder / "live_client"
    try:
        command = [*compiler(), *_FLAGS, str(_SOURCE), "-o", str(program)]
    except NoCompilerError as error:
        print(f"the client is in Python, and may itself be late: {error}")
        return None
    subprocess.run(command, check=True)
    return program


def measured(
    program: Path | None, ports: tuple[int, int], lines: Sequence[bytes], rate: float, count: int
) -> Latencies:
    """Send `count` frames, the given ones over and over, and time each answer.

    Parameters
    ----------
    program
        The compiled client; None: the one in Python.
    ports
        Of a source and of a sink.
    rate
        Frames a second [Hz]; 0: each as soon as the answer to the one before is there.
    """
    times = (
        _in_python(ports, lines, rate, count)
        if program is None
        else _in_c(program, ports, lines, rate, count)
    )
    sent, outside, inside = 1e-3 * times.T
    answered = np.flatnonzero(~np.isnan(outside))
    warm = answered[min(_COLD, len(answered) // 10) :]
    late = sent - 1e3 / rate * np.arange(count) if rate else np.empty(0)
    return Latencies(count, len(answered), outside[warm], inside[warm], late, 1e-3 * sent[-1])


def _in_c(
    program: Path, ports: tuple[int, int], lines: Sequence[bytes], rate: float, count: int
) -> np.ndarray:
    """Return when each frame was sent, its latency, and that in its answer, [count, 3] [µs]."""
    frames = program.with_suffix(".frames")
    frames.write_bytes(b"".join(line.partition(b",")[2][:-2] + b"\n" for line in lines))
    command = [str(each) for each in (program, *ports, frames, rate, count)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        with suppress(AttributeError, OSError):  # no such priority here, no privilege, or it has ended
            os.sched_setscheduler(process.pid, os.SCHED_FIFO, os.sched_param(1))
        output = process.communicate()[0]
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    return np.frombuffer(output).reshape(count, 3)


class _Answer(msgspec.Struct):
    latency_us: float = 0.0
    id: int = -1


def _in_python(ports: tuple[int, int], lines: Sequence[bytes], rate: float, count: int) -> np.ndarray:
    """Return the same as `_in_c`."""
    source, sink = (socket.create_connection(("127.0.0.1", port), PATIENCE) for port in ports)
    source.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    times, decoder = np.full((count, 3), np.nan), msgspec.json.Decoder(_Answer)
    rest, begun, known = b"", 0.0, False

    def send(i: int, time: float) -> float:
        line = retimed(lines[i % len(lines)], time)[:-2] + b',"id":%d}\n' % i
        sent = perf_counter()
        source.sendall(line)
        return 1e6 * sent

    def receive(wait: float) -> None:
        nonlocal rest, begun, known
        if not select.select([sink], [], [], max(wait, 0.0))[0]:
            return
        now = 1e6 * perf_counter()
        begun = begun if rest else now
        *answers, rest = (rest + sink.recv(_CHUNK)).split(b"\n")
        for text in answers:
            answer = decoder.decode(text)
            known |= answer.id == -2
            if answer.latency_us and 0 <= answer.id < count:
                times[answer.id, 1:] = begun - times[answer.id, 0], answer.latency_us
            begun = now

    with source, sink:
        early = -1e6
        while not known:  # until both connections are
            send(-2, early := early + 1.0)
            receive(0.5)
        begin = perf_counter() + 0.2
        for i in range(count):
            while (left := begin + (i / rate if rate else 0.0) - perf_counter()) > 0:
                receive(left)
            times[i, 0] = send(i, i / (rate or 1e3))
            while not rate and np.isnan(times[i, 1]):
                receive(PATIENCE)
        end = perf_counter() + _AFTER
        while np.isnan(times[-1, 1]) and perf_counter() < end:
            receive(0.1)
    times[:, 0] -= 1e6 * begin
    return times


if __name__ == "__main__":
    sys.exit(main())
