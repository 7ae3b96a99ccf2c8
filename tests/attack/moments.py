"""The attack at random moments, `python -m tests.attack.moments [--seconds S]`, on streams that keep a state.

Each is killed, stopped, hung up, or gets a full disk, while the clocks leap. After each moment the kept state
is, byte for byte, that of an undisturbed stream which got the same frames up to there, the recordings can be
read, and the next stream goes on from both.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any

from rerun.chunk import RrdReader

from tests.attack.kills import limit_disk, own_disk
from tests.attack.signals import prompt
from tests.live_process import PATIENCE, START, Live, line, points_mm, retimed
from tssgeom.errors import TssgeomError
from tssgeom.io.formats.states import read_state

_LEGS = 6  # streams of one state and its recordings; chosen
_FRAMES = 400  # of one stream; its moment comes while they are sent, or at their end
_WAYS = ("kill", "kill alone", "stop", "end", "hang up", "full disk")
_ENDS = {"end": signal.SIGTERM, "hang up": signal.SIGHUP}
_TEXTS = [line(points_mm(24, 0.02 * k, k), 0.02 * k) for k in range(100)]
_LITTLE = (8, 400)  # KiB left on a disk that gets full
_LEAPING = (
    "import random, time; real = time.time; "
    "time.time = lambda: real() + random.choice((0.0, 1e9, -1e9)); " + START[2]
)


def frames(begin: float, *, leaping: bool) -> list[bytes]:
    """Return frames of which each has a tension of its own, and whose clock may leap, forwards or back."""
    moment, made = begin, list[bytes]()
    for k in range(_FRAMES):
        far = leaping and random.random() < 0.02
        moment = round(moment + (random.choice((3600.0, 1e6, -1e3)) if far else 0.02), 6)
        content = json.loads(retimed(_TEXTS[k % len(_TEXTS)], moment))
        content["tension_in_N"] = round(8.0 + 6.0 * math.sin(0.04 * k) + random.uniform(0.0, 0.2), 6)
        made.append(json.dumps(content).encode() + b"\n")
    return made


def kept(path: Path) -> bytes:
    """Return a state that is kept; nothing where there is none."""
    return path.read_bytes() if path.exists() else b""


def undisturbed(state: bytes, given: list[bytes], folder: Path) -> bytes:
    """Return the state that a stream keeps which begins with one and gets all of some frames."""
    path = folder / "undisturbed.json"
    path.unlink(missing_ok=True)
    if state:
        path.write_bytes(state)
    command = [*START, "--sink", "none", "--state", str(path)]
    subprocess.run(command, input=b"".join(given), check=True, capture_output=True, timeout=PATIENCE)
    return path.read_bytes()


def disturbed(way: str, given: list[bytes], folder: Path) -> Iterator[str]:
    """Give frames to a stream and disturb it at a moment; yield what may not be, apart from its files."""
    options = ["--state", str(folder / "tendon.json"), "--record", str(folder / "run.rrd")]
    command = [sys.executable, "-c", _LEAPING, "live", *options]
    pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process: Any = subprocess.Popen(command, **pipes)
    stream = Live(process)
    try:
        stream.await_ready()
        until = time.monotonic() + random.uniform(0.1, 3.0)
        for text in given:
            if time.monotonic() > until:
                break
            with suppress(BrokenPipeError):
                stream.input.write(text)
                stream.input.flush()
            while (said := stream.output.readline()) and json.loads(said).get("stale"):
                pass
        yield from _ended(way, stream)
        if any("Traceback" in each for each in stream.errors):
            yield f"traceback {stream.errors[-3:]}"
    finally:
        stream.close()


def _ended(way: str, stream: Live) -> Iterator[str]:
    """End a stream in one way; yield what may not be."""
    beside = stream.children()
    if way in ("kill", "kill alone"):
        for number in (stream.process.pid, *(beside if way == "kill" else ())):
            with suppress(ProcessLookupError):
                os.kill(number, signal.SIGKILL)
        stream.process.wait(PATIENCE)
        deadline = time.monotonic() + PATIENCE
        while any(map(_runs, beside)) and time.monotonic() < deadline:
            time.sleep(0.01)
        return
    if way == "stop":
        stopped = [stream.process.pid, *random.sample(beside, random.randint(0, len(beside)))]
        for number in stopped:
            os.kill(number, signal.SIGSTOP)
        time.sleep(random.uniform(0.0, 0.5))
        for number in stopped:
            os.kill(number, signal.SIGCONT)
    begun, status = time.monotonic(), stream.stop(_ENDS.get(way, signal.SIGINT))
    if status not in ((0, 1) if way == "full disk" else (0,)):
        yield f"status {status} {stream.errors[-3:]}"
    if (took := time.monotonic() - begun) > prompt() + 5.0:  # a recording is put in order meanwhile
        yield f"late {took:.1f} s"


def _runs(number: int) -> bool:
    with suppress(OSError):
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def faults(before: bytes, given: list[bytes], folder: Path, home: Path, *, leaping: bool) -> Iterator[str]:
    """Yield what may not be in the files that a stream has left."""
    after = kept(folder / "tendon.json")
    if after != before:
        try:
            state: Any = read_state(folder / "tendon.json")
        except TssgeomError as error:
            yield f"lost state: {error}"
            return
        tensions = [json.loads(text)["tension_in_N"] for text in given]
        count = tensions.index(state.tension_in) + 1 if state.tension_in in tensions else 0
        other = undisturbed(before, given[:count], home)
        if not count or _without_time(other, leaping) != _without_time(after, leaping):
            yield f"wrong state: not that of an undisturbed stream after {count} frames"
    for path in folder.glob("*.rrd"):
        try:
            if path.stat().st_size:
                deque(RrdReader(str(path)).stream(), maxlen=0)
        except Exception as error:  # whatever the reader of recordings raises
            yield f"lost recording: {path.name} {error!r:.200}"


def _without_time(state: bytes, leaping: bool) -> bytes | dict[str, object]:
    """Return a state, without its time where clocks leapt: then the time that has passed here counts."""
    return {key: value for key, value in json.loads(state).items() if key != "time"} if leaping else state


def legs(seed: int, home: Path, ways: Sequence[str]) -> Iterator[tuple[str, list[str]]]:
    """Disturb one stream after the other, which have one state; yield the way and the faults of each."""
    random.seed(seed)
    warnings.filterwarnings("ignore", "RRD file has no footer")  # of a stream that was killed
    folder = home / "kept"
    folder.mkdir()
    with own_disk(folder) if "full disk" in ways else nullcontext():
        for _ in range(_LEGS):
            way, leaping, before = random.choice(ways), random.random() < 0.5, kept(folder / "tendon.json")
            begin = (json.loads(before)["time"] if before else 0.0) + 0.02
            given = frames(begin, leaping=leaping)
            if way == "full disk":
                limit_disk(folder, random.randint(*_LITTLE))
            wrong = list(disturbed(way, given, folder))
            if way == "full disk":
                limit_disk(folder)
            yield way, wrong + list(faults(before, given, folder, home, leaping=leaping))


def main() -> int:
    """Run the attack, and return 1 where anything happened that may not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    ways = _WAYS if os.geteuid() == 0 else _WAYS[:-1]  # who may mount a disk
    counts, bad, seed, begun = Counter[str](), 0, given.seed, time.monotonic()
    while time.monotonic() < begun + given.seconds:
        with tempfile.TemporaryDirectory() as home:
            for way, wrong in legs(seed, Path(home), ways):
                counts[way] += 1
                bad += len(wrong)
                for each in wrong:
                    print(f"--seed {seed}, {way}: {each}", flush=True)  # noqa: T201
        seed += 1
    of = ", ".join(f"{count} {way}" for way, count in counts.items())
    print(f"{counts.total()} moments ({of}) in {time.monotonic() - begun:.0f} s; {bad} faults")  # noqa: T201
    return int(bool(bad))


if __name__ == "__main__":
    raise SystemExit(main())
