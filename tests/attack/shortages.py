"""The attack by shortage, `python -m tests.attack.shortages`: what does not fit ends in one line.

A command gets a limited address space, or, where this user may mount one, a disk that is too small for it.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.attack.long_commands import Command, commands
from tests.attack.signals import half_written

_PROGRAM = "from pipelines.cli import main; main()"
_SPACE = (0.75, 2.0)
"""Least and greatest address space [GiB]; chosen: Python alone fits, and every command fits."""
_SLOW = 120.0  # s, on cores that no other program uses


def ended(command: Command, limit: int | None = None) -> subprocess.CompletedProcess[bytes] | None:
    """Run a command in a limited address space [B]; None where it does not end."""

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_AS, (limit, limit))

    program = [sys.executable, "-c", _PROGRAM, *map(str, command)]
    slow = _SLOW * max(os.getloadavg()[0] / (os.cpu_count() or 1), 1.0)
    try:
        return subprocess.run(program, check=False, capture_output=True, timeout=slow, preexec_fn=limited)
    except subprocess.TimeoutExpired:
        return None


def faults(done: subprocess.CompletedProcess[bytes] | None, word: str) -> Iterator[str]:
    """Yield what must not be at the end of a command, whose message has a word where it fails."""
    if done is None:
        yield "hang"
        return
    err = done.stderr.decode(errors="replace")
    if done.returncode not in (0, 1, 2):
        yield f"died ({done.returncode}) {err[-300:]!r}"
    elif "Traceback" in err or "please report it" in err:
        yield f"traceback {err[-900:]}"
    elif done.returncode and not any(
        line.startswith("tssgeom: ") and word in line for line in err.splitlines()
    ):
        yield f"silent {err[-300:]!r}"


def little_memory(command: Command, folder: Path, times: int) -> Iterator[str]:
    """Run a command in little memory, and yield what must not be."""
    for _ in range(times):
        gib = random.uniform(*_SPACE)
        shutil.rmtree(folder / "out", ignore_errors=True)
        done = ended(command, int(gib * (1 << 30)))
        for fault in (*faults(done, ""), *half_written(folder)):
            yield f"{gib:.2f} GiB: {fault}"


def full_disk(command: Command, folder: Path, times: int) -> Iterator[str]:
    """Run a command on a disk that is too small, and yield what must not be."""
    out = folder / "out"
    shutil.rmtree(out, ignore_errors=True)
    ended(command)
    files = [path.stat().st_size for path in out.rglob("*") if path.is_file()] if out.exists() else []
    for _ in range(times if files else 0):
        kib = int(random.uniform(4, max(sum(files) >> 10, 8)))
        with _small_disk(out, kib):
            for fault in (*faults(ended(command), " room"), *half_written(folder)):
                yield f"{kib} KiB: {fault}"


@contextmanager
def _small_disk(folder: Path, kib: int) -> Iterator[None]:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={kib}k", "tmpfs", folder], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", folder], check=True)


def main() -> int:
    """Run the attack, and return 1 where anything happened that may not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("of", choices=["memory", "disk"])
    parser.add_argument("--times", type=int, default=6, help="limits for each command, at random")
    parser.add_argument("--only", default="", help="commands whose name begins so")
    options = parser.parse_args()
    random.seed(26)
    trial: Callable[[Command, Path, int], Iterator[str]] = (
        little_memory if options.of == "memory" else full_disk
    )
    counts = Counter[str]()
    with tempfile.TemporaryDirectory() as home:
        folder = Path(home)
        (folder / "temporary").mkdir()
        os.environ["TMPDIR"] = tempfile.tempdir = str(folder / "temporary")
        for command in commands(folder):
            if str(command[0]).startswith(options.only):
                for fault in trial(command, folder, options.times):
                    counts[fault.split()[2]] += 1
                    print(f"{command[0]} with {fault}", flush=True)  # noqa: T201
                print(f"{command[0]}: done", flush=True)  # noqa: T201
    print("faults: " + (", ".join(f"{count} {what}" for what, count in counts.items()) or "none"))  # noqa: T201
    return int(bool(counts))


if __name__ == "__main__":
    raise SystemExit(main())
