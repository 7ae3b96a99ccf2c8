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
import socket
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.live_client import Latencies, compiled_client, measured
from benchmarks.live_process import ROUTES, lines, live
from benchmarks.load_faults import FAULTS, Verdict
from benchmarks.tables import machine, table

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


if __name__ == "__main__":
    sys.exit(main())
