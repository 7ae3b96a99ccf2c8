"""What people see in the terminal: progress and errors on stderr, one table on stdout."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn
from rich.table import Table

_WIDE, _BOUNDLESS = 160, 10_000


def complain(text: str) -> None:
    """Print one line on stderr."""
    print(f"tssgeom: {text}", file=sys.stderr)  # noqa: T201


def say(text: str) -> None:
    """Print plain text on stdout."""
    print(text)  # noqa: T201


def show(
    title: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    notes: Sequence[str] = (),
    optional: Collection[str] = (),
) -> None:
    """Print a table on stdout, then its notes, a line each.

    Where the terminal is too narrow for the whole table, the `optional` columns are left out.
    """
    console = Console(highlight=False, width=None if sys.stdout.isatty() else _WIDE)
    table = _table(columns, rows)
    if console.measure(table, options=console.options.update(width=_BOUNDLESS)).maximum > console.width:
        kept = [k for k, column in enumerate(columns) if column not in optional]
        table = _table([columns[k] for k in kept], [[row[k] for k in kept] for row in rows])
    console.print(title, markup=False, style="bold")
    console.print(table)
    for note in notes:
        console.print(note, markup=False, soft_wrap=True)


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for number, column in enumerate(columns):
        table.add_column(escape(column), justify="right" if number else "left", overflow="fold")
    for row in rows:
        table.add_row(*map(escape, row))
    return table


@dataclass(slots=True)
class Tracker:
    """Progress over the inputs of a run, and over the frames of the present one."""

    total: int
    bar: Progress | None
    """None: plain lines."""
    quiet: bool
    done: int = 0
    _inputs: TaskID | None = field(default=None)
    _frames: TaskID | None = field(default=None)

    def begin(self, name: str) -> None:
        """Begin the next input."""
        if self.bar is None:
            return
        if self._inputs is None:
            self._inputs = self.bar.add_task("inputs", total=self.total)
        self._frames = self.bar.add_task(name, total=None)

    def frame(self, total: int) -> None:
        """Count one frame of the present input."""
        if self.bar is not None and self._frames is not None:
            self.bar.update(self._frames, advance=1, total=total)

    def end(self, text: str) -> None:
        """End the present input; `text` is what became of it."""
        self.done += 1
        if self.bar is not None and self._frames is not None and self._inputs is not None:
            self.bar.remove_task(self._frames)
            self.bar.update(self._inputs, advance=1)
        elif not self.quiet and self.total > 1:
            print(f"[{self.done}/{self.total}] {text}", file=sys.stderr, flush=True)  # noqa: T201


@contextmanager
def tracking(total: int, *, quiet: bool) -> Iterator[Tracker]:
    """Show progress on stderr: a bar on a terminal, plain lines elsewhere, nothing where quiet."""
    if quiet or not sys.stderr.isatty():
        yield Tracker(total, None, quiet)
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        yield Tracker(total, bar, quiet)


@contextmanager
def stepping(*, quiet: bool) -> Iterator[Callable[[str, float], None]]:
    """Show the steps of one long work on stderr: yields what is told of each step and the share done [1]."""
    if quiet or not sys.stderr.isatty():
        yield _Steps(quiet).tell
        return
    columns = (BarColumn(), TextColumn("{task.percentage:>3.0f} %"), TextColumn("{task.description}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda step, share: bar.update(task, description=step, completed=share)


@dataclass(slots=True)
class _Steps:
    """A plain line for each step."""

    quiet: bool
    last: str = ""

    def tell(self, step: str, share: float) -> None:
        if step != self.last and not self.quiet:
            print(f"[{100 * share:3.0f} %] {step}", file=sys.stderr, flush=True)  # noqa: T201
        self.last = step
