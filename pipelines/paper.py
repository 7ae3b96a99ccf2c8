"""`tssgeom paper`: the paper's figures and numbers from the model, beside what it printed.

What it needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipelines.options import FigureStyle, Json, Quiet
from pipelines.terminal import counted_progress, print_json, print_table
from tssgeom.view.figures.style import choose

if TYPE_CHECKING:
    from tssgeom.io.results.keys.designs import PaperNumber
    from tssgeom.tendon.paper import Row

_TITLE = "Sun, Wang and Phee 2014: the paper's numbers and ours"
_BRACKETS = "Numbers in brackets follow from the paper's equations and are not printed in it."
_COLUMNS = ("figure", "quantity", "unit", "paper", "ours", "difference")


def paper(
    out: Annotated[Path, typer.Option("--out", help="Folder for figures, table and recording.")],
    style: FigureStyle = "light",
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Draw figures 4 to 8 of the paper from the model, and set its numbers beside ours."""
    from tssgeom.atomic import write_text
    from tssgeom.tendon.paper import EXACT, rows

    choose(style)
    numbers = rows()
    plotted = _draw(out, quiet=quiet or as_json)
    write_text(out / "paper.csv", _as_csv(numbers))
    write_text(out / "paper.md", _as_markdown(numbers))
    files = sorted([*plotted, "paper.csv", "paper.md"])
    if as_json:
        print_json({"numbers": [_object(row) for row in numbers], "files": files})
    elif not quiet:
        cells = [_cells(row)[:-1] for row in numbers]
        notes = [f"{row.figure}, {row.quantity}: {row.why}" for row in numbers if row.why != EXACT]
        print_table(_TITLE, _COLUMNS, cells, notes=[*notes, _BRACKETS, f"{len(files)} files in {out}"])


def _draw(out: Path, *, quiet: bool) -> list[str]:
    from pipelines.figures import write_figure
    from tssgeom.atomic import replacing
    from tssgeom.view.figures.paper import paper_figures
    from tssgeom.view.scene.paper import write_paper_recording

    written = list[str]()
    figures = paper_figures()
    with counted_progress(len(figures) + 1, quiet=quiet) as progress:
        for name, draw in figures.items():
            progress.begin(name)
            written += write_figure(draw, out, name)
            progress.end(name)
        progress.begin("paper.rrd")
        with replacing(out / "paper.rrd") as draft:
            write_paper_recording(draft)
        progress.end("paper.rrd")
    return [*written, "paper.rrd"]


def _object(row: Row) -> PaperNumber:
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
    return [row.figure, row.quantity, row.unit, paper, ours, difference, row.why]


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
