"""Routes with their tension for other programs: Slicer curves, VTK and PLY tubes, tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import trimesh

from tssgeom.atomic import replacing, write_text
from tssgeom.errors import SettingsError
from tssgeom.io.formats.units import PER_METRE
from tssgeom.io.results.slicer_curve import write_curve
from tssgeom.io.results.tension_line import TensionLine
from tssgeom.io.results.vtk_tube import write_vtp

Writer = Callable[[Path, TensionLine, trimesh.Trimesh], None]


def write_table(path: Path, line: TensionLine, tube: trimesh.Trimesh) -> None:
    """Write a row for each node: arc length, place, then the other numbers, each with its unit.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    per_metre = PER_METRE[line.unit]
    names = [f"{name}_{line.unit}" for name in ("s", "x", "y", "z")]
    numbers = np.column_stack([per_metre * line.s, per_metre * line.position, *line.values.values()])
    rows = (",".join(f"{number:.9g}" for number in row) for row in numbers.tolist())
    write_text(path, "\n".join([",".join([*names, *line.values]), *rows]) + "\n")


def write_ply(path: Path, line: TensionLine, tube: trimesh.Trimesh) -> None:
    """Write the tube with its colours and numbers.

    Raises
    ------
    SourceError
        Where the disk refuses.
    """
    with replacing(path) as draft:
        tube.copy().apply_scale(PER_METRE[line.unit]).export(draft)


WRITERS: dict[str, Writer] = {
    "mrk.json": write_curve,
    "vtp": write_vtp,
    "ply": write_ply,
    "csv": write_table,
}
"""The writer of each ending."""


def chosen_endings(asked: str) -> tuple[str, ...]:
    """Return the endings in a list such as "vtp,csv".

    Raises
    ------
    SettingsError
        Where one is none that is written.
    """
    endings = tuple(word.strip().lstrip(".") for word in asked.split(",") if word.strip())
    for ending in endings:
        if ending not in WRITERS:
            raise SettingsError(f"--export: no writer for {ending!r}: choose from {','.join(WRITERS)}")
    return endings


def write_exports(folder: Path, endings: Sequence[str], line: TensionLine, tube: trimesh.Trimesh) -> None:
    """Write a route in each of the formats, as `NAME_tension.ending`, which never is the name of its source.

    Parameters
    ----------
    folder, endings
        Where, and in which formats.
    line
        The route.
    tube
        A tube around it, whose vertices carry its numbers [m].

    Raises
    ------
    SourceError
        Where the disk refuses, or what a format needs is not installed.
    """
    for ending in endings:
        WRITERS[ending](folder / f"{line.name}_tension.{ending}", line, tube)
