"""SIGINT, SIGTERM and SIGHUP end a command: files are complete or absent, and its children end with it.

The signal raises KeyboardInterrupt in the main thread, so that `with` blocks are left as after an error.
Where that thread does not hear it, as in a long call of C, another thread ends the process.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from types import FrameType
from typing import Any

from pipelines.terminal import print_message
from tssgeom.atomic import discard_drafts
from tssgeom.programs import end_programs

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
MESSAGE = "interrupted: the files that were finished are whole"
FIT_THREAD = "fit"
"""Name of the threads that fit beside a stream."""


@dataclass(frozen=True, slots=True)
class InterruptionTimes:
    """Times from a signal to the end of a command; no result depends on them."""

    hearing: float = 0.3
    """Longest wait until the main thread hears a signal [s]; chosen: the command ends within 0.5 s."""
    leaving: float = 2.0
    """Longest wait until it has left its `with` blocks [s]; chosen: as long as stopped workers may take."""


_TIMES = InterruptionTimes()


@dataclass(slots=True)
class Interruption:
    """The signal that came to a command, and whether the command ends by it."""

    number: int = 0
    """Zero where none came."""
    heard: threading.Event = field(default_factory=threading.Event)
    """KeyboardInterrupt was raised in the main thread."""
    over: threading.Event = field(default_factory=threading.Event)
    """The command has ended, or has taken the signal as the end of one step."""
    done: bool = False
    """The work is done: a signal changes nothing."""

    def hear(self, number: int, frame: FrameType | None) -> None:
        """Raise KeyboardInterrupt for the first signal; any other comes while the command ends."""
        self.heard.set()
        if not self.number and not self.done:
            self.number = number
            raise KeyboardInterrupt

    def watch(self, woken: socket.socket) -> None:
        """Read the numbers of signals as they come, and end the process where the main thread does not."""
        with woken:
            while number := woken.recv(1):
                if number[0] in SIGNALS and not self._ends_by_itself():
                    _end(number[0])
                self.heard.clear()
                self.over.clear()

    def _ends_by_itself(self) -> bool:
        return self.heard.wait(_TIMES.hearing) and self.over.wait(_TIMES.leaving)

    def forget(self) -> None:
        """Go on as if no signal had come."""
        if self.number:
            self.number = 0
            self.over.set()


_present = Interruption()


def interruptible(work: Callable[[], int], *, last: bool = False) -> int:
    """Do the work of a command, and return its exit status or that of the signal that ended it.

    Where it is the last of a process, a signal afterwards ends the process as if Python handled none.
    """
    status = 0
    with _listening(last=last) as present:
        try:
            status = work()
            present.done = True
        except BaseException:  # also of a library whose import was interrupted
            if not present.number:
                raise
        if present.number:
            end_workers()
            discard_drafts()
            print_message(MESSAGE)
            status = 128 + present.number
    return status


@contextmanager
def _listening(*, last: bool) -> Iterator[Interruption]:
    """Hear signals in a `with` block of the main thread; those that are shut off, as by nohup, stay so."""
    global _present
    _present = present = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield present
        return
    woken, wake = socket.socketpair()
    wake.setblocking(False)
    heard = [each for each in SIGNALS if signal.getsignal(each) is not signal.SIG_IGN]
    handlers = {each: signal.signal(each, present.hear) for each in heard}
    before, report = signal.set_wakeup_fd(wake.fileno(), warn_on_full_buffer=False), sys.unraisablehook
    sys.unraisablehook = lambda lost: _end(present.number) if _is_lost_signal(lost) else report(lost)
    threading.Thread(target=present.watch, args=(woken,), daemon=True).start()
    try:
        yield present
    finally:
        present.over.set()
        sys.unraisablehook = report
        signal.set_wakeup_fd(before)
        for each, handler in handlers.items():
            signal.signal(each, signal.SIG_DFL if last else handler)
        wake.close()


@contextmanager
def ending_this_step() -> Iterator[None]:
    """Let a signal end only the `with` block, as the filming of a camera; the next one ends the command."""
    with suppress(KeyboardInterrupt):
        yield
    _present.forget()


@contextmanager
def unheard() -> Iterator[None]:
    """Start processes that hear no signal, since this one ends them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end_workers() -> None:
    """Kill the workers and programs of this process, stopped ones too; their files are complete or drafts."""
    from multiprocessing import active_children  # here: few commands have workers

    end_programs()
    for worker in active_children():
        worker.kill()
        worker.join()


def _is_lost_signal(lost: Any) -> bool:
    """Whether a callback of C or a finalizer has lost a KeyboardInterrupt, which Python only reports."""
    return issubclass(lost.exc_type, KeyboardInterrupt)


def _end(number: int) -> None:
    """End the process and its workers now."""
    end_workers()
    discard_drafts()
    with suppress(OSError, ValueError, AttributeError):
        errors = sys.stderr.fileno()
        cursor = "\x1b[?25h" if os.isatty(errors) else ""  # a bar of progress hides it
        os.write(errors, f"{cursor}tssgeom: {MESSAGE}\n".encode())
    os._exit(128 + number)
