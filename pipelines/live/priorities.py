"""Priorities of the processes beside a stream: below its own, but where it waits for them."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from time import monotonic, sleep, thread_time


@dataclass(frozen=True, slots=True)
class RestLimits:
    """How much a thread with a priority of real time leaves to other programs.

    Linux takes 50 ms of each second at once from one that leaves nothing (`sched_rt_runtime_us`), and until
    then its network may stand still.
    """

    share: float = 0.8
    """Most that a thread takes of a core [1]; measured: with 0.9 and another program of real time on the same
    core, three of ten floods left a good sender 27 to 77 % of its answers, with 0.8 none."""
    every: float = 4e-3
    """Time after which that is judged [s]; derived: with `share`, rests are as short as `pause`."""
    pause: float = 1e-3
    """Length of a rest [s]; derived: a fifth of the 5 ms in which frames are to be answered."""


_RESTS = RestLimits()


def has_real_time() -> bool:
    """Whether this thread has a priority of real time."""
    return hasattr(os, "SCHED_RR") and os.sched_getscheduler(0) in (os.SCHED_RR, os.SCHED_FIFO)  # 0: this


@dataclass(slots=True)
class Rests:
    """The rests of one thread, where it has a priority of real time."""

    _wanted: bool = field(default_factory=has_real_time)
    _at: float = field(default_factory=monotonic)
    _used: float = field(default_factory=thread_time)
    _put_off: bool = False

    def are_due(self, *, urgent: bool = False) -> bool:
        """Whether it is time to rest; something urgent comes first, but only once."""
        if not self._wanted or (passed := monotonic() - self._at) < _RESTS.every:
            return False
        if thread_time() - self._used <= _RESTS.share * passed:
            self._begin()
            return False
        self._put_off = urgent and not self._put_off
        return not self._put_off

    def end_within(self, time: float) -> bool:
        """Whether a rest that begins now has ended well within some time [s]."""
        return time > 2.0 * _RESTS.pause

    def take_one(self) -> None:
        """Leave the core to others for a while."""
        sleep(_RESTS.pause)
        self._begin()

    def _begin(self) -> None:
        self._at, self._used, self._put_off = monotonic(), thread_time(), False


def set_niceness(pid: int, niceness: int) -> None:
    """Set the niceness of a process; a lower one needs a privilege, and without it nothing is changed."""
    _each_thread(pid, lambda thread: os.setpriority(os.PRIO_PROCESS, thread, niceness))


def lower_own_priority() -> None:
    """Let the thread that calls this give way to the others of its process, where those run in real time.

    Else it stays as it is: a nicer thread would starve beside other programs, and its frames would be late.
    """
    if not has_real_time():
        return
    with suppress(OSError):
        policy, priority = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
        os.sched_setscheduler(0, policy, os.sched_param(max(priority - 1, 1)))


def _each_thread(pid: int, change: Callable[[int], None]) -> None:
    """Change the priority of each thread of a process, of which Linux has one for each."""
    folder = f"/proc/{pid}/task"
    with suppress(OSError):  # it has ended, or may not
        for thread in os.listdir(folder) if os.path.isdir(folder) else (pid,):
            change(int(thread))


def set_idle_priority(pid: int, idle: bool) -> None:
    """Let a process run only where a core is idle, or as any other again.

    Niceness alone is not enough: a process that has begun to run keeps the core for a millisecond or two,
    more than a stream has. Linux lets a process return from idle priority only with a privilege. Without it
    nothing is changed, so that the process cannot starve.
    """
    if not _may_return():
        return
    policy = os.SCHED_IDLE if idle else os.SCHED_OTHER
    _each_thread(pid, lambda thread: os.sched_setscheduler(thread, policy, os.sched_param(0)))


@cache
def _may_return() -> bool:
    """Whether this process may raise a priority that it has lowered; tried in a thread that then ends."""
    if not hasattr(os, "SCHED_IDLE"):
        return False
    with ThreadPoolExecutor(1) as trial:
        return trial.submit(_lowered_and_raised).result()


def _lowered_and_raised() -> bool:
    try:
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    except OSError:
        return False
    return True
