"""The console script `tssgeom`: its commands, and one funnel for errors.

What a command needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import Annotated

import typer

from pipelines.interruption import not_lost
from pipelines.live_options import live
from pipelines.paper_options import paper, remedy
from pipelines.run_options import calibrate, compensate, discover, simulate
from pipelines.shape_options import analyse, batch, check, samples, view
from pipelines.track_options import track
from pipelines.version import tssgeom_version

_INTERRUPTED = 130  # what shells and typer call the end by Ctrl-C

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


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"tssgeom {tssgeom_version()}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Hold the options that come before a command."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the console script; each error is one line on stderr, and the exit status says how it went."""
    sys.exit(_status(arguments))


def _status(arguments: Sequence[str] | None) -> int:
    if "" in (sys.argv[1:] if arguments is None else arguments):
        return _complain("an argument is empty: is a variable of the shell not set?", 2)
    try:
        with not_lost():
            status = app(args=arguments, prog_name="tssgeom", standalone_mode=False) or 0
    except typer.TyperException as error:
        return _complain(f"{error.format_message().rstrip('.')}: see tssgeom --help", 2) if str(error) else 2
    except KeyboardInterrupt:
        status = _INTERRUPTED
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        return _foreseen(error)
    if status == _INTERRUPTED:
        return _complain("interrupted: the files that were finished are whole", status)
    return status


def _foreseen(error: Exception) -> int:
    """Tell an error that was raised on purpose, or that the system raised; raise any other again."""
    from tssgeom.errors import TssgeomError, refused  # here, since it brings the whole package

    error = refused(error) if isinstance(error, OSError) else error
    if not isinstance(error, TssgeomError):
        raise error
    return _complain(str(error), 2)


def _complain(text: str, status: int) -> int:
    typer.echo("tssgeom: " + " ".join(text.split()), err=True)
    return status
