"""The sheath as a polygon whose bars and turns may change with time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True, slots=True)
class Path:
    """A polygon of n vertices and n + 1 bars, proximal to distal; linear in time between frames."""

    times: np.ndarray
    """[F] Times of the frames [s], increasing; a static path has one."""
    bars: np.ndarray
    """[F, n + 1] Lengths of the bars [m]."""
    turns: np.ndarray
    """[F, n] Turn of the direction at each vertex [rad], 0 ≤ turn < π."""

    @property
    def stations(self) -> np.ndarray:
        """[n] Arc length of each vertex in the first frame [m]."""
        return np.cumsum(self.bars[0])[:-1]

    @property
    def shares(self) -> np.ndarray:
        """[n] Length of sheath that belongs to each vertex in the first frame [m]."""
        edges = self.edges
        return np.diff(edges)

    @property
    def edges(self) -> np.ndarray:
        """[n + 1] Where the share of one vertex ends and the next begins [m]: mid-bar, and both ends."""
        stop = np.cumsum(self.bars[0])
        middle = 0.5 * (stop[:-2] + stop[1:-1])
        return np.concatenate(([0.0], middle, [stop[-1]]))


def from_pieces(lengths: ArrayLike, angles: ArrayLike, cells: int, times: Sequence[float] = (0.0,)) -> Path:
    """Return pieces of constant curvature as about `cells` cells, each with a vertex in its middle.

    No cell lies across two pieces; half of the cells go by length, half by angle. `lengths` [m] and `angles`
    [rad] are [k], or [F, k] where they change with time.
    """
    length, angle = np.broadcast_arrays(
        np.atleast_2d(lengths).astype(float), np.atleast_2d(angles).astype(float)
    )
    frames = max(len(times), len(length))
    length, angle = (np.broadcast_to(a, (frames, a.shape[1])) for a in (length, angle))
    turn = angle.max(axis=0)
    share = 0.5 * length[0] / length[0].sum() + 0.5 * turn / max(turn.sum(), 1e-12)
    count = np.maximum(np.rint(cells * share / share.sum()).astype(int), 1)
    cell = np.repeat(length / count, count, axis=1)
    turns = np.repeat(angle / count, count, axis=1)
    return Path(np.asarray(times, dtype=float), _bars(cell), turns)


def from_angle(edges: ArrayLike, angle: ArrayLike, times: Sequence[float] = (0.0,)) -> Path:
    """Return the route with accumulated angle [rad] at the edges of its cells [m], [n + 1] or [F, n + 1]."""
    edge, phi = np.broadcast_arrays(np.atleast_2d(edges).astype(float), np.atleast_2d(angle).astype(float))
    return Path(np.asarray(times, dtype=float), _bars(np.diff(edge, axis=1)), np.abs(np.diff(phi, axis=1)))


def from_points(points: ArrayLike, times: Sequence[float] = (0.0,)) -> Path:
    """Return the polygon through points [n + 2, 3] or [F, n + 2, 3] [m], from end to end."""
    position = np.asarray(points, dtype=float)
    step = np.diff(position[None] if position.ndim == 2 else position, axis=1)
    bars = np.linalg.norm(step, axis=2)
    way = step / bars[:, :, None]
    across = np.linalg.norm(np.cross(way[:, :-1], way[:, 1:]), axis=2)
    along = np.sum(way[:, :-1] * way[:, 1:], axis=2)
    return Path(np.asarray(times, dtype=float), bars, np.arctan2(across, along))


def _bars(cell: np.ndarray) -> np.ndarray:
    """Bars between the middles of cells [F, n], and half a cell at each end."""
    half = 0.5 * cell
    return np.concatenate((half[:, :1], half[:, :-1] + half[:, 1:], half[:, -1:]), axis=1)
