"""Meshes of the lumen around a route, in metres."""

from __future__ import annotations

import os
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tssgeom.errors import ShapeError, SourceError, first_line, require_file, unreadable
from tssgeom.io.formats.paths import Stamp, bytes_of, split, stamp_of
from tssgeom.io.formats.recording import PER_METRE
from tssgeom.lumen.wall import Wall

if TYPE_CHECKING:
    import trimesh

ENDINGS = (".ply", ".stl", ".obj", ".glb")
_MARK = "_lumen"
_FARTHEST = 1e9  # largest coordinate of a corner, in the unit of the mesh; chosen: no body is so large


def lumen_beside(path: str | Path) -> Path | None:
    """Return the mesh NAME_lumen.* beside a shape file whose stem is NAME or begins with NAME and a mark.

    Of several names that fit, the longest counts; of several endings the first of .ply .stl .obj .glb.
    """
    path, _ = split(Path(path))
    fitting = [mesh for mesh in _meshes_in(path.parent) if _belongs(path.stem, _name(mesh))]
    if not fitting:
        return None
    return min(fitting, key=lambda mesh: (-len(_name(mesh)), ENDINGS.index(mesh.suffix.lower()), mesh.name))


def read_lumen(path: str | Path, unit: str) -> trimesh.Trimesh:
    """Read a mesh.

    Parameters
    ----------
    path
        An .stl, .obj, .ply or .glb file; a mesh states no unit.
    unit
        Unit of its coordinates, "mm" or "m".

    Returns
    -------
    trimesh.Trimesh
        The mesh, coordinates in metres.

    Raises
    ------
    SourceError
        Where the file cannot be read as a mesh.
    ShapeError
        Where it holds no triangles, or impossible corners, or where the unit is unknown.
    """
    path = Path(path)
    if unit not in PER_METRE:
        raise ShapeError(f"{path}: the unit is {unit!r}: give mm or m")
    if path.suffix.lower() not in ENDINGS:
        raise SourceError(f"{path}: no reader takes {path.suffix!r} as a mesh: use {', '.join(ENDINGS)}")
    require_file(path)
    if not path.is_file():
        raise SourceError(f"{path}: no such file: check the path")
    mesh = _loaded(path)
    if np.shape(getattr(mesh, "faces", ()))[1:] != (3,) or len(mesh.faces) == 0:
        raise ShapeError(f"{path}: the mesh has no triangles: export a surface")
    near = mesh.vertices.shape[1] == 3 and (np.abs(mesh.vertices) <= _FARTHEST).all()
    if not near or not 0 <= mesh.faces.min() <= mesh.faces.max() < len(mesh.vertices):
        raise ShapeError(f"{path}: the mesh has impossible corners: export it anew")
    mesh.apply_scale(1.0 / PER_METRE[unit])
    return mesh


def wall_of(mesh: trimesh.Trimesh) -> Wall:
    """Return the triangles of a mesh; the volume of a closed one gives the side that is inside."""
    corners = np.ascontiguousarray(mesh.vertices[mesh.faces], dtype=np.float64)
    return Wall(corners, bool(mesh.volume > 0) if mesh.is_watertight else None)


def _loaded(path: Path) -> trimesh.Trimesh:
    import trimesh

    content = BytesIO(bytes_of(path))
    try:
        with np.errstate(all="ignore"):  # impossible corners are refused below, in one line
            return trimesh.load_mesh(content, file_type=path.suffix[1:].lower())
    except OSError as error:
        raise unreadable(path, error) from error
    except Exception as error:  # a broken file can make the loaders of trimesh raise anything
        raise SourceError(
            f"{path}: cannot be read as a mesh ({first_line(error)}): export it anew"
        ) from error


def _meshes_in(folder: Path) -> list[Path]:
    return _meshes_once(folder, stamp_of(folder)) if folder.is_dir() else []


@lru_cache(maxsize=16)
def _meshes_once(folder: Path, stamp: Stamp) -> list[Path]:
    """Read a folder once, not for each file in it."""
    return [folder / name for name in os.listdir(folder) if _MARK in name and is_lumen(Path(name))]


def is_lumen(path: Path) -> bool:
    """Whether a file is named NAME_lumen.*, as the mesh beside a shape."""
    return path.stem.endswith(_MARK) and path.suffix.lower() in ENDINGS


def _name(mesh: Path) -> str:
    return mesh.stem.removesuffix(_MARK)


def _belongs(stem: str, name: str) -> bool:
    rest = stem.removeprefix(name)
    return bool(name) and stem.startswith(name) and not rest[:1].isalnum()
