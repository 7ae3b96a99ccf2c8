"""How far a tube along a route is from the wall around it, where it touches, and where it is outside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Points, Vector, read_only
from tssgeom.lumen.wall import Wall, nearest
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.route.route import Route
from tssgeom.statistics import NORMAL_95

_MOST_NODES = 1000  # of a route, evenly


@dataclass(frozen=True, slots=True)
class Region:
    """A part of the route between two arc lengths."""

    begin: float
    """Arc length [m]."""
    end: float
    """Arc length [m]."""
    least: float
    """Least clearance in it, negative where the tube would reach into the wall [m]."""


@dataclass(frozen=True, slots=True)
class Clearance:
    """Clearance along a route."""

    s: Vector
    """Arc length of the nodes [n] [m]."""
    distance: Vector
    """Clearance from the surface of the tube to the wall, NaN beyond the ends of the mesh [n] [m]."""
    wall_position: Points
    """Nearest point of the wall [n, 3] [m]."""
    radius: float
    """Radius of the tube [m]."""
    contacts: tuple[Region, ...]
    """Where the tube touches the wall, or may touch it within the noise of the route."""
    outside: tuple[Region, ...]
    """Where the centre line is beyond the wall by more than the noise of the route."""
    beyond: float
    """Length of the route beyond the ends of the mesh [m]."""

    @property
    def narrowest(self) -> int:
        """Node of least clearance; -1 where the whole route is beyond the ends of the mesh."""
        return -1 if np.isnan(self.distance).all() else int(np.nanargmin(self.distance))

    @property
    def least(self) -> float | None:
        """Least clearance [m]; None where the whole route is beyond the ends of the mesh."""
        return None if self.narrowest < 0 else float(self.distance[self.narrowest])

    def warnings(self) -> tuple[str, ...]:
        """Return a warning for each region outside the lumen, and for much length beyond the mesh."""
        texts = [
            f"out of the lumen from s = {1e3 * one.begin:.1f} to {1e3 * one.end:.1f} mm, by up to "
            f"{-1e3 * (one.least + self.radius):.1f} mm: check that route and mesh share one frame"
            for one in self.outside
        ]
        if self.beyond > PLAUSIBLE.negligible * float(self.s[-1]):
            texts.append(f"{1e3 * self.beyond:.1f} mm of the route lie beyond the ends of the lumen mesh")
        return tuple(texts)


def clearance(route: Route, wall: Wall, radius: float = 0.0, most: int = _MOST_NODES) -> Clearance:
    """Measure the clearance of a tube along a route; docs/model.md (144).

    Parameters
    ----------
    route
        The route.
    wall
        The wall around it. Where its inner side is not known, it is the side on which most of the route lies.
    radius
        Radius of the tube [m].
    most
        Nodes of the route at which the clearance is measured, evenly.
    """
    chosen = np.unique(np.linspace(0, len(route.s) - 1, min(len(route.s), most)).round().astype(int))
    s = route.s[chosen]
    feet = nearest(wall, route.position[chosen])
    side = np.where(feet.on_rim, 0.0, feet.side)
    inward = -1.0 if (side.sum() < 0 if wall.outward is None else wall.outward) else 1.0
    signed = np.where(feet.on_rim, np.nan, inward * feet.side * feet.distance)
    error = NORMAL_95 * route.noise
    length = np.gradient(s) if len(s) > 1 else np.zeros(1)
    return Clearance(
        s=read_only(s),
        distance=read_only(signed - radius),
        wall_position=feet.position,
        radius=radius,
        contacts=_regions(s, signed - radius, error),
        outside=tuple(Region(one.begin, one.end, one.least - radius) for one in _regions(s, signed, -error)),
        beyond=float(length[feet.on_rim].sum()),
    )


def _regions(s: Vector, value: Vector, most: float) -> tuple[Region, ...]:
    """Regions in which a value along the route is at most `most`, their ends between nodes."""
    low = np.nan_to_num(value, nan=np.inf) <= most
    edges = np.flatnonzero(np.diff(np.concatenate(([False], low, [False])).astype(np.int8)))
    return tuple(
        Region(
            _crossing(s, value, most, first, -1),
            _crossing(s, value, most, last - 1, 1),
            float(value[first:last].min()),
        )
        for first, last in edges.reshape(-1, 2)
    )


def _crossing(s: Vector, value: Vector, level: float, node: int, step: int) -> float:
    """Arc length at which a value leaves a region after a node, towards the next one."""
    after = node + step
    if not 0 <= after < len(s) or np.isnan(value[after]) or value[after] == value[node]:
        return float(s[node])
    return float(s[node] + (level - value[node]) / (value[after] - value[node]) * (s[after] - s[node]))
