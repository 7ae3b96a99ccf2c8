"""One sensed frame, and its points in another order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.result import Result
from tssgeom.rig import Source
from tssgeom.route.lost_ends import taken
from tssgeom.route.order import along_the_shortest_path


@dataclass(frozen=True, slots=True, repr=False)
class Frame(Result):
    """One sensed shape, and what was measured with it."""

    points: Points
    """Sensed points, proximal to distal; a row of NaN is a missing point [m]."""
    time: float = 0.0
    """Time of the frame [s]."""
    stations: Vector | None = None
    """Known arc length at each point, where the sensor measures it [m]."""
    tension_in: float | None = None
    """Total tension at the proximal end, as its sensor reads [N]."""
    tension_out: float | None = None
    """Measured tension at the distal end [N]."""
    displacement_in: float | None = None
    """Measured displacement of the proximal tendon end [m]."""
    elongation: float | None = None
    """Measured elongation [m]."""
    id: str | int = ""
    """The sender's own name of the frame."""
    displacement_target: float | None = None
    """Target position of the load, as a movement since the pretensioned state [m]."""
    tension_out_target: float | None = None
    """Target tension at the distal end [N]; not beside a displacement target."""
    curvatures: Matrix | None = None
    """Curvature components κ_x, κ_y of a fibre at its stations [n, 2]; the points are NaN then [1/m]."""
    directions: Points | None = None
    """Sensed unit tangents, towards the distal end; a row of NaN is one that was not sensed [n, 3]."""
    length: float | None = None
    """Known length of the route from the first to the last point [m]."""
    temperature: float | None = None
    """Measured temperature [°C]."""
    noise: float | None = None
    """Standard deviation of each coordinate across the route, where the sensor states it [m]."""
    curvature_noise: float | None = None
    """Standard deviation of each curvature component of a fibre, where it is stated [1/m]."""
    source: Source | None = None
    """Source of the points, where a file states it."""
    warnings: tuple[str, ...] = ()
    """What its reader did not read, a sentence each; the result has them too."""
    of_machine: Mapping[str, float] | None = None
    """What was measured of a machine, by channel in SI, and its target; docs/machines.md."""

    @property
    def drives_tendon(self) -> bool:
        """Whether it brings the drive of one tendon, or its target."""
        drives = (self.tension_in, self.displacement_in, self.displacement_target, self.tension_out_target)
        return any(each is not None for each in drives)


def in_order(frame: Frame, first: Vector | None) -> Frame:
    """Put the points of a frame in the order of the shortest path; `first` was its first point [3] [m]."""
    return with_rows(frame, along_the_shortest_path(frame.points, frame.directions, first))


def with_rows(frame: Frame, rows: np.ndarray) -> Frame:
    """Return a frame with these rows of its points and directions, of which -1 is a missing one."""
    directions = None if frame.directions is None else taken(frame.directions, rows)
    stations = frame.stations
    if stations is not None and len(stations) < len(rows):
        stations = taken(stations, rows)
    return replace(frame, points=taken(frame.points, rows), directions=directions, stations=stations)
