"""One engine for live, replay and batch: frames in, results out, in order."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

from tssgeom.effects import named
from tssgeom.errors import TssgeomError
from tssgeom.frame import Frame, fit_frame, smoothed_in_time, smoothed_in_windows, with_shared_errors_of
from tssgeom.plausibility.frames import FrameWatch, frame_remarks, strain_remarks
from tssgeom.rig import Rig
from tssgeom.route.curvature import CurvatureProfile
from tssgeom.route.observations import Shape
from tssgeom.route.pieces import Arcs
from tssgeom.route.resolution import NO_ERRORS, SharedErrors
from tssgeom.route.route import Route
from tssgeom.route.route_fit import RouteFit
from tssgeom.route.time_filter import PointFilter
from tssgeom.route.tracking import TrackedFit, model_checked
from tssgeom.tendon.command import Command
from tssgeom.tendon.command_error import Step
from tssgeom.tendon.commander import Commander, Given, commander_of
from tssgeom.tendon.state import TendonState, pretensioned, transmit_after
from tssgeom.tendon.transmission import Transmission

_FAULTS = (TssgeomError, ArithmeticError)  # of one frame: the next may be sound
_STANDS = 0.5  # probability from which a route is taken to stand [1]; chosen


@dataclass(frozen=True, slots=True)
class FrameResult:
    """Geometry and transmission of one frame."""

    seq: int
    """Count of the frame on arrival, from 0."""
    frame: Frame
    shape: Shape
    fit: RouteFit
    """The fit of the route, at its resolution, with all errors of its source."""
    tracked: TrackedFit
    """The fit from which that of the next frame starts."""
    state: TendonState
    transmission: Transmission
    warnings: tuple[str, ...] = ()
    command: Command | None = None
    """What the drive has to do for the frame's target, where it has one."""
    commander: Commander | None = None
    """What commands the next frame."""

    @property
    def displacement_command(self) -> float | None:
        """Position of the drive at which the frame's target is reached, where it has one [m]."""
        return None if self.command is None else self.command.displacement_in

    @property
    def tension_command(self) -> float | None:
        """Proximal tension at which the frame's target is reached, where it has one [N]."""
        return None if self.command is None else self.command.tension_in

    @property
    def arcs(self) -> Arcs:
        """The route as pieces of constant curvature."""
        return self.fit.arcs

    @property
    def route(self) -> Route:
        """The route on its nodes."""
        return self.fit.route

    @property
    def profile(self) -> CurvatureProfile:
        """Curvature on the same nodes."""
        return self.fit.profile

    @property
    def sensed_noise(self) -> float:
        """Noise of a coordinate as sensed; that of the fit is less where points are filtered in time [m]."""
        return self.route.noise * self.tracked.sensed_over_fitted

    def strip(self) -> FrameResult:
        """Return it without what only the fit of the next frame needs, which is most of its size."""
        of = self.tracked
        kept = TrackedFit(of.fit.strip(), of.index, sensed_over_fitted=of.sensed_over_fitted)
        fit = kept.fit if self.fit is of.fit else self.fit.strip()
        return replace(self, fit=fit, tracked=kept, commander=None)


@dataclass(frozen=True, slots=True)
class Rejected:
    """A frame that could not be used; the tendon's state is as before it."""

    seq: int
    time: float
    reason: str
    id: str | int = ""


def process(
    frames: Iterable[Frame | Rejected],
    rig: Rig,
    *,
    tension_in: float,
    state: TendonState | None = None,
    commander: Commander | None = None,
) -> Iterator[FrameResult | Rejected]:
    """Turn frames into results, one for each frame and in their order; each fit starts from the last one.

    A frame's `tension_in` drives the tendon, or else its `displacement_in`. Where it brings neither, a target
    is taken as reached, and without a target the proximal tension is `tension_in`.

    Parameters
    ----------
    frames
        Sensed shapes, read one at a time; what the reader rejected passes through.
    rig
        Tendon, friction and sensors.
    tension_in
        Total tension at the proximal end for frames that bring no drive and no target [N].
    state
        Tension along the tendon before the first frame; the rig's pretension by default.
    commander
        Tolerance, policy and errors of the rig for frames with a target; by default the rig's numbers count
        as exact, and the dead zone is crossed at once.

    Examples
    --------
    >>> import numpy as np
    >>> from tssgeom import Frame, Rig, process
    >>> angle = np.linspace(0.0, np.pi, 40)  # a half circle of 0.5 m
    >>> points = 0.5 / np.pi * np.column_stack((np.sin(angle), 1 - np.cos(angle), 0 * angle))
    >>> frames = (Frame(points, time=t, tension_in=pull) for t, pull in enumerate([5.0, 15.0, 10.0]))
    >>> [round(float(each.transmission.tension_out), 2) for each in process(frames, Rig(), tension_in=15.0)]
    [3.17, 9.51, 9.51]
    """
    yield from _carried(((frame, None) for frame in frames), rig, tension_in, state, commander)


def recorded(
    frames: Iterable[Frame | Rejected], rig: Rig, *, tension_in: float, state: TendonState | None = None
) -> Iterator[FrameResult | Rejected]:
    """Do as `process` on frames that are recorded: the points of each are filtered also by those after it.

    Some hundred frames are read before the first result, and smoothed in windows that overlap; docs/model.md
    (162).
    """
    yield from _carried(smoothed_in_windows(frames, rig), rig, tension_in, state)


def _carried(
    frames: Iterable[tuple[Frame | Rejected, PointFilter | None]],
    rig: Rig,
    tension_in: float,
    state: TendonState | None,
    commander: Commander | None = None,
) -> Iterator[FrameResult | Rejected]:
    """Carry the tendon over frames, each with the filter of its points where that is known already."""
    current = pretensioned(rig) if state is None else state
    last: TrackedFit | None = None
    watch = FrameWatch()
    for seq, (frame, points) in enumerate(frames):
        if isinstance(frame, Rejected):
            yield replace(frame, seq=seq)
            continue
        try:
            result = advance(seq, frame, current, rig, tension_in, last, points, commander)
        except _FAULTS as error:
            yield Rejected(seq, frame.time, _reason(error), frame.id)
        else:
            commander = result.commander
            yield _watched(result, watch)
            # the result is out: the check of its model delays no frame that has arrived
            current, last = result.state, model_checked(result.tracked)


def _watched(result: FrameResult, watch: FrameWatch) -> FrameResult:
    """Return a result with the rules that its frame breaks beside those before it."""
    warnings = watch.take(result.frame)
    return replace(result, warnings=result.warnings + warnings) if warnings else result


def _reason(fault: Exception) -> str:
    """Say why a frame has no result."""
    if isinstance(fault, TssgeomError):
        return str(fault)
    return f"the points cannot be computed with ({fault}): look for points that coincide or run back"


def advance(
    seq: int,
    frame: Frame,
    state: TendonState,
    rig: Rig,
    tension_in: float,
    last: TrackedFit | None = None,
    points: PointFilter | None = None,
    commander: Commander | None = None,
) -> FrameResult:
    """Carry the tendon from `state` over one frame, its geometry from that of the `last` one.

    Its points are filtered in time by those before it, unless `points` has them filtered already.

    Raises
    ------
    ShapeError
        Where the points cannot be a route.
    SettingsError
        Where the tension is negative or not finite, or a target out of reach.
    FitError
        Where the points give no finite curve, or the tendon no equilibrium.
    """
    shape, tracked = fit_frame(frame, rig, last, points)
    sensed = SensedRoute(shape, tracked, *with_shared_errors_of(frame, rig, tracked))
    return pulled(seq, frame, state, rig, tension_in, sensed, commander)


class SensedRoute(NamedTuple):
    """The route of a frame, as a tendon needs it."""

    shape: Shape
    tracked: TrackedFit
    fit: RouteFit
    """The fit at its resolution."""
    shared: SharedErrors
    """Errors beside its own, which other frames have too."""


def pulled(
    seq: int,
    frame: Frame,
    state: TendonState,
    rig: Rig,
    tension_in: float,
    sensed: SensedRoute,
    commander: Commander | None = None,
) -> FrameResult:
    """Do as `advance` does, on a route that is fitted already.

    Raises
    ------
    SettingsError
        Where the tension is negative or not finite, or a target out of reach.
    FitError
        Where the tendon has no equilibrium.
    """
    shape, tracked, fit, shared = sensed
    known = tracked.filtered
    stands = None if known is None or known.interval == 0.0 else known.standing > _STANDS
    at = Step(fit.arcs, frame.time, frame.temperature, stands, shared)
    given = Given(
        frame.tension_in, frame.displacement_in, frame.displacement_target, frame.tension_out_target
    )
    moved, command, commander = (commander or commander_of(rig)).moved(state, at, given, tension_in)
    most = moved.tension_in if command is None else max(moved.tension_in, command.tension_in)
    moved, transmission = _transmitted(state, moved, rig, stands, shared)
    return FrameResult(
        seq=seq,
        frame=frame,
        shape=shape,
        fit=shared.beside(fit),
        tracked=tracked,
        state=moved,
        transmission=transmission,
        warnings=shape.warnings
        + fit.warnings
        + _temperature_warnings(rig, frame)
        + _implausible(frame, rig, fit.arcs.total_length, most),
        command=command,
        commander=commander,
    )


def _temperature_warnings(rig: Rig, frame: Frame) -> tuple[str, ...]:
    """Name the effects that do nothing in a frame because its temperature is unknown."""
    if frame.temperature is not None or not rig.effects:
        return ()
    idle = named(effect for effect in rig.effects if "temperature_C" in effect.needs)
    return (f"no temperature_C: {idle} does nothing",) if idle else ()


def _implausible(frame: Frame, rig: Rig, length: float, tension: float) -> tuple[str, ...]:
    """Return the rules that a frame breaks by itself, on a route of this length [m] at this tension [N]."""
    remarks = [*strain_remarks(rig, length, tension), *frame_remarks(frame, length)]
    return tuple(each.text for each in remarks)


def _transmitted(
    before: TendonState, now: TendonState, rig: Rig, stands: bool | None, shared: SharedErrors
) -> tuple[TendonState, Transmission]:
    """Return what the tendon transmits, with errors that all frames share: by those no route has moved."""
    route = now.route
    if route is None or shared == NO_ERRORS:
        return transmit_after(before, now, rig, stands)
    moved, transmission = transmit_after(before, replace(now, route=shared.on(route)), rig, stands)
    return replace(moved, route=route), transmission


def alone(
    frames: Iterable[Frame | Rejected], rig: Rig, *, tension_in: float, first: int = 0
) -> Iterator[FrameResult | Rejected]:
    """Turn frames into results as if each were the first pull of its tendon; only the fit goes on.

    The points of each are filtered by those of the frames before and after it; docs/model.md (162).

    Parameters
    ----------
    frames
        Sensed shapes, in order, all of which are read before the first result.
    rig
        Tendon, friction and sensors.
    tension_in
        Total tension at the proximal end for frames that bring no drive and no target [N].
    first
        Count of the first of these frames in its recording.
    """
    rest = pretensioned(rig)
    last: TrackedFit | None = None
    frames = list(frames)
    points, watch = smoothed_in_time(frames, rig), FrameWatch()
    for seq, frame in enumerate(frames, first):
        if isinstance(frame, Rejected):
            yield replace(frame, seq=seq)
            continue
        try:
            result = advance(seq, frame, rest, rig, tension_in, last, points.get(seq - first))
        except _FAULTS as error:
            yield Rejected(seq, frame.time, _reason(error), frame.id)
        else:
            last = result.tracked
            yield _watched(result, watch)
