"""Processes that take only the time which nobody else wants, as long as they keep up with it."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cache


def keep_back(pid: int, wanted: bool) -> None:
    """Let a process run only where a core is idle, or as any other again; nothing where that may not be.

    A niceness alone does not do: who has just begun to run keeps the core for a millisecond or two, which is
    more than a stream has. Linux lets nobody come back without a right to it, so where there is none, a
    process that could starve is left as it is.
    """
    if not _may_come_back():
        return
    policy = os.SCHED_IDLE if wanted else os.SCHED_OTHER
    with suppress(OSError):  # it has ended
        for thread in os.listdir(f"/proc/{pid}/task"):
            os.sched_setscheduler(int(thread), policy, os.sched_param(0))


@cache
def _may_come_back() -> bool:
    """Whether this process may raise a priority that it has lowered; tried on a thread that then ends."""
    if not hasattr(os, "SCHED_IDLE"):
        return False
    with ThreadPoolExecutor(1) as thrown_away:
        return thrown_away.submit(_went_and_came_back).result()


def _went_and_came_back() -> bool:
    try:
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    except OSError:
        return False
    return True
