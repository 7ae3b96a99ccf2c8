"""How far a run over many inputs is: by their size, with the rate and the time left."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn

_TELLING = 0.02  # share of the work from which on it tells how long the rest will take
_SOON = 0.5  # s
_SILENCE = 10.0  # s after which a long input is told how far it is


@dataclass(slots=True)
class Progression:
    """Progress over the inputs of a run, by their size: how fast it goes, and how long it will take."""

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
    _told: float = field(default_factory=time.monotonic)
    _task: TaskID | None = field(default=None)

    def more(self, frames: int, size: float) -> None:
        """Count more frames, and so many bytes of input."""
        self.seen(self.frames + frames, self.read + size)

    def seen(self, frames: int, size: float) -> None:
        """Take how many frames and bytes of input are done, where the workers tell."""
        self.frames = max(frames, self._finished[0])
        self.read = max(size + self._skipped, self._finished[1])
        if self.bar is not None:
            self._draw(self.bar)
        elif not self.quiet and time.monotonic() - self._told > _SILENCE:
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
        """Rate and time left, in words; nothing where there is nothing to tell."""
        passed, fresh = time.monotonic() - self._begun, self.read - self._skipped
        if not self.frames or passed <= 0:
            return ""
        left = passed * (self.size - self.read) / fresh if fresh else math.inf
        told = fresh > _TELLING * (self.size - self._skipped) and left > _SOON
        ahead = f", {_duration(left)} left" if told else ""
        return f"{self.frames / passed:.3g} frames/s{ahead}"

    def _draw(self, bar: Progress) -> None:
        if self._task is None:
            self._task = bar.add_task("", total=self.size or 1.0, pace="")
        told = f"{self.done}/{self.inputs} inputs, {self.frames} frames"
        bar.update(self._task, completed=self.read, description=told, pace=self.pace)

    def _line(self, text: str) -> None:
        self._told = time.monotonic()
        pace = f"  {self.pace}" if self.pace else ""
        print(f"{text}{pace}", file=sys.stderr, flush=True)  # noqa: T201


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s" if minutes else f"{rest} s"


@contextmanager
def progressing(inputs: int, size: float, *, quiet: bool) -> Iterator[Progression]:
    """Show progress on stderr: a bar on a terminal, plain lines elsewhere, nothing where quiet."""
    if quiet or not sys.stderr.isatty():
        yield Progression(inputs, size, None, quiet)
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[pace]}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        yield Progression(inputs, size, bar, quiet)
