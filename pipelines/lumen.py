"""The lumen around the route of an input, and how far the route is from it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipelines.inputs import RunSettings
from tssgeom.io.formats.meshes import lumen_beside, read_lumen, wall_of
from tssgeom.io.results.shapes import Analysis, clearance_columns, clearance_object
from tssgeom.lumen.clearance import Clearance, clearance
from tssgeom.lumen.wall import Wall
from tssgeom.stream import FrameResult

if TYPE_CHECKING:
    import trimesh

_PICTURE_NODES = 128  # chosen: nodes along a route on which a picture shows its clearance


@dataclass(frozen=True, slots=True)
class SensedLumen:
    """The lumen around a route, for its picture and its clearance."""

    name: str
    mesh: trimesh.Trimesh
    wall: Wall
    radius: float
    """Radius of the tube [m]."""

    def clearance(self, result: FrameResult) -> Clearance:
        """Return the clearance of one frame."""
        return clearance(result.route, self.wall, self.radius)

    def clearance_in_picture(self, result: FrameResult) -> Clearance:
        """Return the clearance of one frame on the nodes that a picture shows."""
        return clearance(result.route, self.wall, self.radius, _PICTURE_NODES)


def lumen_of(path: Path, unit: str, settings: RunSettings) -> SensedLumen | None:
    """Read the mesh around a shape: that of `--lumen`, else the file beside the shape.

    Raises ShapeError or SourceError where the mesh cannot be used.
    """
    file = settings.lumen or lumen_beside(path)
    if file is None:
        return None
    mesh = read_lumen(file, unit)
    return SensedLumen(file.name, mesh, wall_of(mesh), settings.tube_radius)


def add_clearance(
    report: dict[str, Any], row: dict[str, Any], analysis: Analysis, lumen: SensedLumen
) -> None:
    """Add the clearance of the last good frame to the JSON object, that of the summary's frame to its row."""
    last = lumen.clearance(analysis.results[-1])
    result = analysis.representative
    summarised = last if result is analysis.results[-1] else lumen.clearance(result)
    report["clearance"] = clearance_object(lumen.name, last)
    report["warnings"] = [*report["warnings"], *last.warnings()]
    row |= clearance_columns(summarised)
    row["warnings"] = [*row["warnings"], *summarised.warnings()]
