"""The terminal: results on stdout; messages and progress on stderr.

rich is imported when it is needed, so that `--help` is quick.
"""

from __future__ import annotations

import io
import json
import math
import os
import sys
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TextIO

from tssgeom.errors import on_one_line, printable

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID
    from rich.table import Table

_PIPE_WIDTH = 150  # characters of a table where stdout is no terminal; chosen: what a page shows whole
_UNBOUNDED_WIDTH = 10_000  # characters: wider than any table


@dataclass(frozen=True, slots=True)
class ProgressTimes:
    """When progress is reported; all chosen, none changes a result."""

    least_share: float = 0.02
    """Share of the work that has to be done before the time left is estimated [1]."""
    least_left: float = 0.5
    """Time left below which it is not reported [s]."""
    line_interval: float = 10.0
    """Time between two plain lines over one long input [s]."""


_TIMES = ProgressTimes()


def open_streams() -> None:
    """Make stdout and stderr take every text; one that is closed goes nowhere.

    A terminal may lack μ, and a name may be no UTF-8.
    """
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:  # in this order each gets its own number back
            setattr(sys, name, open(os.devnull, "r" if name == "stdin" else "w", encoding="utf-8"))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


@contextmanager
def whose_reader_may_leave() -> Iterator[None]:
    """Print on stdout; where the reader of a pipe has closed it, the work goes on without it."""
    try:
        yield
    except (BrokenPipeError, SystemExit) as error:  # rich and typer make the second of the first
        if not isinstance(error, BrokenPipeError) and not isinstance(error.__context__, BrokenPipeError):
            raise
        _leave(sys.stdout)


@contextmanager
def without_lines_of_libraries() -> Iterator[None]:
    """Keep what libraries in C write on standard error, as of a damaged image, from the terminal."""
    own, before = os.dup(2), sys.stderr
    with open(os.devnull, "wb") as nowhere, open(own, "w", 1, before.encoding, before.errors) as errors:
        before.flush()
        os.dup2(nowhere.fileno(), 2)
        if _is_standard_error(before):
            sys.stderr = errors
        try:
            yield
        finally:
            sys.stderr = before
            errors.flush()
            os.dup2(own, 2)


def _is_standard_error(stream: TextIO) -> bool:
    with suppress(OSError, ValueError):
        return stream.fileno() == 2
    return False


def _leave(stream: TextIO) -> None:
    """Let a stream go nowhere from now on."""
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _print_beside(text: str) -> None:
    """Print a line on stderr; where that is full or closed, the work goes on without it."""
    try:
        print(text, file=sys.stderr, flush=True)  # noqa: T201
    except OSError:
        _leave(sys.stderr)


def print_message(text: str) -> None:
    """Print an error or a warning, one line on stderr."""
    _print_beside(f"tssgeom: {on_one_line(text)}")


def print_line(text: str) -> None:
    """Print plain text on stdout."""
    with whose_reader_may_leave():
        print(printable(text))  # noqa: T201


def json_text(value: object) -> str:
    """Return a result as indented JSON; numbers that are not finite raise ValueError."""
    return json.dumps(value, indent=1, ensure_ascii=False, allow_nan=False)


def print_json(value: object) -> None:
    """Print a result as JSON on stdout."""
    text = json_text(value)
    if not (sys.stdout.encoding or "").lower().startswith("utf"):
        text = json.dumps(json.loads(text), indent=1)
    print_line(text)


def print_table(
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
    from rich.console import Console

    console = Console(highlight=False, width=None if sys.stdout.isatty() else _PIPE_WIDTH)
    table = _table(columns, rows)
    unbounded = console.options.update(width=_UNBOUNDED_WIDTH)
    if console.measure(table, options=unbounded).maximum > console.width:
        kept = [k for k, column in enumerate(columns) if column not in optional]
        table = _table([columns[k] for k in kept], [[row[k] for k in kept] for row in rows])
    with whose_reader_may_leave():
        console.print(printable(title), markup=False, style="bold")
        console.print(table)
        for note in notes:
            console.print(printable(note), markup=False, soft_wrap=True)


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for number, column in enumerate(columns):
        table.add_column(escape(column), justify="left" if number == 0 else "right", overflow="fold")
    for row in rows:
        table.add_row(*(escape(printable(cell)) for cell in row))
    return table


def _status_line(text: str) -> None:
    _print_beside(printable(" ".join(text.splitlines())))


@contextmanager
def _bar(*columns: str, quiet: bool) -> Iterator[Progress | None]:
    """Yield a progress bar on a terminal, and None elsewhere or where quiet.

    A column is `bar`, `count`, `time left`, or a text with fields of the task.
    """
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    known = {"bar": BarColumn, "count": MofNCompleteColumn, "time left": TimeRemainingColumn}
    made = (known[column]() if column in known else TextColumn(column) for column in columns)
    with Progress(*made, console=Console(stderr=True), transient=True) as bar:
        yield bar


@dataclass(slots=True)
class CountedProgress:
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
        """End the present input; `text` is its outcome."""
        self.done += 1
        if self.bar is not None and self._frames is not None and self._inputs is not None:
            self.bar.remove_task(self._frames)
            self.bar.update(self._inputs, advance=1)
        elif not self.quiet and self.total > 1:
            _status_line(f"[{self.done}/{self.total}] {text}")


@contextmanager
def counted_progress(total: int, *, quiet: bool) -> Iterator[CountedProgress]:
    """Show progress on stderr: a bar on a terminal, plain lines elsewhere, nothing where quiet."""
    with _bar("{task.description}", "bar", "count", "time left", quiet=quiet) as bar:
        yield CountedProgress(total, bar, quiet)


@contextmanager
def step_progress(*, quiet: bool) -> Iterator[Callable[[str, float], None]]:
    """Show the steps of one long computation on stderr; yields a function of a step's name and share done."""
    with _bar("bar", "{task.percentage:>3.0f} %", "{task.description}", quiet=quiet) as bar:
        if bar is None:
            yield _StepLines(quiet).report
            return
        task = bar.add_task("", total=1.0)
        yield lambda step, share: bar.update(task, description=step, completed=share)


@dataclass(slots=True)
class _StepLines:
    """A plain line for each step."""

    quiet: bool
    last: str = ""

    def report(self, step: str, share: float) -> None:
        if step != self.last and not self.quiet:
            _status_line(f"[{100 * share:3.0f} %] {step}")
        self.last = step


@dataclass(slots=True)
class SizedProgress:
    """Progress over the inputs of a run by their size, with the rate and the time left."""

    inputs: int
    size: float
    """Of all inputs [B]."""
    bar: Progress | None
    """None: plain lines."""
    quiet: bool
    done: int = 0
    frames: int = 0
    read: float = 0.0
    """Of the inputs so far [B]."""
    _finished: tuple[int, float] = (0, 0.0)
    _skipped: float = 0.0
    _begun: float = field(default_factory=time.monotonic)
    _reported: float = field(default_factory=time.monotonic)
    _task: TaskID | None = field(default=None)

    def advance(self, frames: int, size: float) -> None:
        """Count more frames, and so many bytes of input."""
        self.update(self.frames + frames, self.read + size)

    def update(self, frames: int, size: float) -> None:
        """Set how many frames and bytes of input the workers have done."""
        self.frames = max(frames, self._finished[0])
        self.read = max(size + self._skipped, self._finished[1])
        if self.bar is not None:
            self._draw(self.bar)
        elif not self.quiet and time.monotonic() - self._reported > _TIMES.line_interval:
            self._line(f"{100 * self._share:.0f} % done")

    def end(self, text: str, frames: int, size: float, *, unchanged: bool = False) -> None:
        """End an input of so many frames and bytes; `text` is its name."""
        self.done += 1
        self._skipped += size if unchanged else 0.0
        finished, read = self._finished
        self._finished = (finished + (0 if unchanged else frames), read + size)
        self.frames, self.read = max(self.frames, self._finished[0]), max(self.read, self._finished[1])
        if self.bar is not None:
            self._draw(self.bar)
        elif not self.quiet and self.inputs > 1:
            self._line(f"[{self.done}/{self.inputs}] {text}{' (unchanged)' if unchanged else ''}")

    @property
    def _share(self) -> float:
        return min(self.read / self.size, 1.0) if self.size else 1.0

    @property
    def pace(self) -> str:
        """Rate and time left, as text; empty before the first frame."""
        passed, fresh = time.monotonic() - self._begun, self.read - self._skipped
        if not self.frames or passed <= 0:
            return ""
        left = passed * (self.size - self.read) / fresh if fresh else math.inf
        known = fresh > _TIMES.least_share * (self.size - self._skipped) and left > _TIMES.least_left
        rest = f", {_duration(left)} left" if known else ""
        return f"{self.frames / passed:.3g} frames/s{rest}"

    def _draw(self, bar: Progress) -> None:
        if self._task is None:
            self._task = bar.add_task("", total=self.size or 1.0, pace="")
        counts = f"{self.done}/{self.inputs} inputs, {self.frames} frames"
        bar.update(self._task, completed=self.read, description=counts, pace=self.pace)

    def _line(self, text: str) -> None:
        self._reported = time.monotonic()
        pace = f"  {self.pace}" if self.pace else ""
        _status_line(f"{text}{pace}")


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s" if minutes else f"{rest} s"


@contextmanager
def sized_progress(inputs: int, size: float, *, quiet: bool) -> Iterator[SizedProgress]:
    """Show progress on stderr: a bar on a terminal, plain lines elsewhere, nothing where quiet."""
    with _bar("{task.description}", "bar", "{task.fields[pace]}", quiet=quiet) as bar:
        yield SizedProgress(inputs, size, bar, quiet)
