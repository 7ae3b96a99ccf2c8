"""Latency, greatest rate and faults of `tssgeom live`, seen from another process over loopback.

    python -m benchmarks.load [--quick] [--minutes M] [--rate HZ] [--points N] [--faults-only] [--markdown]

The route is seven pieces that sway, the noise half a millimetre and not told; the tension pulls and releases.
A frame's latency runs from just before it was sent to when the first byte of its answer arrived. `--view`
and `--record` are on, as said in each row. The load of the machine is told, since what else runs on it is
seen in every number. The faults end with exit status 1 where one of them is not borne.
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

from benchmarks.live_frames import lines
from benchmarks.live_process import live
from benchmarks.load_faults import FAULTS, Verdict
from benchmarks.load_latency import Latencies, flooded, paced
from benchmarks.tables import machine, table

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
                found = paced(stream, frames, options.rate, frames_of_run)
                grown = stream.memory() - memory
                rows += _rows(name, found, grown)
                most = flooded(stream, frames, flood)
                rows.append(_row(f"{name}, one after the other", most, most.percentiles(), ""))
                stream.stop()
    header = ["run", "frames", "answered/s", "dropped", "p50", "p99", "p99.9", "max", "memory [MiB]"]
    return table(header, rows, text_columns=1, markdown=options.markdown)


def _rows(name: str, found: Latencies, grown: float) -> list[list[str]]:
    return [
        _row(name, found, found.percentiles(), f"{grown:+.1f}"),
        _row(f"{name}, told by the stream", found, found.percentiles(inside=True), ""),
    ]


def _row(name: str, found: Latencies, percentiles: Sequence[float], grown: str) -> list[str]:
    told = [f"{value:.2f}" for value in percentiles]
    return [
        name,
        str(found.sent),
        f"{found.answered / found.seconds:.0f}",
        str(found.sent - found.answered),
        *told,
        grown,
    ]


def _verdicts(options: argparse.Namespace) -> list[list[str]]:
    rows = list[list[str]]()
    for fault in FAULTS:
        verdict: Verdict = fault(options.quick)
        rows.append([verdict.name, "yes" if verdict.borne else "NO", verdict.told])
    return rows


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


if __name__ == "__main__":
    sys.exit(main())
