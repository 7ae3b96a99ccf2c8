"""The attack by kill -9, `python -m tests.attack.kills [--long]`: a batch goes on to the same bytes.

Some of the kills are signals that it hears, or a disk that gets full, and the clock of its inputs leaps.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import numpy as np

from tests.attack.files import warmed
from tests.attack.trial import attempt

_KILLS, _MANY = 12, 50
"""Of the short and of the long form."""
_INPUTS = 8
_LONG = 60.0  # s on a processor that a batch may take
_SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
_ROOM, _LITTLE = 64 << 10, (8, 400)  # KiB of a disk, and those left on it where it gets full
_CLOCKS = (0.0, 1.7e9, 4e9)  # s since 1970, of the last change of a file


def moving(path: Path, frames: int) -> Path:
    """Write a recording of a bend that sways while it is pulled and released."""
    numbers, along = np.random.default_rng(frames), np.linspace(0.0, 1.0, 20)
    lines = list[str]()
    for k in range(frames):
        angle = (2.0 + 0.3 * np.sin(k / 4)) * along
        points = 50 * np.column_stack([np.sin(angle), 1 - np.cos(angle), 0.1 * along])
        points = (points + numbers.normal(0, 0.05, points.shape)).round(4).tolist()
        tension = round(10 * abs(float(np.sin(k / 5))), 3)
        lines.append(json.dumps({"t": k / 10, "points": points, "unit": "mm", "tension_in_N": tension}))
    path.write_text("\n".join(lines) + "\n")
    return path


@contextmanager
def own_disk(folder: Path) -> Iterator[None]:
    """Give a folder a disk of its own, as who may mount one can."""
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={_ROOM}k", "tmpfs", folder], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", folder], check=True)


def limit_disk(folder: Path, left: int = _ROOM) -> None:
    """Let so many KiB be left on the disk of a folder."""
    used = shutil.disk_usage(folder).used >> 10
    subprocess.run(["mount", "-o", f"remount,size={used + left}k", folder], check=True)


def content(out: Path) -> dict[str, bytes]:
    """Return all files of a batch, its notes and drafts too."""
    files = (path for path in out.rglob("*") if path.is_file() and path.name != "lock")
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in files}


def killed(folder: Path, kills: int, workers: int) -> list[str]:
    """Kill a batch many times, changing its inputs meanwhile, let it end, and return what is wrong."""
    inputs, out = folder / "in", folder / "out"
    inputs.mkdir(parents=True)
    for k in range(_INPUTS):
        moving(inputs / f"run{k}.jsonl", 4 + k)
    command = ["batch", inputs, "--no-pictures", "--workers", str(workers), "--quiet", "--out"]
    elapsed = attempt([*command, folder / "first"], _LONG).elapsed
    hits, renamed, mounts = 0, 0, os.geteuid() == 0
    out.mkdir()
    with own_disk(out) if mounts else nullcontext():
        for _ in range(10 * kills):  # a batch that resumes ends sooner: then it begins anew
            if hits >= kills:
                break
            if mounts and random.random() < 0.2:
                limit_disk(out, random.randint(*_LITTLE))
                hits += attempt([*command, out], _LONG).status == 1
                limit_disk(out)
            ending = attempt([*command, out], _LONG, (random.choice(_SIGNALS), random.uniform(0.0, elapsed)))
            hits += ending.late is not None
            if ending.late is None or random.random() < 0.3:
                path = moving(inputs / f"run{random.randrange(_INPUTS)}.jsonl", random.randrange(3, 12))
                os.utime(path, (clock := random.choice(_CLOCKS), clock))
                other = inputs / f"other{renamed}.jsonl"
                other.unlink(missing_ok=True)
                renamed += 1
                moving(inputs / f"other{renamed}.jsonl", 5)
        last, undisturbed = (attempt([*command, where], _LONG) for where in (out, folder / "undisturbed"))
        faults = [
            f"{one.status}: {one.err[-300:]!r}" for one in (last, undisturbed) if one.faults() or one.status
        ]
        here, there = content(out), content(folder / "undisturbed")
        faults += [
            f"{name} is not as undisturbed"
            for name in here.keys() | there.keys()
            if here.get(name) != there.get(name)
        ]
        faults += [] if attempt(["verify", out]).status == 0 else ["verify finds damage"]
    print(f"{workers} workers: killed {hits} times, {len(there)} files, {len(faults)} faults")  # noqa: T201
    return faults


def main() -> int:
    """Run the attack, and return 1 where anything happened that may not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--long", action="store_true", help=f"{_MANY} kills instead of {_KILLS}, and a quarter of two workers"
    )
    many = _MANY if parser.parse_args().long else _KILLS
    warmed()
    with tempfile.TemporaryDirectory() as home:
        faults = [*killed(Path(home, "one"), many, 1), *killed(Path(home, "two"), max(many // 4, 3), 2)]
    for fault in faults:
        print(fault)  # noqa: T201
    return int(bool(faults))


if __name__ == "__main__":
    raise SystemExit(main())
