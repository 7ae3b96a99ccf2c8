"""What the documents show of each benchmark: some of its tables, and one row of README."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from benchmarks.estimate import OURS
from benchmarks.tables import ABSENT, table

Cells = list[list[str]]
"""A table as it was printed: the header, then the rows."""


@dataclass(frozen=True, slots=True)
class Shown:
    """What documents show of one run."""

    body: str
    """For docs/benchmarks.md."""
    key: Sequence[str]
    """For README: this project, what stands beside it, the ratio."""


@dataclass(frozen=True, slots=True)
class Part:
    """One benchmark in the documents."""

    name: str
    """Its module, and its place in docs/benchmarks.md."""
    label: str
    """What README calls it."""
    full: tuple[str, ...]
    quick: tuple[str, ...]
    """Arguments of a run worth publishing, and of one that only tries whether all works."""
    shown: Callable[[str], Shown]
    """From what the benchmark printed; LookupError where something is missing."""


def tables(text: str) -> list[Cells]:
    """Return the Markdown tables of a text, their rules left out."""
    found, before = list[Cells](), ""
    for line in text.splitlines():
        if line.startswith("| "):
            cells = [cell.strip() for cell in line[1:-1].split("|")]
            if not before.startswith("| "):
                found.append([])
            if set("".join(cells)) - set("-:"):
                found[-1].append(cells)
        before = line
    return found


def cell(told: Cells, row: str, column: str) -> str:
    """Return the cell of the first row that begins with a text."""
    return _row(told, row)[_column(told, column)]


def _row(told: Cells, begins: str) -> list[str]:
    try:
        return next(row for row in told[1:] if row[0].startswith(begins))
    except StopIteration:
        raise LookupError(f"no row begins with {begins!r}") from None


def _column(told: Cells, name: str) -> int:
    if name not in told[0]:
        raise LookupError(f"no column is called {name!r}, only {', '.join(told[0])}")
    return told[0].index(name)


def _drawn(told: Cells, text_columns: int) -> str:
    return table(told[0], told[1:], text_columns=text_columns, markdown=True)


def _accuracy(text: str) -> Shown:
    """Of every cell the bound, this project and its best peer."""
    told = tables(text)[1]
    estimator, rms, held, count = (_column(told, name) for name in ("estimator", "rms", "95 % Φ", "count"))
    rows = list[list[str]]()
    for row in told[1:]:
        if row[estimator] == "bound":
            rows.append([" ".join(row[0].split()), row[rms]])
        elif row[estimator] == "auto":
            rows[-1] += [row[rms], row[held], row[count]]
        elif row[estimator] not in OURS:
            rows[-1][1:1] = [row[estimator], row[rms]]
    header = ["rms of Φ [%]", "best peer", "its rms", "bound", "tssgeom", "95 % hold [%]", "right count [%]"]
    drawn = [header, *rows]
    _, peer, theirs, bound, mine, *_ = _row(drawn, "7 pieces")
    ratio = f"{float(theirs) / float(mine):.3g} ×"
    key = [f"{mine} %", f"Cramér–Rao bound {bound} %, {peer} {theirs} %", ratio]
    return Shown(_drawn(drawn, 2), key)


def _speed(text: str) -> Shown:
    told = tables(text)
    frame, tendon = told[1], told[3]
    whole, pelt, kernel = (
        cell(frame, row, "p50 [µs]")
        for row in ("whole frame, stations known", "scipy + ruptures PELT", "scipy + ruptures kernel")
    )
    ratios = [cell(frame, "whole frame, stations known", name) for name in ("PELT / it", "kernel / it")]
    beside = f"splprep + ruptures: {pelt} µs (PELT), {kernel} µs (kernel, C); no tendon, no error bars"
    body = f"A frame of 200 points:\n\n{_drawn(frame, 1)}\n\nOne step of the tendon:\n\n{_drawn(tendon, 0)}"
    return Shown(body, [f"{whole} µs", beside, " ×, ".join(ratios) + " ×"])


def _live(text: str) -> Shown:
    latency, faults = tables(text)[:2]
    times = [cell(latency, "--view --record", name) for name in ("p50", "p99", "p99.9")]
    borne = sum(row[1] == "yes" for row in faults[1:])
    key = [f"{' / '.join(times)} ms", "wanted: at most 0.5 / 1 / 3 ms", ABSENT]
    return Shown(f"{_drawn(latency, 1)}\n\n{borne} of {len(faults) - 1} faults are borne.", key)


def _batch(text: str) -> Shown:
    speed, large = tables(text)
    count = speed[-1][0]
    columns = ("frames/s", "PELT/s", "kernel/s", "to PELT", "to kernel")
    mine, pelt, kernel, to_pelt, to_kernel = (cell(speed, count, name) for name in columns)
    beside = f"splprep + ruptures in as many: {pelt}/s (PELT), {kernel}/s (kernel, C)"
    key = [f"{mine}/s", beside, f"{to_pelt} ×, {to_kernel} ×"]
    return Shown(f"{_drawn(speed, 0)}\n\nOne long recording:\n\n{_drawn(large, 0)}", key)


def _discovery(text: str) -> Shown:
    targets, *_, peers = tables(text)
    kept = [row for row in targets if row[-1] != ABSENT]
    others = [f"{row[0]} {row[1]}" for row in peers[2:] if row[1] != ABSENT]
    beside = ", ".join([f"wanted: {cell(targets, 'right name first', 'target')}", *others])
    key = [cell(targets, "right name first", "reached"), beside, ABSENT]
    return Shown(f"{_drawn(kept, 2)}\n\n{_drawn(peers, 1)}", key)


PARTS = (
    Part(
        "accuracy",
        "error of Φ, 7 pieces, 200 points, 0.5 mm, neither stations nor noise told",
        ("--quick", "--trials", "200"),
        ("--quick",),
        _accuracy,
    ),
    Part("speed", "a frame of 200 points, sensed points to elongation, one core", (), ("--quick",), _speed),
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
