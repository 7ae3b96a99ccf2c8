"""Figures on disk, whole or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from tssgeom.io.atomic import replacing

if TYPE_CHECKING:
    from tssgeom.view.plots import Figure


def write_figure(drawing: Figure, folder: Path, name: str) -> list[str]:
    """Write a figure as PDF, SVG and PNG, and return the names of the files.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    from tssgeom.view.plots import FORMATS, save

    for ending in FORMATS:
        with replacing(folder / f"{name}.{ending}") as draft:
            save(drawing, draft)
    return [f"{name}.{ending}" for ending in FORMATS]
