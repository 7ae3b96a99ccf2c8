"""The attack on a stream, `python -m tests.attack.live [--long]`. Counts hangs, tracebacks, memory, lost."""

from __future__ import annotations

import argparse
import re
import signal
import tempfile
import time
from collections import Counter
from itertools import islice
from pathlib import Path

from tests.attack.live_lines import lines, sent
from tests.attack.live_peers import PEERS
from tests.attack.live_starts import STARTS
from tests.attack.live_target import Target, hang
from tests.attack.trial import LARGE
from tests.live_process import Live, live

_ENOUGH = 40  # good frames of which a percentile is printed
_FEW = 7  # starts of the short form: those that come first
_ENDS = ("--source", "tcp://127.0.0.1:0", "--source", "udp://127.0.0.1:0", "--sink", "tcp://127.0.0.1:0")


def attacked(faults: Counter[str], folder: Path, *, long: bool) -> int:
    """Bring about all faults that one stream has to bear; return their number."""
    beside = ("--state", folder / "tendon.json", "--record", folder / "live.rrd")
    with live(*_ENDS, *beside) as stream:
        target = Target(stream)
        for name, text in lines():
            _count(faults, name, [] if sent(target, name, text) else ["silent"])
            time.sleep(1.0 / 40.0)  # fewer connections in a second than are admitted
        for name, fault in PEERS.items():
            begin = len(target.sent)
            _count(faults, name, [] if fault(target, long) else ["silent"])
            if len(target.sent) - begin > _ENOUGH:
                print(f"{name}: {target.summary(begin)}", flush=True)  # noqa: T201
        target.end()
        _judge(faults, target)
        begun = time.monotonic()
        status = stream.stop(signal.SIGTERM)
        print(f"ended with status {status} within {time.monotonic() - begun:.1f} s")  # noqa: T201
        _count(faults, "the end", [f"lost: {stream.errors[-3:]}"] * (status != 0))
    _count(faults, "all", ["traceback"] * any("Traceback" in one for one in stream.errors))
    _count(faults, "state", ["lost"] * (not (folder / "tendon.json").exists()))
    _count(faults, "recording", ["lost"] * (not (folder / "live.rrd").exists()))
    return len(list(lines())) + len(PEERS)


def _judge(faults: Counter[str], target: Target) -> None:
    """Count what the good sender observed, and print it."""
    silence, memory = target.longest_silence(), peak(target.stream)
    print(  # noqa: T201
        f"good sender: {target.summary()}, longest silence {silence:.2f} s; memory {memory >> 20} MiB"
    )
    _count(faults, "good sender", ["hang"] * (silence > hang()) + ["lost"] * target.missing())
    _count(faults, "memory", ["memory"] * (memory > LARGE))


def peak(stream: Live) -> int:
    """Return the greatest resident memory so far [B]."""
    status = Path(f"/proc/{stream.process.pid}/status").read_text()
    matches = re.search(r"VmHWM:\s+(\d+) kB", status)
    return int(matches[1]) * 1024 if matches else 0


def _count(faults: Counter[str], name: str, observed: list[str]) -> None:
    for fault in observed:
        faults[fault.split()[0].rstrip(":")] += 1
        print(f"{name}: {fault}", flush=True)  # noqa: T201


def main() -> int:
    """Run the attack, and return 1 where anything happened that may not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--long", action="store_true", help="long floods, and every start")
    options = parser.parse_args()
    faults, begun = Counter[str](), time.monotonic()
    with tempfile.TemporaryDirectory() as home:
        number = attacked(faults, Path(home), long=options.long)
    for name, trial in islice(STARTS.items(), None if options.long else _FEW):
        with tempfile.TemporaryDirectory() as home:
            _count(faults, name, trial(Path(home)))
        number += 1
    print(f"{number} faults in {time.monotonic() - begun:.0f} s")  # noqa: T201
    print("wrong: " + (", ".join(f"{count} {what}" for what, count in (+faults).items()) or "none"))  # noqa: T201
    return int(bool(+faults))


if __name__ == "__main__":
    raise SystemExit(main())
