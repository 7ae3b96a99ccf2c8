"""One command on hostile input, in a process of its own: its time, its memory, and its output."""

from __future__ import annotations

import os
import resource
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from pipelines.interruption import SIGNALS

SLOW = 2.0
"""Time of a hang [s]; chosen: longer than any sound command on a small file needs."""
LARGE = 1 << 30
"""Memory that no case may take [B]; chosen: what a small computer can spare."""
_LOST_AFTER = 30.0  # times the allowed time until a command is killed; chosen: others use the machine too
_LONGEST = 2048  # B of one line on stderr; chosen: some lines of a terminal


@dataclass(frozen=True, slots=True)
class Ending:
    """The end of one command."""

    status: int | None
    """None where it was killed, here or by a signal."""
    seconds: float
    """Time on a processor [s]: another load does not count; what waits in vain is killed."""
    memory: int
    """Greatest resident set [B]."""
    out: bytes
    err: bytes
    allowed: float = SLOW
    """Time that it may take on a processor [s]."""
    quiet: bool = False
    """Whether it was to print nothing where all is well."""
    late: float | None = None
    """Time from the signal that was sent to the end [s]; None where it ended before."""
    elapsed: float = 0.0
    """Time from start to end [s]."""
    left: bool = False
    """Whether a process that it started is still there."""

    def faults(self) -> list[str]:
        """Return what must not be: hang, death, traceback, memory, silence, an endless or unsafe line."""
        faults = list[str]()
        if self.seconds > self.allowed:
            faults.append(f"hang {self.seconds:.1f} s")
        if self.status not in (0, 1, 2):
            faults.append(f"died ({self.status})")
        if b"Traceback" in self.err or b"please report it" in self.err:
            faults.append("traceback")
        if self.memory > LARGE:
            faults.append(f"memory {self.memory >> 20} MiB")
        if not (self.err + self.out).strip() and not (self.quiet and self.status == 0):
            faults.append("silent")
        if max(map(len, self.err.split(b"\n"))) > _LONGEST:
            faults.append("long line")
        if set(self.out + self.err) & {0x1B, 0x01, 0x07}:
            faults.append("control character")
        return faults


def attempt(
    arguments: Sequence[str | Path], allowed: float = SLOW, sent: tuple[int, float] | None = None
) -> Ending:
    """Run a command in a fork of this process, which has imported it, and wait for its end.

    Parameters
    ----------
    arguments
        Of the command.
    allowed
        Time that it may take on a processor [s].
    sent
        A signal to send, and how long after the start [s].
    """
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        begun = time.monotonic()
        child = os.fork()
        if child == 0:
            _run(arguments, out.fileno(), err.fileno())
        struck = None if sent is None else _struck(child, sent[0], begun + sent[1])
        status, usage = _ended(child, begun + _LOST_AFTER * allowed)
        now = time.monotonic()
        late = None if struck is None else now - struck
        seconds, memory = usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024
        out.seek(0)
        err.seek(0)
        text, quiet = (out.read(), err.read()), "--quiet" in arguments
        return Ending(status, seconds, memory, *text, allowed, quiet, late, now - begun, _is_left(child))


def _struck(child: int, number: int, moment: float) -> float | None:
    """Send a signal at a moment, and return when; None where the process has ended."""
    while time.monotonic() < moment:
        if os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT):
            return None
        time.sleep(0.001)
    os.kill(child, number)
    return time.monotonic()


def _is_left(group: int) -> bool:
    """Whether a process of a group is there, after the time that its end may take."""
    until = time.monotonic() + SLOW
    while time.monotonic() < until:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return False
        time.sleep(0.01)
    return True


def _run(arguments: Sequence[str | Path], out: int, err: int) -> None:
    """Run the command and end the process, whatever happens."""
    status = 70
    try:
        os.setpgid(0, 0)
        for number in SIGNALS:  # what starts this may have shut them off
            signal.signal(number, signal.SIG_DFL if number != signal.SIGINT else signal.default_int_handler)
        nothing = os.open(os.devnull, os.O_RDONLY)
        for given, taken in ((nothing, 0), (out, 1), (err, 2)):
            os.dup2(given, taken)
        from pipelines.cli import main

        try:
            main([str(each) for each in arguments])
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else 2
        except BaseException:
            sys.excepthook(*sys.exc_info())
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(status)


def _ended(child: int, until: float) -> tuple[int | None, resource.struct_rusage]:
    """Wait for a process, and kill it and its own after a time; return its status and what it used."""
    pause = 0.001
    while True:
        ended, status, usage = os.wait4(child, os.WNOHANG)
        if ended:
            return (os.WEXITSTATUS(status) if os.WIFEXITED(status) else None), usage
        if time.monotonic() > until:
            with suppress(ProcessLookupError):
                os.killpg(child, signal.SIGKILL)
            _, _, usage = os.wait4(child, 0)
            return None, usage
        time.sleep(pause)
        pause = min(2 * pause, 0.02)
