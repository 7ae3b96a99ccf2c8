"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from tssgeom.io.formats.lengths import LengthUnit
from tssgeom.view.figures.style import StyleName

TENSION_IN = 15.0
"""Tension at the proximal end where neither the file nor the user gives one [N]; cited: the paper's runs."""

Inputs = Annotated[
    list[Path], typer.Argument(help="Files or folders of shapes and recordings.", readable=False)
]
"""The command itself checks whether each can be read, so that one unreadable file leaves the others alone."""
Shapes = Annotated[
    Path | None,
    typer.Argument(help="A shape, or a recording of a route that moves; left out, the even bend of the rig."),
]
RigFile = Annotated[Path | None, typer.Option("--rig", help="Rig file (TOML); the paper's rig by default.")]
TensionIn = Annotated[
    float | None,
    typer.Option(
        "--tension-in",
        min=0.0,
        help=f"Proximal tension for frames without one [N]; {TENSION_IN:g} where it is not given.",
    ),
]
Unit = Annotated[
    LengthUnit | None, typer.Option("--unit", help="Unit of files that state none in their header.")
]
Map = Annotated[
    list[str] | None,
    typer.Option(
        "--map",
        metavar="NAME=CHANNEL[:UNIT]",
        help='What a column of a table is, such as "Pos=displacement_in_m:mm"; may be repeated.',
    ),
]
TubeMm = Annotated[
    float | None,
    typer.Option("--tube-mm", help="Outer diameter of the tube in mm, for its clearance and its mesh."),
]
GeometryOnly = Annotated[
    bool, typer.Option("--geometry-only", help="Each frame of a recording is a first pull of its tendon.")
]
ToleranceMm = Annotated[
    float | None,
    typer.Option(
        "--tolerance-mm", help="Flag targets that the distal end misses by more with a probability above 5 %."
    ),
]
PolicyChoice = Annotated[
    Literal["cross", "wait"],
    typer.Option(
        "--policy",
        help="At a reversal, cross the dead zone at once, or wait inside it while that is near enough.",
    ),
]
Figures = Annotated[
    Path | None, typer.Option("--figures", help="Folder for figures for print, as PDF and SVG.")
]
FigureStyle = Annotated[
    StyleName, typer.Option("--style", help="Of the figures: light, dark, or paper: column width, no titles.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON on stdout instead of a table.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing on stdout and no progress.")]
