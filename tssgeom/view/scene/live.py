"""A picture that grows while frames come in: the same views as of a recorded run, sent batch by batch.

With a followed rig it has the numbers with their bands, and the alerts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from tssgeom.adapt.alert import Alert
from tssgeom.arrays import Matrix, Points, Vector
from tssgeom.engine import process
from tssgeom.rig import Rig
from tssgeom.statistics import NORMAL_95
from tssgeom.stream import Frame, FrameResult
from tssgeom.view import colours
from tssgeom.view.quantities import TIMELINE
from tssgeom.view.samples import Ranges, RouteSamples, numbers_of, ranges, round_up, route_samples
from tssgeom.view.scene.blueprint import blueprint
from tssgeom.view.scene.charts import Sender
from tssgeom.view.scene.labels import ASPECT, Camera, camera
from tssgeom.view.scene.recording import send_pictures
from tssgeom.view.scene.run import Run, send_numbers
from tssgeom.view.scene.writer import send_layout

if TYPE_CHECKING:
    import trimesh

_HEADROOM = 1.25  # of axes and of the camera's view, for frames to come
_NODE_STEP, _MOST_POINTS = 8, 4096  # of the routes that the camera shows; chosen: it takes a millisecond


def warm_up() -> None:
    """Draw once without a file: the first picture of a process takes long."""
    angle = np.linspace(0.0, 2.0, 40)
    points = 0.1 * np.column_stack((np.sin(angle), 1 - np.cos(angle), 0.1 * angle))
    frames = [Frame(points, float(i), tension_in=5.0 + i) for i in range(2)]
    results = [one for one in process(frames, Rig(), tension_in=5.0) if isinstance(one, FrameResult)]
    with rr.RecordingStream("warm up") as recording:
        discarded = recording.binary_stream()
        picture = LivePicture(recording, "warm up")
        picture.draw(results)
        picture.number(np.array([0.0, 1.0]), np.array([numbers_of(one) for one in results]))
        discarded.read()


@dataclass(slots=True)
class LivePicture:
    """The picture of a stream of frames, in one Rerun recording."""

    recording: rr.RecordingStream
    name: str
    lumen: trimesh.Trimesh | None = None
    _camera: Camera | None = field(default=None)
    _ranges: Ranges | None = field(default=None)
    _extent: Points = field(default_factory=lambda: np.empty((0, 3)))
    """Points of the frames at which the camera was pointed [m]; it shows all of them."""
    _followed: tuple[str, ...] = ()
    """Numbers of the rig that are followed."""
    _alert: str = ""
    """The last alert in words."""

    def __post_init__(self) -> None:
        self.recording.set_log_time_enabled(False)  # one time for all: that of the frames

    def draw(self, results: Sequence[FrameResult]) -> None:
        """Draw frames, one row each; axes and camera grow where a frame exceeds them."""
        frames = [route_samples(result) for result in results]
        grown = self._grown(results, frames)
        assert self._camera is not None
        assert self._ranges is not None
        run = Run(self.name, results, frames, self._ranges, self._camera, timed=True)
        times = np.array([result.frame.time for result in results])
        sender = Sender(self.recording, times, since=float(times[0]), repeats=grown)
        send_pictures(sender, run, self.lumen if grown else None)
        send_followed(sender, results)
        self._log_alerts(results)

    def number(self, times: Vector, numbers: Matrix) -> None:
        """Draw the `samples.numbers_of` frames at their times [s] as lines."""
        send_numbers(Sender(self.recording, times), numbers)

    def _log_alerts(self, results: Sequence[FrameResult]) -> None:
        """Log each alert when it begins and when another mechanism is the likeliest."""
        for result in results:
            text = "" if result.alert is None else result.alert.sentence
            if result.alert is not None and text != self._alert:
                self.recording.set_time(TIMELINE, duration=result.frame.time)
                send_alert(self.recording, result.alert)
            self._alert = text

    def _grown(self, results: Sequence[FrameResult], frames: Sequence[RouteSamples]) -> bool:
        """Make axes and camera hold these frames; return whether any of them changed."""
        needed = ranges(frames, [result.arcs for result in results])
        wider = self._ranges is None or not _holds(self._ranges, needed)
        if wider:
            self._ranges = _widened(needed, self._ranges)
        keys, self._followed = self._followed, keys_of(results) or self._followed
        moved = self._camera is None or not _shows(self._camera, frames) or keys != self._followed
        if moved:
            self._point_camera(frames)
        return wider or moved

    def _point_camera(self, frames: Sequence[RouteSamples]) -> None:
        new = np.concatenate([frame.position[::_NODE_STEP] for frame in frames])
        self._extent = np.concatenate([self._extent, new])[-_MOST_POINTS:]
        forward = frames[-1].position[-1] - frames[-1].position[0]
        self._camera = camera(self._extent, forward)
        more = followed_views(self._followed) if self._followed else None
        layout = blueprint(self.name, self._camera, timed=True, live=True, more=more)
        send_layout(self.recording, layout)


def _holds(current: Ranges, needed: Ranges) -> bool:
    return (
        current.tension >= needed.tension
        and current.length >= needed.length
        and current.kappa >= needed.kappa
    )


def _widened(needed: Ranges, before: Ranges | None) -> Ranges:
    least = needed if before is None else before
    return Ranges(
        tension=max(round_up(_HEADROOM * needed.tension), least.tension),
        length=max(_HEADROOM * needed.length if before else needed.length, least.length),
        kappa=max(round_up(_HEADROOM * needed.kappa), least.kappa),
    )


def _shows(view: Camera, frames: Sequence[RouteSamples]) -> bool:
    """Whether the ends and the middle of all frames are inside the view, off its edges."""
    points = np.concatenate([frame.position[[0, -1, len(frame.s) // 2]] for frame in frames])
    across, up = np.abs((points - view.target) @ view.axes[:2].T).T
    reach = _HEADROOM * max(view.half_height, view.half_width / ASPECT)
    return bool((up <= reach).all() and (across <= ASPECT * reach).all())


_ALERTS = "alerts"


def keys_of(results: Sequence[FrameResult]) -> tuple[str, ...]:
    """Return the numbers that all frames follow."""
    keys = {() if one.followed is None else one.followed.keys for one in results}
    return keys.pop() if len(keys) == 1 else ()


def send_followed(sender: Sender, results: Sequence[FrameResult]) -> None:
    """Send each followed number and both ends of its 95 % band as lines."""
    known = [one.followed for one in results if one.followed is not None]
    if not (keys := keys_of(results)):
        return
    values, errors = (np.array([getattr(one, name) for one in known]) for name in ("values", "se"))
    for i, key in enumerate(keys):
        value, reach = values[:, i], NORMAL_95 * errors[:, i]
        for name, line, width in (
            (key, value, 2.0),
            ("upper", value + reach, 1.0),
            ("lower", value - reach, 1.0),
        ):
            title = name if name == key else f"{name} end of the 95 % band"
            entity = f"followed/{key}/{'value' if name == key else name}"
            sender.line(entity, title, colours.MEASURED, line, width)


def send_alert(recording: rr.RecordingStream, alert: Alert) -> None:
    """Send an alert as a line of the log, at the recording's time."""
    recording.log(_ALERTS, rr.TextLog(alert.sentence, level=rr.TextLogLevel.WARN), strict=True)


def followed_views(keys: Sequence[str]) -> rrb.Container:
    """Return the views of followed numbers and of alerts."""
    plots = [
        rrb.TimeSeriesView(
            name=f"{key}, with its 95 % band, against time [s]",
            contents=[f"followed/{key}/**"],
            plot_legend=rrb.PlotLegend(visible=False),
        )
        for key in keys
    ]
    return rrb.Vertical(*plots, rrb.TextLogView(origin=_ALERTS, name="Alerts"), name="Followed rig")
