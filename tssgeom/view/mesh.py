"""Tube meshes of the sheath, coloured by the tension inside it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from tssgeom.arrays import Points, Vector
from tssgeom.errors import ShapeError
from tssgeom.view.colours import tension_rgb
from tssgeom.view.samples import round_up

SIDES = 16


def tube(
    position: Points,
    tangent: Points,
    tension: Vector,
    radius: float,
    *,
    top: float | None = None,
    carried: Mapping[str, Vector] | None = None,
) -> trimesh.Trimesh:
    """Sweep a circle along a route and close both ends.

    Parameters
    ----------
    position
        Nodes of the route, proximal to distal [m].
    tangent
        Unit tangent at each node.
    tension
        Tension at each node [N].
    radius
        Radius of the tube [m].
    top
        Tension of the brightest colour [N]; the largest tension, rounded up, by default.
    carried
        Further values at each node, such as the tension itself; the vertices carry them by name.

    Returns
    -------
    Trimesh
        Watertight, normals outward, vertices coloured by tension.

    Raises
    ------
    ShapeError
        Where the radius is not positive.
    """
    if not radius > 0:
        raise ShapeError(f"tube radius is {1e3 * radius:g} mm: give a radius > 0 mm")
    rings = position[:, None] + radius * _circles(tangent)
    vertices = np.concatenate([rings.reshape(-1, 3), position[[0, -1]]])
    brightest = round_up(float(tension.max())) if top is None else top
    shades = _vertex_colours(tension, brightest)
    mesh = trimesh.Trimesh(vertices, _faces(len(position)), vertex_colors=shades, process=False)
    for name, values in (carried or {}).items():
        mesh.vertex_attributes[name] = _on_vertices(values.astype(np.float32))
    return mesh


def rotation_minimising_frame(tangent: Points) -> tuple[Points, Points]:
    """Carry a pair of unit normals along a curve without twist.

    Parameters
    ----------
    tangent
        Unit tangents [n, 3].

    Returns
    -------
    tuple of Points
        First and second normal [n, 3]; with the tangent they are right-handed.
    """
    first = np.empty_like(tangent)
    first[0] = _any_normal(tangent[0])
    for node in range(1, len(tangent)):
        carried = _rotated(first[node - 1], tangent[node - 1], tangent[node])
        carried -= (carried @ tangent[node]) * tangent[node]
        first[node] = carried / np.linalg.norm(carried)
    return first, np.cross(tangent, first)


def _any_normal(tangent: Vector) -> Vector:
    axis = np.eye(3)[np.argmin(np.abs(tangent))]
    normal = axis - (axis @ tangent) * tangent
    return normal / np.linalg.norm(normal)


def _rotated(vector: Vector, old: Vector, new: Vector) -> Vector:
    """Rotate `vector` by the smallest rotation that takes the unit vector `old` to `new`."""
    middle = old + new
    reflected = vector - 2 * (vector @ old) * old
    square = float(middle @ middle)
    return reflected - 2 * (reflected @ middle) / square * middle if square > 1e-12 else vector


def _circles(tangent: Points) -> NDArray[np.float64]:
    """Return unit circles [n, SIDES, 3] square to the tangents."""
    first, second = rotation_minimising_frame(np.asarray(tangent, dtype=np.float64))
    angle = np.linspace(0.0, 2 * np.pi, SIDES, endpoint=False)[:, None]
    return np.cos(angle) * first[:, None] + np.sin(angle) * second[:, None]


def _faces(nodes: int) -> NDArray[np.intp]:
    """Triangles of the wall and both caps; the last two vertices are the middles of the caps."""
    side = np.arange(SIDES, dtype=np.intp)
    after = np.roll(side, -1)
    last = (nodes - 1) * SIDES
    bottom, top = nodes * SIDES, nodes * SIDES + 1
    start = np.arange(nodes - 1)[:, None] * SIDES
    lower = np.stack([start + side, start + after, start + SIDES + side], axis=2).reshape(-1, 3)
    upper = np.stack([start + after, start + SIDES + after, start + SIDES + side], axis=2).reshape(-1, 3)
    caps = [
        np.column_stack([after, side, np.full(SIDES, bottom)]),
        np.column_stack([last + side, last + after, np.full(SIDES, top)]),
    ]
    return np.concatenate([lower, upper, *caps])


def _vertex_colours(tension: Vector, top: float) -> NDArray[np.uint8]:
    rgb = np.rint(255 * tension_rgb(tension, top)).astype(np.uint8)
    rgba = np.column_stack([rgb, np.full(len(rgb), 255, dtype=np.uint8)])
    return _on_vertices(rgba)


def _on_vertices(at_nodes: NDArray[Any]) -> NDArray[Any]:
    """Repeat the value of each node for its ring, then those of both ends for the middles of the caps."""
    return np.concatenate([np.repeat(at_nodes, SIDES, axis=0), at_nodes[[0, -1]]])
