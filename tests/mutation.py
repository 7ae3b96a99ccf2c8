"""Run the mutants of `tests/mutants.py`: `python -m tests.mutants`.

Each is put into a copy of the code. Its tests have to pass there without it, otherwise the mutant proves
nothing; a test that does not end in time counts as one that fails. The core of the copy is built again where
a mutant is in its C.
"""

import argparse
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.mutants import MUTANTS, Mutant

ROOT = Path(__file__).parents[1]
COPIED = ("tssgeom", "pipelines", "tests", "benchmarks", "sample_shapes", "pyproject.toml")
PATIENCE = 120.0
"""Time that the tests of one mutant may take [s]."""
TARGET = 0.95
"""Share of mutants that have to be detected [1]."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Result of a mutant."""

    mutant: Mutant
    caught: bool
    by: str
    """The first test that failed, or why there is none."""
    took: float
    """Time that the tests took [s]."""


def run_tests(copy: Path, tests: str) -> tuple[bool, str]:
    """Run tests in the copy; return whether all pass, and the first that does not."""
    words = [sys.executable, "-m", "pytest", "-x", "-q", "-n0", "-p", "no:cacheprovider", *shlex.split(tests)]
    env = {**os.environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(
            words, cwd=copy, env=env, capture_output=True, text=True, timeout=PATIENCE, check=False
        )
    except subprocess.TimeoutExpired:
        return False, f"no end within {PATIENCE:g} s"
    if done.returncode not in (0, 1):
        raise RuntimeError(f"{tests}: pytest could not run them:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED ", "ERROR "))]
    return done.returncode == 0, failed[0].split(" - ")[0].rpartition("::")[2] if failed else ""


def verdicts_of(copy: Path, mutants: Sequence[Mutant]) -> Iterator[Verdict]:
    """Put each mutant into the copy, run its tests, and take it out again."""
    sound = dict[str, bool]()
    for mutant in mutants:
        path = copy / mutant.file
        text = path.read_text(encoding="utf-8")
        if text.count(mutant.old) != 1:
            raise RuntimeError(f"{mutant.text}: the text is there {text.count(mutant.old)} times")
        if mutant.tests not in sound:
            sound[mutant.tests] = run_tests(copy, mutant.tests)[0]
        if not sound[mutant.tests]:
            raise RuntimeError(f"{mutant.tests}: they fail without any mutant")
        begun = time.monotonic()
        path.write_text(text.replace(mutant.old, mutant.new), encoding="utf-8")
        passed, by = run_tests(copy, mutant.tests)
        path.write_text(text, encoding="utf-8")
        yield Verdict(mutant, not passed, by or "no test", time.monotonic() - begun)


def main() -> int:
    """Run the tests on each mutant and print the result."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants")
    parser.add_argument("words", nargs="*", default=[""])
    words = parser.parse_args().words
    chosen = [each for each in MUTANTS if any(word in f"{each.text} {each.tests}" for word in words)]
    verdicts = list[Verdict]()
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        for name in COPIED:
            whole = (ROOT / name).is_dir()
            (shutil.copytree if whole else shutil.copy2)(ROOT / name, copy / name)
        for each in verdicts_of(copy, chosen):
            verdicts.append(each)
            mark = "caught  " if each.caught else "SURVIVED"
            sys.stdout.write(f"{mark} {each.took:5.1f} s  {each.mutant.text}\n{'':18}by {each.by}\n")
            sys.stdout.flush()
    caught = sum(each.caught for each in verdicts)
    sys.stdout.write(f"{caught} of {len(verdicts)} mutants caught, {caught / max(len(verdicts), 1):.0%}\n")
    return int(caught < TARGET * len(verdicts))


if __name__ == "__main__":
    sys.exit(main())
