"""The tables in docs/benchmarks.md and the short one in README.md, measured anew.

    python -m benchmarks.readme [PART…] [--quick]

Runs the benchmarks one after the other, some two hours in all, and writes what each shows as soon as it is
done. Where one fails, what the documents say of it stays as it was, and the exit status is 1. `--quick` is to
try whether all works: it runs the quick benchmarks, prints what they show, and writes nothing.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from benchmarks.readme_parts import PARTS, Part, Shown, tables
from benchmarks.tables import table
from tssgeom.atomic import write_text

ROOT = Path(__file__).parents[1]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmarks and return the exit code."""
    options = _options(arguments)
    failed = [
        part.name
        for part in PARTS
        if part.name in (options.parts or [each.name for each in PARTS])
        and not done(part, ROOT, quick=options.quick)
    ]
    if failed:
        print(f"failed, and left as it was: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    summary = (__doc__ or "").split("\n")[0]
    parser = argparse.ArgumentParser(prog="python -m benchmarks.readme", description=summary)
    names = ", ".join(part.name for part in PARTS)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"only these: {names}")
    parser.add_argument("--quick", action="store_true", help="try whether all works, and write nothing")
    options = parser.parse_args(arguments)
    if unknown := set(options.parts) - {part.name for part in PARTS}:
        parser.error(f"no part is called {', '.join(sorted(unknown))}: choose from {names}")
    return options


def done(part: Part, root: Path, *, quick: bool) -> bool:
    """Run one benchmark, and tell whether it went well."""
    words = [f"benchmarks.{part.name}", *(part.quick if quick else part.full)]
    print(f"python -m {' '.join(words)}", flush=True)
    call = [sys.executable, "-m", *words, "--markdown"]
    ended = subprocess.run(call, stdout=subprocess.PIPE, text=True, check=False, cwd=ROOT)
    try:
        if ended.returncode:
            raise LookupError(f"exit status {ended.returncode}")
        shown = part.shown(ended.stdout)
    except (LookupError, ValueError) as error:
        print(f"{ended.stdout}{part.name}: {error}", file=sys.stderr)
        return False
    machine = ended.stdout.splitlines()[0]
    if quick:
        print(f"\n{shown.body}\n\n{part.label}: {'; '.join(shown.key)}\n", flush=True)
    else:
        write(root, part, machine, " ".join(words), shown)
    return True


def write(root: Path, part: Part, machine: str, words: str, shown: Shown) -> None:
    """Put what a benchmark showed into both documents."""
    body = f"`python -m {words}`, {machine}\n\n{shown.body}"
    _change(root / "docs" / "benchmarks.md", part.name, lambda _: body)
    _change(root / "README.md", "benchmarks", lambda old: short(old, machine, part.label, shown.key))


def short(old: str, machine: str, label: str, key: Sequence[str]) -> str:
    """Return README's table with one row changed.

    It names one machine, so rows that another one measured go.
    """
    named = "Measured on: " + re.sub(r", load [\d.]+", "", machine).removeprefix("machine: ")
    known = {row[0]: row for row in tables(old)[0][1:]} if named in old.splitlines() else {}
    known[label] = [label, *key]
    rows = [known[part.label] for part in PARTS if part.label in known]
    drawn = table(["measured", "tssgeom", "beside it", "ratio"], rows, text_columns=3, markdown=True)
    return f"{drawn}\n\n{named}"


def _change(path: Path, name: str, new: Callable[[str], str]) -> None:
    write_text(path, between(path.read_text(encoding="utf-8"), name, new))


def between(text: str, name: str, new: Callable[[str], str]) -> str:
    """Return a document with what stands between two marks changed; LookupError where they are not there."""
    first, last = f"<!-- {name}: measured -->\n", f"\n<!-- {name}: end -->"
    head, begun, rest = text.partition(first)
    old, ended, tail = rest.partition(last)
    if not (begun and ended):
        raise LookupError(f"there is no place for {name}: write {first.strip()} and {last.strip()}")
    return f"{head}{first}{new(old)}{last}{tail}"


if __name__ == "__main__":
    sys.exit(main())
