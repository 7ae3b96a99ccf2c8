"""How far a tube along a route is from the wall around it, where it touches, and where it is outside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Points, Vector, read_only
from tssgeom.lumen.wall import Wall, nearest
from tssgeom.route.route import Route

_SURE = 2.0  # standard deviations of a place that are allowed for
_MOST_NODES = 1000
_MUCH = 0.01  # of the length: less beyond the ends of a mesh is how it was cut


@dataclass(frozen=True, slots=True)
class Region:
    """A stretch of the route."""

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
    gap: Vector
    """Distance from the surface of the tube to the wall, NaN beyond the ends of the mesh [n] [m]."""
    place: Points
    """Nearest place on the wall [n, 3] [m]."""
    radius: float
    """Radius of the tube [m]."""
    contacts: tuple[Region, ...]
    """Where the tube touches, or may touch within the error of its places."""
    outside: tuple[Region, ...]
    """Where the middle of the tube is beyond the wall, by more than the error of its places."""
    beyond: float
    """Length of the route beyond the ends of the mesh [m]."""

    @property
    def narrowest(self) -> int:
        """Node of least clearance; -1 where the whole route is beyond the ends of the mesh."""
        return -1 if np.isnan(self.gap).all() else int(np.nanargmin(self.gap))

    @property
    def least(self) -> float | None:
        """Least clearance [m]; None where the whole route is beyond the ends of the mesh."""
        return None if self.narrowest < 0 else float(self.gap[self.narrowest])

    def warnings(self) -> tuple[str, ...]:
        """Say where the route is not inside."""
        said = [
            f"out of the lumen from s = {1e3 * one.begin:.1f} to {1e3 * one.end:.1f} mm, by up to "
            f"{-1e3 * (one.least + self.radius):.1f} mm: check that route and mesh share one frame"
            for one in self.outside
        ]
        if self.beyond > _MUCH * float(self.s[-1]):
            said.append(f"{1e3 * self.beyond:.1f} mm of the route lie beyond the ends of the lumen mesh")
        return tuple(said)


def clearance(route: Route, wall: Wall, radius: float = 0.0, most: int = _MOST_NODES) -> Clearance:
    """Measure the clearance of a tube along a route; docs/model.md (144).

    Parameters
    ----------
    route
        The route.
    wall
        The wall around it. Where it does not say which side is inside, most of the route is taken as it.
    radius
        Radius of the tube [m].
    most
        Nodes of the route that are looked at, evenly.
    """
    chosen = np.unique(np.linspace(0, len(route.s) - 1, min(len(route.s), most)).round().astype(int))
    s = route.s[chosen]
    found = nearest(wall, route.position[chosen])
    side = np.where(found.at_end, 0.0, found.side)
    inward = -1.0 if (side.sum() < 0 if wall.outward is None else wall.outward) else 1.0
    signed = np.where(found.at_end, np.nan, inward * found.side * found.distance)
    error = _SURE * route.noise
    share = np.gradient(s) if len(s) > 1 else np.zeros(1)
    return Clearance(
        s=read_only(s),
        gap=read_only(signed - radius),
        place=found.place,
        radius=radius,
        contacts=_regions(s, signed - radius, error),
        outside=tuple(Region(one.begin, one.end, one.least - radius) for one in _regions(s, signed, -error)),
        beyond=float(share[found.at_end].sum()),
    )


def _regions(s: Vector, value: Vector, most: float) -> tuple[Region, ...]:
    """Stretches in which a value along the route is at most so large, their ends between nodes."""
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
