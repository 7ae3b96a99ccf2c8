"""One engine for live, replay, batch and control loops: frames in, results out, in order."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from threading import Condition
from typing import TYPE_CHECKING, TypeVar

from tssgeom.errors import TssgeomError
from tssgeom.frame import Frame
from tssgeom.plausibility.frames import FrameWatch
from tssgeom.rig import Rig
from tssgeom.route.time_filter import PointFilter
from tssgeom.route.tracking import NotWarmError, TrackedFit, model_checked
from tssgeom.sensed_route import SensedRoute, sensed_route
from tssgeom.smoothed_frames import along_the_route, smoothed_at_once, smoothed_in_windows
from tssgeom.stream import Carried, FrameResult, Rejected, at_rest, held, pulled
from tssgeom.tendon.commander import Commander
from tssgeom.tendon.state import TendonState

if TYPE_CHECKING:
    from tssgeom.adapt.follower import Follower

_Result = TypeVar("_Result")
_FAULTS = (TssgeomError, ArithmeticError)  # of one frame: the next may be sound


@dataclass(slots=True)
class Track:
    """What goes on from frame to frame of one sender: its fits, its filters, and its rules."""

    last: TrackedFit | None = None
    """The fit from which that of the next frame starts; None before the first."""
    watch: FrameWatch = field(default_factory=FrameWatch)
    """The rules on frames beside those before them."""

    @property
    def is_due(self) -> bool:
        """Whether a step of the model check is due."""
        return self.last is not None and self.last.due

    def check_model(self) -> None:
        """Make the step of the model check that is due after a frame."""
        if self.last is not None and self.last.due:
            self.last = model_checked(self.last)


class Engine:
    """A tendon that is carried from frame to frame, for programs that have one frame at a time.

    Threads may share it: frames are taken in the order of the calls, and a call waits for those before it.

    Parameters
    ----------
    rig
        Tendon, friction and sensors.
    tension_in
        Total tension at the proximal end for frames that bring no drive and no target, until one does [N].
    state
        Tension along the tendon before the first frame, or where a machine stands; at rest by default.
    commander
        Tolerance, policy and errors of the rig for frames with a target; by default the rig's numbers count
        as exact, and the dead zone is crossed at once.
    follower
        Follows the rig by what the frames measure, which need increasing times: tendon, rig and commands are
        then the follower's. It belongs to one engine alone.

    Notes
    -----
    `push` raises no error for a bad frame: it returns a `Rejected`, and the tendon stays as it was. Whether
    other joints or a spline are likelier than the route that is tracked is checked in small steps, one after
    a frame; `idle` makes the step while the loop waits, else the next `push` makes it; docs/model.md (34).

    Examples
    --------
    >>> import numpy as np
    >>> from tssgeom import Engine, Frame, Rig
    >>> angle = np.linspace(0.0, np.pi, 40)  # a half circle of 0.5 m
    >>> points = 0.5 / np.pi * np.column_stack((np.sin(angle), 1 - np.cos(angle), 0 * angle))
    >>> engine = Engine(Rig(), tension_in=15.0)
    >>> result = engine.push(Frame(points, time=0.0, displacement_target=0.002))
    >>> round(1e3 * result.displacement_command, 2)  # position of the drive [mm]
    2.4
    >>> engine.idle()
    >>> engine.push(Frame(points[:2], time=0.01)).reason[:17]
    '2 distinct points'
    >>> engine.state is result.state
    True
    """

    def __init__(
        self,
        rig: Rig,
        *,
        tension_in: float,
        state: Carried | None = None,
        commander: Commander | None = None,
        follower: Follower | None = None,
    ) -> None:
        self._rig, self._tension_in = rig, tension_in
        self._state: Carried = at_rest(rig) if state is None else state
        self._commander, self._follower = commander, follower
        self._track = Track()
        self._count = 0
        self._was_driven = False
        self._calls = deque[object]()
        self._call_ended = Condition()

    @property
    def state(self) -> Carried:
        """The tendon, or the machine, after the last good frame."""
        return self._state

    def push(
        self,
        frame: Frame | Rejected,
        *,
        filtered: PointFilter | None = None,
        track: Track | None = None,
        sensed: SensedRoute | None = None,
    ) -> FrameResult | Rejected:
        """Carry the tendon over one frame; a `Rejected` passes through, with its count.

        Parameters
        ----------
        frame
            A sensed shape. Its `tension_in` drives the tendon, or else its `displacement_in`. Where it brings
            neither, a target is taken as reached, and without a target the proximal tension is `tension_in`,
            or, after frames that drove the tendon, what it was.
        filtered
            Its points, where they are filtered in time already; the engine filters them otherwise.
        track
            What its sender has sent before, where there are many senders: they share the tendon, but neither
            fits nor filters.
        sensed
            Its route, where `sense` has fitted it already.
        """
        with self._turn():
            seq, self._count = self._count, self._count + 1
            if isinstance(frame, Rejected):
                return replace(frame, seq=seq)
            track = track or self._track
            if sensed is None:
                track.check_model()
                fitted = _attempt(seq, frame, sensed_route, frame, self._rig, track.last, filtered)
            else:
                fitted = sensed
            tension_in, is_driven = self._tension_in, frame.drives_tendon
            if self._was_driven and not is_driven and isinstance(self._state, TendonState):
                frame, tension_in = held(frame, self._state)
            before, more = (self._state, self._rig, tension_in), (self._commander, self._follower)
            result = _pulled(seq, frame, *before, fitted, *more)
            if isinstance(result, Rejected):
                return result
            self._state, track.last, self._commander = result.carried, result.tracked, result.commander
            self._was_driven |= is_driven
            return _watched(result, track.watch, self._rig)

    def sense(self, frame: Frame, track: Track) -> SensedRoute | Rejected:
        """Fit the route of a frame, for a later `push`: the tendon waits for no fit that takes long.

        A track may be in one call at a time; calls with different tracks may run side by side.
        """
        track.check_model()
        return _attempt(0, frame, sensed_route, frame, self._rig, track.last)

    def sense_warm(self, frame: Frame, track: Track) -> SensedRoute | Rejected | None:
        """Do as `sense` where the fit goes on from the last frame; None where it would begin from nothing."""
        track.check_model()
        if track.last is None:
            return None
        with suppress(NotWarmError):
            return _attempt(0, frame, sensed_route, frame, self._rig, replace(track.last, warm_only=True))
        return None

    def idle(self, track: Track | None = None) -> None:
        """Make the step of the model check that follows a frame, so that the next `push` need not.

        A follower does a slice of the work that explains an alert.
        """
        with self._turn():
            (track or self._track).check_model()
            if self._follower is not None:
                self._follower.work()

    @contextmanager
    def _turn(self) -> Iterator[None]:
        """Wait until all calls that began before have ended: a lock by itself keeps no order."""
        call = object()
        with self._call_ended:
            self._calls.append(call)
        try:
            with self._call_ended:
                self._call_ended.wait_for(lambda: self._calls[0] is call)
            yield
        finally:
            with self._call_ended:
                self._calls.remove(call)
                self._call_ended.notify_all()


def process(
    frames: Iterable[Frame | Rejected],
    rig: Rig,
    *,
    tension_in: float,
    state: Carried | None = None,
    commander: Commander | None = None,
    follower: Follower | None = None,
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
    commander, follower
        As of `Engine`.

    Yields
    ------
    FrameResult | Rejected
        Route, tension and elongation of a frame, or why it could not be used.

    Raises
    ------
    SettingsError
        Where the tension is negative or not finite.

    Notes
    -----
    Source: docs/model.md, from sensed points to the tendon.

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
    engine = Engine(rig, tension_in=tension_in, state=state, commander=commander, follower=follower)
    yield from _carried(((frame, None) for frame in frames), engine)


def recorded(
    frames: Iterable[Frame | Rejected], rig: Rig, *, tension_in: float, commander: Commander | None = None
) -> Iterator[FrameResult | Rejected]:
    """Do as `process`, some hundred frames at a time, in windows that overlap; docs/model.md (162)."""
    engine = Engine(rig, tension_in=tension_in, commander=commander)
    yield from _carried(smoothed_in_windows(frames, rig), engine)


def _carried(
    frames: Iterable[tuple[Frame | Rejected, PointFilter | None]], engine: Engine
) -> Iterator[FrameResult | Rejected]:
    """Push frames, each with the filter of its points where that is known already."""
    for frame, filtered in frames:
        yield engine.push(frame, filtered=filtered)
        engine.idle()  # the result is out: the check of its model delays no frame that has arrived


def _pulled(
    seq: int,
    frame: Frame,
    state: Carried,
    rig: Rig,
    tension_in: float,
    sensed: SensedRoute | Rejected,
    commander: Commander | None = None,
    follower: Follower | None = None,
) -> FrameResult | Rejected:
    """Do as `stream.pulled`, but return what cannot be used as rejected."""
    if isinstance(sensed, Rejected):
        return sensed
    if follower is not None:
        follower.catch_up()
    return _attempt(seq, frame, pulled, seq, frame, state, rig, tension_in, sensed, commander, follower)


def _attempt(seq: int, frame: Frame, call: Callable[..., _Result], *arguments: object) -> _Result | Rejected:
    """Call what uses a frame; where it cannot, return the frame as rejected."""
    try:
        return call(*arguments)
    except _FAULTS as error:
        return Rejected(seq, frame.time, _reason(error), frame.id)


def _watched(result: FrameResult, watch: FrameWatch, rig: Rig) -> FrameResult:
    """Return a result with the rules that its frame breaks beside those before it."""
    warnings = watch.take(result.frame, in_order=rig.shape.order == "given")
    return replace(result, warnings=result.warnings + warnings) if warnings else result


def _reason(fault: Exception) -> str:
    """Say why a frame has no result."""
    if isinstance(fault, TssgeomError):
        return str(fault)
    return f"the points cannot be computed with ({fault}): check for points that coincide or run back"


def alone(
    frames: Iterable[Frame | Rejected],
    rig: Rig,
    *,
    tension_in: float,
    first: int = 0,
    commander: Commander | None = None,
) -> Iterator[FrameResult | Rejected]:
    """Turn frames into results as if each were the first pull of its tendon; only the fit goes on; (162).

    Parameters
    ----------
    frames
        Sensed shapes, in order, all of which are read before the first result.
    rig, commander
        Tendon, friction and sensors, and the tendon as it may be where these have errors.
    tension_in
        Total tension at the proximal end for frames that bring no drive and no target [N].
    first
        Count of the first of these frames in its recording.
    """
    rest = at_rest(rig)
    last: TrackedFit | None = None
    watch, every = FrameWatch(), smoothed_at_once(list(along_the_route(frames, rig)), rig)
    for seq, (frame, points) in enumerate(every, first):
        if isinstance(frame, Rejected):
            yield replace(frame, seq=seq)
            continue
        sensed = _attempt(seq, frame, sensed_route, frame, rig, last, points)
        result = _pulled(seq, frame, rest, rig, tension_in, sensed, commander)
        if isinstance(result, FrameResult):
            last, result = result.tracked, _watched(result, watch, rig)
        yield result
