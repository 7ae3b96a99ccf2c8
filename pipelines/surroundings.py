"""The lumen around the route of an input, and how far the route is from it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipelines.work import Options
from tssgeom.io.formats.meshes import lumen_beside, read_lumen, wall_of
from tssgeom.io.results.shapes import Analysis, clearance_columns, clearance_object
from tssgeom.lumen.clearance import Clearance, clearance
from tssgeom.lumen.wall import Wall
from tssgeom.stream import FrameResult

if TYPE_CHECKING:
    import trimesh

_SKETCHED = 128


@dataclass(frozen=True, slots=True)
class Surroundings:
    """A lumen, for the picture and for the clearance."""

    name: str
    mesh: trimesh.Trimesh
    wall: Wall
    radius: float
    """Radius of the tube [m]."""

    def clearance(self, result: FrameResult) -> Clearance:
        """Return the clearance of one frame."""
        return clearance(result.route, self.wall, self.radius)

    def sketch(self, result: FrameResult) -> Clearance:
        """Return the clearance of one frame on as many nodes as a picture shows."""
        return clearance(result.route, self.wall, self.radius, _SKETCHED)


def surroundings(path: Path, unit: str, chosen: Options) -> Surroundings | None:
    """Read the mesh around a shape: the one that was asked for, else the one beside it.

    Raises
    ------
    ShapeError, SourceError
        Where the mesh cannot be used.
    """
    found = chosen.lumen or lumen_beside(path)
    if found is None:
        return None
    mesh = read_lumen(found, unit)
    return Surroundings(found.name, mesh, wall_of(mesh), chosen.tube_radius)


def tell_clearance(
    told: dict[str, Any], row: dict[str, Any], analysis: Analysis, around: Surroundings
) -> None:
    """Add the clearance to the object of an input, for its last good frame, and to its row in the summary."""
    last = around.clearance(analysis.results[-1])
    standing = (
        last if analysis.representative is analysis.results[-1] else around.clearance(analysis.representative)
    )
    told["clearance"] = clearance_object(around.name, last)
    told["warnings"] = [*told["warnings"], *last.warnings()]
    row |= clearance_columns(standing)
    row["warnings"] = [*row["warnings"], *standing.warnings()]
