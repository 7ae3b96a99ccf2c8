"""The tables in docs/benchmarks.md and the short one in README.md, measured anew.

    python -m benchmarks.readme [PART…] [--quick]

Runs the benchmarks one after the other, some two hours in all, and writes what each shows as soon as it is
done. Where one fails, its part of the documents stays as it was, and the exit status is 1. `--quick` is to
try whether all works: it runs the quick benchmarks, prints what they show, and writes nothing.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks import ABSENT, table
from benchmarks.estimators import OURS
from tssgeom.atomic import write_text

Cells = list[list[str]]
"""A table as it was printed: the header, then the rows."""


@dataclass(frozen=True, slots=True)
class Extract:
    """What documents show of one run."""

    body: str
    """For docs/benchmarks.md."""
    key: Sequence[str]
    """For README: this project, what stands beside it, the ratio."""


@dataclass(frozen=True, slots=True)
class Part:
    """One benchmark in the documents."""

    name: str
    """Its module, and its mark in docs/benchmarks.md."""
    label: str
    """What README calls it."""
    full: tuple[str, ...]
    quick: tuple[str, ...]
    """Arguments of a run worth publishing, and of one that only tries whether all works."""
    extract: Callable[[str], Extract]
    """From what the benchmark printed; LookupError where something is missing."""


def tables(text: str) -> list[Cells]:
    """Return the Markdown tables of a text, their rules left out."""
    result, before = list[Cells](), ""
    for line in text.splitlines():
        if line.startswith("| "):
            cells = [cell.strip() for cell in line[1:-1].split("|")]
            if not before.startswith("| "):
                result.append([])
            if set("".join(cells)) - set("-:"):
                result[-1].append(cells)
        before = line
    return result


def cell(printed: Cells, row: str, column: str) -> str:
    """Return the cell of the first row that begins with a text."""
    return _row(printed, row)[_column(printed, column)]


def _row(printed: Cells, begins: str) -> list[str]:
    try:
        return next(row for row in printed[1:] if row[0].startswith(begins))
    except StopIteration:
        raise LookupError(f"no row begins with {begins!r}") from None


def _column(printed: Cells, name: str) -> int:
    if name not in printed[0]:
        raise LookupError(f"no column is called {name!r}, only {', '.join(printed[0])}")
    return printed[0].index(name)


def _rendered(printed: Cells, text_columns: int) -> str:
    return table(printed[0], printed[1:], text_columns=text_columns, markdown=True)


def _accuracy(text: str) -> Extract:
    """Of every cell the bound, this project and its best peer."""
    printed = tables(text)[1]
    estimator, rms, held, count = (_column(printed, name) for name in ("estimator", "rms", "95 % Φ", "count"))
    rows = list[list[str]]()
    for row in printed[1:]:
        if row[estimator] == "bound":
            rows.append([" ".join(row[0].split()), row[rms]])
        elif row[estimator] == "auto":
            rows[-1] += [row[rms], row[held], row[count]]
        elif row[estimator] not in OURS:
            rows[-1][1:1] = [row[estimator], row[rms]]
    header = ["rms of Φ [%]", "best peer", "its rms", "bound", "tssgeom", "95 % hold [%]", "right count [%]"]
    rendered = [header, *rows]
    _, peer, theirs, bound, mine, *_ = _row(rendered, "7 pieces")
    ratio = f"{float(theirs) / float(mine):.3g} ×"
    key = [f"{mine} %", f"Cramér–Rao bound {bound} %, {peer} {theirs} %", ratio]
    return Extract(_rendered(rendered, 2), key)


def _speed(text: str) -> Extract:
    printed = tables(text)
    smooth, pieces, tendon = printed[2], printed[3], printed[6]
    mine = "whole frame, stations unknown"
    whole, pelt, kernel = (
        cell(smooth, row, "p50 [µs]") for row in (mine, "scipy + ruptures PELT", "scipy + ruptures kernel")
    )
    ratios = [cell(smooth, mine, name) for name in ("PELT / it", "kernel / it")]
    beside = f"splprep + ruptures: {pelt} µs (PELT), {kernel} µs (kernel, C); no tendon, no error bars"
    step = f"One step of the tendon:\n\n{_rendered(tendon, 0)}"
    body = f"A frame of 200 points on a smooth route:\n\n{_rendered(smooth, 1)}\n\n"
    body += f"On 7 pieces:\n\n{_rendered(pieces, 1)}\n\n{step}"
    return Extract(body, [f"{whole} µs", beside, " ×, ".join(ratios) + " ×"])


def _live(text: str) -> Extract:
    latency, followed, pictures = tables(text)
    times = [cell(latency, "--view --record", name) for name in ("p50", "p99", "p99.9")]
    key = [f"{' / '.join(times)} ms", "wanted: at most 0.5 / 1 / 3 ms", ABSENT]
    rig = f"A rig that is followed, 200 frames a second:\n\n{_rendered(followed, 2)}"
    return Extract(f"{_rendered(latency, 2)}\n\n{rig}\n\nPictures:\n\n{_rendered(pictures, 1)}", key)


def _batch(text: str) -> Extract:
    speed, pieces, large = tables(text)
    count = speed[-1][0]
    columns = ("frames/s", "PELT/s", "kernel/s", "to PELT", "to kernel")
    mine, pelt, kernel, to_pelt, to_kernel = (cell(speed, count, name) for name in columns)
    beside = f"splprep + ruptures in as many: {pelt}/s (PELT), {kernel}/s (kernel, C)"
    key = [f"{mine}/s", beside, f"{to_pelt} ×, {to_kernel} ×"]
    body = f"A smooth route:\n\n{_rendered(speed, 0)}\n\nSeven pieces:\n\n{_rendered(pieces, 0)}\n\n"
    return Extract(f"{body}One long recording:\n\n{_rendered(large, 0)}", key)


def _discovery(text: str) -> Extract:
    targets, *_, peers = tables(text)
    kept = [row for row in targets if row[-1] != ABSENT]
    others = [f"{row[0]} {row[1]}" for row in peers[2:] if row[1] != ABSENT]
    beside = ", ".join([f"wanted: {cell(targets, 'right name first', 'target')}", *others])
    key = [cell(targets, "right name first", "reached"), beside, ABSENT]
    return Extract(f"{_rendered(kept, 2)}\n\n{_rendered(peers, 1)}", key)


PARTS = (
    Part(
        "accuracy",
        "error of Φ, 7 pieces, 200 points, 0.5 mm, stations and noise unknown",
        ("--quick", "--trials", "200"),
        ("--quick",),
        _accuracy,
    ),
    Part(
        "speed",
        "a frame of 200 points on a smooth route, sensed points to elongation, one core",
        (),
        ("--quick",),
        _speed,
    ),
    Part(
        "load",
        "`live` with `--view --record`, 1000 frames/s: latency p50 / p99 / p99.9",
        (),
        ("--quick",),
        _live,
    ),
    Part("batch", "frames of 200 points through `batch`, every core", (), ("--quick",), _batch),
    Part(
        "discovery",
        "`discover`: what the model lacks, named first",
        ("--split", "test", "--seeds", "1", "--baselines"),
        ("--quick",),
        _discovery,
    ),
)


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
    """Run one benchmark; whether it succeeded."""
    words = [f"benchmarks.{part.name}", *(part.quick if quick else part.full)]
    print(f"python -m {' '.join(words)}", flush=True)
    call = [sys.executable, "-m", *words, "--markdown"]
    ended = subprocess.run(call, stdout=subprocess.PIPE, text=True, check=False, cwd=ROOT)
    try:
        if ended.returncode:
            raise LookupError(f"exit status {ended.returncode}")
        extract = part.extract(ended.stdout)
    except (LookupError, ValueError) as error:
        print(f"{ended.stdout}{part.name}: {error}", file=sys.stderr)
        return False
    machine = ended.stdout.splitlines()[0]
    if quick:
        print(f"\n{extract.body}\n\n{part.label}: {'; '.join(extract.key)}\n", flush=True)
    else:
        write(root, part, machine, " ".join(words), extract)
    return True


def write(root: Path, part: Part, machine: str, words: str, extract: Extract) -> None:
    """Put what a benchmark showed into both documents."""
    body = f"`python -m {words}`, {machine}\n\n{extract.body}"
    _change(root / "docs" / "benchmarks.md", part.name, lambda _: body)
    _change(root / "README.md", "benchmarks", lambda old: short(old, machine, part.label, extract.key))


def short(old: str, machine: str, label: str, key: Sequence[str]) -> str:
    """Return README's table with one row changed.

    It names one machine, so rows that another one measured go.
    """
    named = "Measured on: " + re.sub(r", load [\d.]+", "", machine).removeprefix("machine: ")
    known = {row[0]: row for row in tables(old)[0][1:]} if named in old.splitlines() else {}
    known[label] = [label, *key]
    rows = [known[part.label] for part in PARTS if part.label in known]
    rendered = table(["measured", "tssgeom", "beside it", "ratio"], rows, text_columns=3, markdown=True)
    return f"{rendered}\n\n{named}"


def _change(path: Path, name: str, new: Callable[[str], str]) -> None:
    write_text(path, between(path.read_text(encoding="utf-8"), name, new))


def between(text: str, name: str, new: Callable[[str], str]) -> str:
    """Return a document with what stands between two marks changed; LookupError where they are not there."""
    first, last = f"<!-- {name}: measured -->\n", f"\n<!-- {name}: end -->"
    head, begun, rest = text.partition(first)
    old, ended, tail = rest.partition(last)
    if not (begun and ended):
        raise LookupError(f"there are no marks of {name}: write {first.strip()} and {last.strip()}")
    return f"{head}{first}{new(old)}{last}{tail}"


if __name__ == "__main__":
    sys.exit(main())
