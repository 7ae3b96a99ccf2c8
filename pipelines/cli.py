"""The console script `tssgeom`: its commands, and one funnel for errors.

What a command needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

import inspect
import os
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from itertools import pairwise
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from pipelines import tssgeom_version
from pipelines.interruption import FIT_THREAD, interruptible
from pipelines.terminal import open_streams, print_message, whose_reader_may_leave

_RESERVED = (
    "32MiB"  # of address space by Arrow and Rerun at a time, each; chosen: a thirtieth of their default
)
_HELP = {"help_option_names": ["-h", "--help"]}

COMMANDS = (
    "track",
    "analyse",
    "batch",
    "check",
    "verify",
    "live",
    "samples",
    "view",
    "simulate",
    "compensate",
    "paper",
    "calibrate",
    "remedy",
    "discover",
)
"""In the order in which `--help` names them; NAME is a function in the module `pipelines.NAME`."""


def command(name: str) -> Callable[..., None]:
    """Return the function of a command."""
    return getattr(import_module(f"pipelines.{name}"), name)


class _Command(TyperCommand):
    """A command in which no option is the value of the option before it."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        names = {name: of for of in self.get_params(ctx) for name in (*of.opts, *of.secondary_opts)}
        given = args[: args.index("--")] if "--" in args else args
        for name, value in pairwise(given):
            if name in names and not getattr(names[name], "is_flag", True) and value in names:
                raise typer.TyperException(f"{name} has no value: {value} follows it")
        return super().parse_args(ctx, args)


class _Commands(TyperGroup):
    """The commands, each imported and built when it is called: `--help` builds none of them."""

    def list_commands(self, ctx: Any) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        for name in (cmd_name,) if cmd_name in COMMANDS else COMMANDS:  # a misspelt one is compared with all
            if name not in self.commands:
                single = typer.Typer(add_completion=False, rich_markup_mode=None, context_settings=_HELP)
                single.command(name, cls=_Command)(command(name))
                self.commands[name] = typer.main.get_command(single)
        return self.commands.get(cmd_name)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        with formatter.section("Commands"):
            docs = ((name, inspect.getdoc(command(name)) or "") for name in COMMANDS)
            formatter.write_dl([(name, doc.partition("\n\n")[0].replace("\n", " ")) for name, doc in docs])


app = typer.Typer(
    name="tssgeom",
    cls=_Commands,
    help="Tension and elongation of tendon-sheath transmissions on sensed three-dimensional routes.",
    context_settings=_HELP,
    rich_markup_mode=None,  # plain help: rich takes a tenth of a second to import
    pretty_exceptions_enable=False,
)


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
    """Run the console script; each error is one line on stderr.

    The exit status is 0, 1 or 2, or 128 and the number of the signal that ended the command.
    """
    os.environ.setdefault("MIMALLOC_ARENA_RESERVE", _RESERVED)
    open_streams()
    status = interruptible(lambda: _status(arguments), last=arguments is None)
    if arguments is None and any(one.name == FIT_THREAD for one in threading.enumerate()):
        _leave(status)
    sys.exit(status)


def _leave(status: int) -> None:
    """End the process at once: Python would end the thread of a fit within C, which may crash."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):
            stream.flush()
    os._exit(status)


def _status(arguments: Sequence[str] | None) -> int:
    words = list(sys.argv[1:] if arguments is None else arguments)
    if "" in words:
        return _failed("an argument is empty: is a variable of the shell not set?")
    try:
        status = 0
        with whose_reader_may_leave():
            status = app(args=words or ["--help"], prog_name="tssgeom", standalone_mode=False) or 0
            status = status if words else 2
            sys.stdout.flush()
        return status
    except typer.TyperException as error:
        command = getattr(getattr(error, "ctx", None), "command_path", "tssgeom")
        return _failed(f"{error.format_message().rstrip('.')}: see {command} --help") if str(error) else 2
    except Exception as error:
        return _expected(error)
    finally:
        if "pipelines.left_out" in sys.modules:  # a command that takes no --map need not load it
            from pipelines.left_out import report_unused

            report_unused()


def _expected(error: Exception) -> int:
    """Print an error of the package or of the system, and return the exit status; raise any other again."""
    from tssgeom.errors import (  # here: it is rarely needed
        SettingsError,
        TssgeomError,
        lacks_memory,
        out_of_memory,
        refused,
    )

    if not isinstance(error, TssgeomError) and lacks_memory(error):
        error = out_of_memory(error)
    error = refused(error) if isinstance(error, OSError) else error
    if isinstance(error, UnicodeEncodeError):
        error = SettingsError("a name or an argument is not UTF-8, and goes into a file: give another one")
    if not isinstance(error, TssgeomError):
        raise error
    return _failed(str(error))


def _failed(text: str) -> int:
    print_message(" ".join(text.split()))
    return 2
