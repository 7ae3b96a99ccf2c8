"""Figures as files; each is written whole or not at all."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tssgeom.atomic import replacing

if TYPE_CHECKING:
    from tssgeom.stream import FrameResult
    from tssgeom.view.figures.plots import Figure


def write_figure(
    draw: Callable[[], Figure], folder: Path, name: str, formats: Sequence[str] = ("pdf", "svg", "png")
) -> list[str]:
    """Draw a figure in the chosen style, write it in each of the formats, and return the names of the files.

    Raises SourceError where the disk refuses.
    """
    from tssgeom.view.figures.plots import save
    from tssgeom.view.figures.style import for_print

    with for_print():
        figure = draw()
    for ending in formats:
        with replacing(folder / f"{name}.{ending}") as draft:
            save(figure, draft)
    return [f"{name}.{ending}" for ending in formats]


def write_figures(folder: Path, name: str, figures: Mapping[str, Callable[[], Figure]]) -> list[str]:
    """Draw figures and write each as PDF and SVG, `NAME_FIGURE`, in the chosen style; return their names.

    Raises SourceError where the disk refuses.
    """
    from tssgeom.view.figures.plots import VECTOR

    return [
        file
        for part, draw in figures.items()
        for file in write_figure(draw, folder, f"{name}_{part}", VECTOR)
    ]


def write_shape_figures(
    folder: Path, name: str, result: FrameResult, results: Sequence[FrameResult], *, timed: bool
) -> list[str]:
    """Draw the report's figures of a shape or of one frame of a recording, and return the names of the files.

    Raises SourceError where the disk refuses.
    """
    from tssgeom.view.figures.shapes import figures_of
    from tssgeom.view.report.entry import series_of

    return write_figures(folder, name, figures_of(result, series_of(results) if timed else None))
