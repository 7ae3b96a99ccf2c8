"""Measurements of accuracy and speed beside the peers; each module prints tables, in one run.

What all share is here: their options, plain aligned tables with Markdown twins, and the line that states
the machine of the measurement. Linear algebra is held to one thread before numpy loads: times are those of
one core, and the trials already keep every core busy.
"""

from __future__ import annotations

import argparse
import math
import os
import platform
import re
from collections.abc import Sequence
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")

ABSENT = "—"


def options_parser(doc: str | None, quick: str) -> argparse.ArgumentParser:
    """Return the options of a benchmark: `--quick`, `--markdown` and what its module adds.

    Parameters
    ----------
    doc
        Docstring of the module; its command is the program's name.
    quick
        What `--quick` leaves.
    """
    named = re.search(r"python -m benchmarks\.\w+", doc or "")
    made = argparse.ArgumentParser(
        prog=named and named[0], description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    made.add_argument("--quick", action="store_true", help=quick)
    made.add_argument("--markdown", action="store_true", help="tables to paste into documents")
    return made


def machine() -> str:
    """Say what the numbers below were measured on."""
    try:
        load = f", load {os.getloadavg()[0]:.1f}"
    except OSError:
        load = ""
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy"))
    system = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores ({_processor()})"
    return f"machine: {system}{load}, Python {platform.python_version()}, {packages}"


def _processor() -> str:
    """Return the make of the processor, as far as the system states it."""
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
        return names[0] if names else "unknown processor"
    return platform.processor() or "unknown processor"


def number(value: float, digits: int = 3) -> str:
    """Write a number with `digits` significant digits and no exponent where it can be helped."""
    if not math.isfinite(value):
        return ABSENT
    if value == 0.0:
        return "0"
    decimals = max(digits - 1 - math.floor(math.log10(abs(value))), 0)
    return f"{value:.{decimals}f}" if decimals <= 6 else f"{value:.0e}"


def share(value: float) -> str:
    """Write a fraction as per cent, without the sign."""
    return f"{100 * value:.0f}" if math.isfinite(value) else ABSENT


def table(header: Sequence[str], rows: Sequence[Sequence[str]], *, text_columns: int, markdown: bool) -> str:
    """Set rows under a header.

    Parameters
    ----------
    header, rows
        Cells that are already written out.
    text_columns
        Number of first columns that are text and stand on the left; the others stand on the right.
    markdown
        Whether to draw the table for Markdown.
    """
    widths = [max(len(line[i]) for line in (header, *rows)) for i in range(len(header))]
    sides = ["<" if i < text_columns else ">" for i in range(len(header))]

    def line(cells: Sequence[str]) -> str:
        set_ = [f"{cell:{side}{width}}" for cell, side, width in zip(cells, sides, widths, strict=True)]
        return f"| {' | '.join(set_)} |" if markdown else "  ".join(set_).rstrip()

    marks = ["-" * w if side == "<" else "-" * (w - 1) + ":" for w, side in zip(widths, sides, strict=True)]
    rule = f"| {' | '.join(marks)} |" if markdown else "  ".join("-" * w for w in widths)
    return "\n".join([line(header), rule, *(line(row) for row in rows)])
