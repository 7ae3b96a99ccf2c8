"""Run the tests on the faults that `tests/mutants.py` samples: `python -m tests.mutants`.

Each fault is put into a copy of the code, where the tests that run its line have to fail; for a line that
runs once, when its file is imported, those that run any line of the file, and for a line of C those that call
an entry of the core which may reach its file. Tests that do not end in time count as failed, and are counted
apart in the last line. The core of the copy is built again by itself where a fault is in its C.
"""

import argparse
import ast
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from coverage import CoverageData

from tests.mutants import PACKAGES, ROOT, Mutant, sampled

COPIED = (
    "tssgeom",
    "pipelines",
    "tests",
    "benchmarks",
    "docs",
    "sample_shapes",
    "pyproject.toml",
    "README.md",
)
CORE = "tssgeom/core"
PATIENCE = 120.0
"""Time that the tests of one fault may take at a time [s]."""
_LATE = "no end within"
ROUNDS = (8, 40, 150)
"""Tests that are run at a time, until one fails."""
TARGET = 0.95
"""Share of faults that have to be detected [1]."""


class Chosen:
    """Which tests run which lines."""

    def __init__(self, path: Path) -> None:
        self.data = CoverageData(str(path))
        self.data.read()
        self.names = {f"tssgeom/{one.rpartition('/tssgeom/')[2]}": one for one in self.data.measured_files()}

    def of_line(self, file: str, first: int, last: int) -> set[str]:
        """Return the tests that run one of some lines, or of the file where these run at its import alone."""
        known = self.data.contexts_by_lineno(self.names.get(file, ""))
        run = [set(known[line]) for line in range(first, last + 1) if line in known]
        if run and set().union(*run) == {""}:
            run = [set(each) for each in known.values()]
        return {each.partition("|")[0] for each in set().union(*run)} - {""}

    def of(self, mutant: Mutant) -> list[str]:
        """Return the tests of a fault: those of its own package first, the files of tests in turn."""
        if mutant.file.endswith(".py"):
            tests = self.of_line(mutant.file, mutant.line, mutant.line)
        else:
            tests = set().union(*(self.of_entry[each] for each in self.entries(Path(mutant.file).name)))
        own = f"tests/{mutant.file.split('/')[1]}/"
        rng, rank = random.Random(0), defaultdict[str, int](int)
        order = list[tuple[int, bool, int, str]]()
        for turn, test in enumerate(rng.sample(sorted(tests), len(tests))):
            file = test.partition("::")[0]
            rank[file] += 1
            order.append((rank[file], not file.startswith(own), turn, test))
        return [each[3] for each in sorted(order)]

    @cached_property
    def of_entry(self) -> dict[str, set[str]]:
        """Tests by entry of the core."""
        entries, file = (
            ast.parse((ROOT / CORE / "_entries.py").read_text(encoding="utf-8")),
            f"{CORE}/_entries.py",
        )
        functions = [each for each in entries.body if isinstance(each, ast.FunctionDef)]
        return {
            each.name: self.of_line(file, each.body[0].lineno, each.end_lineno or 0) for each in functions
        }

    @cached_property
    def texts(self) -> dict[str, str]:
        """Text of each file of C."""
        paths = (each for each in (ROOT / CORE).iterdir() if each.suffix in (".c", ".h", ".inl"))
        return {each.name: each.read_text(encoding="utf-8") for each in paths}

    def entries(self, name: str) -> set[str]:
        """Return the entries of the core that may reach a file of C: by calls from file to file."""
        reached, new = set[str](), {name}
        while new:
            reached |= new
            made = {word for each in new for word in _functions(self.texts[each])}
            new = {each for each, text in self.texts.items() if made & set(re.findall(r"\w+(?=\()", text))}
            new |= {each for each, text in self.texts.items() if any(f'"{one}"' in text for one in reached)}
            new = {each for each in new if each.endswith((".c", ".inl"))} - reached
        made = {word.removeprefix("tss_") for each in reached for word in _functions(self.texts[each])}
        return made & set(self.of_entry)


def _functions(text: str) -> list[str]:
    """Return the functions that a file of C defines for others."""
    return re.findall(r"^(?!static)\w[\w *]*?\b(\w+)\([^;{}]*\)\s*\{", text, re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Verdict:
    """Result of a fault."""

    mutant: Mutant
    caught: bool
    by: str
    """The first test that failed, or why there is none."""
    took: float
    """Time that the tests took [s]."""

    @property
    def is_late(self) -> bool:
        """Whether it was caught by time alone."""
        return self.by.startswith(_LATE)


def run_tests(copy: Path, tests: Sequence[str]) -> tuple[bool, str]:
    """Run tests in the copy; return whether all pass, and the first that does not."""
    words = [sys.executable, "-m", "pytest", "-x", "-q", "-n0", "-p", "no:cacheprovider", *tests]
    env = {**os.environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(
            words, cwd=copy, env=env, capture_output=True, text=True, timeout=PATIENCE, check=False
        )
    except subprocess.TimeoutExpired:
        return False, f"{_LATE} {PATIENCE:g} s"
    failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED ", "ERROR "))]
    by = failed[0].split(" - ")[0].rpartition("/")[2] if failed else f"exit status {done.returncode}"
    return done.returncode == 0, by


def verdicts_of(copy: Path, mutants: Sequence[Mutant], chosen: Chosen) -> Iterator[Verdict]:
    """Put each fault into the copy, run its tests, and take it out again."""
    for mutant in mutants:
        path, tests, begun = copy / mutant.file, chosen.of(mutant), time.monotonic()
        text = path.read_text(encoding="utf-8")
        path.write_text(mutant.put_into(text), encoding="utf-8")
        passed, by, first = True, "no test runs it", 0
        for count in ROUNDS:
            if passed and (some := tests[first : first + count]):
                passed, by = run_tests(copy, some)
                by = f"none of {first + len(some)} tests, of {len(tests)}" if passed else by
                first += count
        path.write_text(text, encoding="utf-8")
        yield Verdict(mutant, not passed, by, time.monotonic() - begun)


def main() -> int:
    """Run the tests on each fault and print the result."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants")
    parser.add_argument("packages", nargs="*", default=PACKAGES, metavar="PACKAGE")
    parser.add_argument("--count", type=int, default=200, help="how many faults [1]")
    parser.add_argument("--seed", type=int, default=1, help="which ones")
    parser.add_argument("--data", type=Path, default=ROOT / ".coverage", help="what pytest --cov has written")
    given = parser.parse_args()
    if not given.data.is_file():
        parser.error(f"{given.data} is missing: run pytest --cov --cov-context=test first")
    verdicts, chosen = list[Verdict](), Chosen(given.data)
    if len(chosen.data.measured_contexts()) < 2:
        parser.error(f"{given.data} names no tests: run pytest --cov --cov-context=test with -n1 or more")
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        for name in COPIED:
            whole = (ROOT / name).is_dir()
            (shutil.copytree if whole else shutil.copy2)(ROOT / name, copy / name)
        for each in verdicts_of(copy, sampled(given.count, given.seed, tuple(given.packages)), chosen):
            verdicts.append(each)
            mark = "caught  " if each.caught else "SURVIVED"
            text = each.mutant.described((ROOT / each.mutant.file).read_text(encoding="utf-8"))
            sys.stdout.write(f"{mark} {each.took:5.1f} s  {text}\n{'':18}by {each.by}\n")
            sys.stdout.flush()
    caught = sum(each.caught for each in verdicts)
    sys.stdout.write(f"{caught} of {len(verdicts)} faults detected, {caught / max(len(verdicts), 1):.0%}")
    sys.stdout.write(f"; {sum(each.is_late for each in verdicts)} of them by time alone\n")
    return int(caught < TARGET * len(verdicts))
