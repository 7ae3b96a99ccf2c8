"""A client that sends frames to a stream at a rate and times the answers: in C, or without compiler here.

The one in C goes before other processes where the system permits it, since it stands for another machine.
"""

from __future__ import annotations

import os
import select
import socket
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import msgspec
import numpy as np

from benchmarks.live_process import PATIENCE, retimed
from tssgeom.core.build import NoCompilerError, compiler

_SOURCE = Path(__file__).with_suffix(".c")
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
