"""The attack by signals, `python -m tests.attack.signals`: each command ends at once and cleanly."""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow.parquet as papq

from pipelines.interruption import MESSAGE, SIGNALS
from tests.attack.files import warmed
from tests.attack.long_commands import commands
from tests.attack.trial import Ending, attempt

PROMPT = 0.5
"""Longest time from a signal to the end [s]; chosen: it feels immediate."""
_BEGUN = 0.2  # s until a fork hears signals as a command does; before, it dies of them
_LONG = 60.0  # s on a processor that a command may take undisturbed
_SOON = 1.0  # s after the start at which the short form sends its signal; chosen: commands are at work then


def faults(ending: Ending, number: int, folder: Path) -> Iterator[str]:
    """Yield what must not be after a signal."""
    if ending.late is None:
        return
    if ending.late > prompt():
        yield f"late {ending.late:.2f} s"
    message = f"tssgeom: {MESSAGE}"
    after_its_work = ending.status is None and bool(ending.out)  # then a signal ends it as any program
    if ending.status not in (0, 1, 128 + number) and not after_its_work:
        yield f"status {ending.status}"
    if ending.status == 128 + number and ending.err.decode().splitlines()[-1:] != [message]:
        yield f"message {ending.err[-200:]!r}"
    if b"Traceback" in ending.err:
        yield "traceback"
    if ending.left:
        yield "process left"
    yield from half_written(folder)


def prompt() -> float:
    """Return the time from a signal to the end that is late [s]; longer where others use the cores."""
    return PROMPT * max(os.getloadavg()[0] / (os.cpu_count() or 1), 1.0)


def half_written(folder: Path) -> Iterator[str]:
    """Yield what a command that did not finish has left of files."""
    for path in [*(folder / "temporary").iterdir(), *(folder / "out").rglob(".*")]:
        if path.name != ".batch":
            yield f"draft {path.relative_to(folder)}"
    for path in (folder / "out").rglob("*"):
        try:
            if path.suffix == ".parquet":
                papq.read_table(path)
            elif path.suffix == ".json":
                json.loads(path.read_text("utf-8"))
        except ValueError as error:
            yield f"half-written {path.relative_to(folder)} ({error})"


def main() -> int:
    """Run the attack, and return 1 where anything happened that may not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=6, help="signals to each command, at random moments")
    parser.add_argument(
        "--short", action="store_true", help="one signal to each command, soon after its start"
    )
    parser.add_argument("--only", default="", help="commands whose name begins so")
    options = parser.parse_args()
    random.seed(26)
    warmed()
    bad = 0
    with tempfile.TemporaryDirectory() as home:
        folder = Path(home)
        (folder / "temporary").mkdir()
        os.environ["TMPDIR"] = tempfile.tempdir = str(folder / "temporary")
        for command in commands(folder):
            if not str(command[0]).startswith(options.only):
                continue
            elapsed, late = _SOON, list[float]()
            if not options.short:
                whole = attempt(command, _LONG)
                elapsed = whole.elapsed
                if whole.status not in (0, 1):
                    print(f"{command[0]}: does not run undisturbed: {whole.err[-300:]!r}")  # noqa: T201
                    bad += 1
            for turn in range(1 if options.short else options.times):
                begin = _SOON if options.short else _BEGUN
                number, after = SIGNALS[turn % len(SIGNALS)], random.uniform(begin, elapsed)
                shutil.rmtree(folder / "out", ignore_errors=True)
                ending = attempt(command, _LONG, (number, after))
                late += [] if ending.late is None else [ending.late]
                for fault in faults(ending, number, folder):
                    bad += 1
                    print(f"{command[0]} after {after:.2f} s of {elapsed:.2f} s: {fault}")  # noqa: T201
            slow = sum(each > PROMPT for each in late)
            worst = max(late, default=0.0)
            print(  # noqa: T201
                f"{command[0]}: {elapsed:.1f} s, {len(late)} signals, "
                f"the end after {np.median(late or [0.0]):.3f} s (median), {worst:.3f} s (longest), "
                f"{slow} late",
                flush=True,
            )
    print(f"faults: {bad or 'none'}")  # noqa: T201
    return int(bool(bad))


if __name__ == "__main__":
    raise SystemExit(main())
