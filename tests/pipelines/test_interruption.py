"""Ctrl-C ends a command wherever it comes."""

import ctypes
import signal
import sys
import time
from collections.abc import Callable

import pytest

from pipelines.cli import lost_interrupts_repeated

RAISING = ctypes.CFUNCTYPE(None)


def interrupted() -> None:
    """Stand for a callback of the compiler in which Ctrl-C comes."""
    raise KeyboardInterrupt


def worked_through(callback: Callable[[], None]) -> None:
    """Work for ten seconds, in which C calls back."""
    with lost_interrupts_repeated():
        RAISING(callback)()
        time.sleep(10.0)


def test_an_interruption_that_a_callback_loses_is_raised_again():
    report = sys.unraisablehook
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's & shuts it off
    try:
        with pytest.raises(KeyboardInterrupt):
            worked_through(interrupted)
    finally:
        signal.signal(signal.SIGINT, handler)
    assert sys.unraisablehook is report


def test_what_else_is_lost_is_reported_as_before():
    lost = []

    def failing() -> None:
        raise ValueError("of a callback")

    before, sys.unraisablehook = sys.unraisablehook, lambda one: lost.append(one.exc_type)
    try:
        with lost_interrupts_repeated():
            RAISING(failing)()
    finally:
        sys.unraisablehook = before
    assert lost == [ValueError]
