"""`tssgeom paper`: the paper's figures and numbers from the model, beside what it printed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pipelines.console import say, show, tracking
from pipelines.drawing import write_figure
from tssgeom.atomic import replacing, write_text
from tssgeom.tendon.paper import EXACT, Row, rows

_TITLE = "Sun, Wang and Phee 2014: the paper's numbers and ours"
_BRACKETS = "Numbers in brackets follow from the paper's equations and are not printed in it."
_COLUMNS = ("figure", "quantity", "unit", "paper", "ours", "difference")


def run(out: Path, *, as_json: bool, quiet: bool) -> int:
    """Write figures, table and recording into a folder, show the table, and return the exit status.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    numbers = rows()
    written = _draw(out, quiet=quiet or as_json)
    write_text(out / "paper.csv", _as_csv(numbers))
    write_text(out / "paper.md", _as_markdown(numbers))
    files = sorted([*written, "paper.csv", "paper.md"])
    if as_json:
        told = {"numbers": [_object(row) for row in numbers], "files": files}
        say(json.dumps(told, indent=1, ensure_ascii=False, allow_nan=False))
    elif not quiet:
        cells = [_cells(row)[:-1] for row in numbers]
        notes = [f"{row.figure}, {row.quantity}: {row.why}" for row in numbers if row.why != EXACT]
        show(_TITLE, _COLUMNS, cells, notes=[*notes, _BRACKETS, f"{len(files)} files in {out}"])
    return 0


def _draw(out: Path, *, quiet: bool) -> list[str]:
    from tssgeom.view.figures.paper import paper_figures
    from tssgeom.view.scene.paper import write_paper_recording

    written = list[str]()
    figures = paper_figures()
    with tracking(len(figures) + 1, quiet=quiet) as tracker:
        for name, draw in figures.items():
            tracker.begin(name)
            written += write_figure(draw(), out, name)
            tracker.end(name)
        tracker.begin("paper.rrd")
        with replacing(out / "paper.rrd") as draft:
            write_paper_recording(draft)
        tracker.end("paper.rrd")
    return [*written, "paper.rrd"]


def _object(row: Row) -> dict[str, Any]:
    return {
        "figure": row.figure,
        "quantity": row.quantity,
        "unit": row.unit,
        "paper": row.paper,
        "printed_in_paper": row.printed,
        "ours": row.ours,
        "difference": row.difference,
        "why": row.why,
    }


def _cells(row: Row) -> list[str]:
    """Cells of a row as people read them; a number that is not printed in the paper stands in brackets."""
    paper = f"{row.paper:g}" if row.printed else f"({row.paper:g})"
    difference = f"{row.difference:+.4f}".replace("-0.0000", "+0.0000")
    ours = f"{row.ours:.4g}" if row.unit != "mm" else f"{row.ours:.4f}"
    return [
        row.figure,
        row.quantity,
        row.unit,
        paper,
        ours,
        difference,
        row.why,
    ]


def _as_markdown(numbers: list[Row]) -> str:
    head = "| figure | quantity | unit | paper | ours | difference | remark |\n|---|---|---|--:|--:|--:|---|"
    lines = ["| " + " | ".join(cell.replace("|", "\\|") for cell in _cells(row)) + " |" for row in numbers]
    return f"# {_TITLE}\n\n" + "\n".join([head, *lines]) + f"\n\n{_BRACKETS}\n"


def _as_csv(numbers: list[Row]) -> str:
    names = list(_object(numbers[0]))
    lines = [[_csv_cell(value) for value in _object(row).values()] for row in numbers]
    return "\n".join(",".join(cells) for cells in [names, *lines]) + "\n"


def _csv_cell(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.9g}"
    return '"' + str(value).replace('"', '""') + '"'
