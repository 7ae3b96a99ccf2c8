"""Other programs, run in a `with` block: they end with it, or by `end_programs` where a process ends."""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any


@dataclass(slots=True, eq=False)
class _Program:
    """A program that is started once at most, and never after its end."""

    process: subprocess.Popen[Any] | None = None
    failure: OSError | None = None
    ended: bool = False
    _lock: threading.RLock = field(default_factory=threading.RLock)

    def start(self, command: Sequence[str], options: dict[str, Any]) -> None:
        with self._lock:
            if not self.ended:
                try:
                    self.process = subprocess.Popen(command, **options)
                except OSError as error:
                    self.failure = error

    def end(self) -> None:
        with self._lock:
            self.ended = True
            if self.process is not None:
                self.process.kill()
                self.process.wait()


_programs = set[_Program]()


@contextmanager
def running(command: Sequence[str], **options: Any) -> Iterator[subprocess.Popen[bytes]]:
    """Run a program with the options of `Popen`, and kill it on leaving.

    Another thread starts it, since a signal that came meanwhile to the main thread would lose the process.

    Raises OSError where the system refuses.
    """
    program = _Program()
    _programs.add(program)
    try:
        thread = threading.Thread(target=program.start, args=(command, options))
        thread.start()
        thread.join()
        if program.process is None:
            raise program.failure or OSError(f"{command[0]} was ended before it started")
        yield program.process
    finally:
        program.end()
        _programs.discard(program)


def end_programs() -> None:
    """Kill the programs of this process, which is to end, whatever its threads do."""
    for program in [*_programs]:
        program.end()
