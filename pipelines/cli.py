"""The console script `tssgeom`: its commands, and one funnel for errors.

What a command needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

import _thread
import os
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, Any

import typer

from pipelines import tssgeom_version
from pipelines.analyse import analyse
from pipelines.batch import batch
from pipelines.calibrate import calibrate
from pipelines.check import check
from pipelines.compensate import compensate
from pipelines.discover import discover
from pipelines.live import live
from pipelines.paper import paper
from pipelines.remedy import remedy
from pipelines.samples import samples
from pipelines.simulate import simulate
from pipelines.terminal import print_message
from pipelines.track import track
from pipelines.view import view

_INTERRUPTED = 130  # exit status that shells and typer give Ctrl-C
_REPEATED_AFTER = 0.05  # s from a lost KeyboardInterrupt until it is raised again; chosen: it feels immediate

_COMMANDS = (
    track,
    analyse,
    batch,
    check,
    live,
    samples,
    view,
    simulate,
    compensate,
    paper,
    calibrate,
    remedy,
    discover,
)
"""In the order in which `--help` names them."""

app = typer.Typer(
    name="tssgeom",
    help="Tension and elongation of tendon-sheath transmissions on sensed three-dimensional routes.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

for _command in _COMMANDS:
    app.command()(_command)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"tssgeom {tssgeom_version()}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Take the options that come before a command."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the console script; each error is one line on stderr, and the exit status is 0, 1, 2 or 130."""
    sys.exit(_status(arguments))


def _status(arguments: Sequence[str] | None) -> int:
    if "" in (sys.argv[1:] if arguments is None else arguments):
        return _failed("an argument is empty: is a variable of the shell not set?", 2)
    try:
        with lost_interrupts_repeated():
            status = app(args=arguments, prog_name="tssgeom", standalone_mode=False) or 0
    except typer.TyperException as error:
        return _failed(f"{error.format_message().rstrip('.')}: see tssgeom --help", 2) if str(error) else 2
    except KeyboardInterrupt:
        status = _INTERRUPTED
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        return _expected(error)
    if status == _INTERRUPTED:
        return _failed("interrupted: the files that were finished are whole", status)
    return status


def _expected(error: Exception) -> int:
    """Print an error of the package or of the system, and return the exit status; raise any other again."""
    from tssgeom.errors import TssgeomError, refused  # here, since it brings the whole package

    error = refused(error) if isinstance(error, OSError) else error
    if not isinstance(error, TssgeomError):
        raise error
    return _failed(str(error), 2)


def _failed(text: str, status: int) -> int:
    print_message(" ".join(text.split()))
    return status


@contextmanager
def lost_interrupts_repeated() -> Iterator[None]:
    """Raise KeyboardInterrupt again where it was lost, as in a callback of the compiler or a finalizer.

    There Python only reports an exception (`sys.unraisablehook`), and the program would go on.
    """
    report, timers = sys.unraisablehook, list[threading.Timer]()

    def repeat(lost: Any) -> None:
        if not issubclass(lost.exc_type, KeyboardInterrupt):
            report(lost)
            return
        timer = threading.Timer(_REPEATED_AFTER, _thread.interrupt_main)
        timer.daemon = True
        timers.append(timer)
        timer.start()

    sys.unraisablehook = repeat
    try:
        yield
    finally:
        sys.unraisablehook = report
        for timer in timers:
            timer.cancel()
