"""One engine for live, replay and batch: frames in, results out, in order."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.errors import TssgeomError
from tssgeom.settings import Rig
from tssgeom.shape.arcs import Arcs
from tssgeom.shape.curvature import CurvatureProfile
from tssgeom.shape.fibre.sensed import clean_fibre, measure_fibre, sensed_shape
from tssgeom.shape.following import Followed, follow
from tssgeom.shape.points import Shape, clean
from tssgeom.shape.route import Route
from tssgeom.tendon.profile import TendonState, pretensioned, step
from tssgeom.tendon.transmission import Transmission, transmit


@dataclass(frozen=True, slots=True)
class Frame:
    """One sensed shape, and what was measured with it."""

    points: Points
    """Sensed points, proximal to distal; a row of NaN is a point that was not seen [m]."""
    time: float = 0.0
    """Time of the frame [s]."""
    stations: Vector | None = None
    """Known arc length at each point, where the sensor tells it [m]."""
    tension_in: float | None = None
    """Total tension at the proximal end [N]."""
    tension_out: float | None = None
    """Measured tension at the distal end [N]."""
    displacement_in: float | None = None
    """Measured displacement of the proximal tendon end [m]."""
    elongation: float | None = None
    """Measured elongation [m]."""
    id: str = ""
    """The sender's own name of the frame."""
    curvatures: Matrix | None = None
    """Curvature components κ_x, κ_y of a fibre at its stations [n, 2]; the points are NaN then [1/m]."""


@dataclass(frozen=True, slots=True)
class FrameResult:
    """Geometry and transmission of one frame."""

    seq: int
    """Count of the frame on arrival, from 0."""
    frame: Frame
    shape: Shape
    route: Route
    profile: CurvatureProfile
    arcs: Arcs
    followed: Followed
    """Where the fit of the next frame starts."""
    state: TendonState
    transmission: Transmission
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Rejected:
    """A frame that could not be used; the tendon's state is as before it."""

    seq: int
    time: float
    reason: str
    id: str = ""


def process(
    frames: Iterable[Frame | Rejected], rig: Rig, *, tension_in: float, state: TendonState | None = None
) -> Iterator[FrameResult | Rejected]:
    """Turn frames into results, one for each frame and in their order; each fit starts from the last one.

    Parameters
    ----------
    frames
        Sensed shapes, read one at a time; what the reader rejected passes through.
    rig
        Tendon, friction and sensors.
    tension_in
        Total tension at the proximal end for frames that bring none [N].
    state
        Tension along the tendon before the first frame; the rig's pretension by default.
    """
    current = pretensioned(rig) if state is None else state
    last: Followed | None = None
    for seq, frame in enumerate(frames):
        if isinstance(frame, Rejected):
            yield replace(frame, seq=seq)
            continue
        try:
            result = advance(seq, frame, current, rig, tension_in, last)
        except TssgeomError as error:
            yield Rejected(seq, frame.time, str(error), frame.id)
        else:
            current, last = result.state, result.followed
            yield result


def advance(
    seq: int,
    frame: Frame,
    state: TendonState,
    rig: Rig,
    tension_in: float,
    last: Followed | None = None,
) -> FrameResult:
    """Carry the tendon from `state` over one frame, its geometry from that of the `last` one.

    Raises
    ------
    ShapeError
        Where the points cannot be a route.
    SettingsError
        Where the tension is negative or not finite.
    """
    shape, followed = _followed(frame, rig, last)
    geometry = followed.geometry
    drive = tension_in if frame.tension_in is None else frame.tension_in
    moved = step(state, drive, rig.friction.coefficient)
    return FrameResult(
        seq=seq,
        frame=frame,
        shape=shape,
        route=geometry.route,
        profile=geometry.profile,
        arcs=geometry.arcs,
        followed=followed,
        state=moved,
        transmission=transmit(moved, geometry.arcs, rig),
        warnings=shape.warnings + geometry.route.warnings,
    )


def _followed(frame: Frame, rig: Rig, last: Followed | None) -> tuple[Shape, Followed]:
    """Geometry of a frame: of a fibre from its curvatures alone, of points from where the last frame was."""
    if frame.curvatures is not None:
        fibre = clean_fibre(frame.curvatures, frame.stations)
        geometry = measure_fibre(fibre, rig.shape.curvature_noise_per_m)
        return sensed_shape(fibre, geometry), Followed(geometry, fibre.index)
    shape = clean(frame.points, frame.stations)
    of_points = last is not None and (last.geometry.chain is not None or last.geometry.spline is not None)
    return shape, follow(shape, rig.shape.noise, last if of_points else None)
