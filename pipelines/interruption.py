"""Ctrl-C is not lost where it comes in code that cannot pass an exception on."""

from __future__ import annotations

import _thread
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_AGAIN = 0.05  # s


@contextmanager
def not_lost() -> Iterator[None]:
    """Raise KeyboardInterrupt again where it was lost, as in a callback of the compiler or a finalizer.

    There Python only reports an exception (`sys.unraisablehook`), and goes on as if nothing had been pressed.
    """
    report, again = sys.unraisablehook, list[threading.Timer]()

    def seen(lost: Any) -> None:
        if not issubclass(lost.exc_type, KeyboardInterrupt):
            report(lost)
            return
        timer = threading.Timer(_AGAIN, _thread.interrupt_main)
        timer.daemon = True
        again.append(timer)
        timer.start()

    sys.unraisablehook = seen
    try:
        yield
    finally:
        sys.unraisablehook = report
        for timer in again:
            timer.cancel()
