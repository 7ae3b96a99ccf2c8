"""The recording of `track`: the images of each camera, the markers in space, and their noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, sqrt
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from tssgeom.arrays import Points, Vector
from tssgeom.view import colours
from tssgeom.view.quantities import ANGLE, TENSION_OUT
from tssgeom.view.scene.blueprint import BACKGROUND, layout, plot, space_view, time_panel
from tssgeom.view.scene.charts import Sender
from tssgeom.view.scene.labels import Camera, camera
from tssgeom.view.scene.space import send_scale_bar
from tssgeom.view.scene.writer import recording_file

_NAMED = 40  # markers: with more, their numbers would hide one another
_NUMBER = 0.06  # of the height of the view: Rerun writes the number of a marker so far below it; measured


@dataclass(frozen=True, slots=True)
class Tracked:
    """Markers of a film over time, as their recording shows them."""

    name: str
    time: Vector
    """[f] [s]."""
    points: np.ndarray
    """[f, n, 3] NaN where the position of a marker is unknown [m]."""
    ids: Sequence[int]
    """[n]."""
    noise: Vector
    """[f] Standard deviation of a coordinate across the route, NaN where it is unknown [m]."""
    summary: str
    """Description of the result, as markdown."""
    images: Mapping[str, Sequence[tuple[float, bytes]]]
    """For each camera times [s] and JPEG files."""


def write_track_recording(path: Path, tracked: Tracked) -> None:
    """Write the recording; an older file gives way only when it is done.

    Raises SourceError where the file cannot be written.
    """
    known = tracked.points[~np.isnan(tracked.points).any(axis=2)]
    view = _with_numbers(camera(known, _forward(tracked.points)))
    views, application = _blueprint(tracked, view), f"tssgeom track: {tracked.name}"
    with recording_file(path, tracked.name, views, application=application) as recording:
        sender = Sender(recording, tracked.time)
        send_scale_bar(sender, view)
        _send_markers(sender, tracked)
        _send_numbers(sender, tracked)
        sender.constant_text("summary", tracked.summary)
        for name, images in tracked.images.items():
            _send_images(recording, name, images)


def _with_numbers(view: Camera) -> Camera:
    """Return a view with room for the numbers of the markers below the lowest of them."""
    room = 0.5 * _NUMBER * view.view_height
    return replace(view, target=view.target - room * view.up, half_height=view.half_height + room)


def _forward(points: np.ndarray) -> Vector:
    """Return the mean vector from the first to the last known marker of a frame [m]."""
    vectors = [frame[known][-1] - frame[known][0] for frame in points if (known := _known(frame)).sum() > 1]
    return np.mean(vectors, axis=0) if vectors else np.array([1.0, 0.0, 0.0])


def _known(frame: Points) -> np.ndarray:
    return np.asarray(~np.isnan(frame).any(axis=1))


def _send_markers(sender: Sender, tracked: Tracked) -> None:
    """Draw the markers of each frame, with a line through neighbours and the number of each."""
    clouds = [frame[_known(frame)] for frame in tracked.points]
    counts = [len(cloud) for cloud in clouds]
    named = len(tracked.ids) <= _NAMED
    style = rr.Points3D.from_fields(colors=colours.SENSED, radii=rr.Radius.ui_points(4.5), show_labels=named)
    sender.constant("sensed", style)
    numbers = np.array([str(number) for number in tracked.ids])
    labels = np.concatenate([numbers[_known(frame)] for frame in tracked.points]).tolist()
    columns = rr.Points3D.columns(positions=np.concatenate(clouds), labels=labels)
    sender.send("sensed", columns, counts)
    sender.constant("route", rr.LineStrips3D.from_fields(colors=colours.AXIS, radii=rr.Radius.ui_points(1.5)))
    sender.send("route", rr.LineStrips3D.columns(strips=clouds))


def _send_numbers(sender: Sender, tracked: Tracked) -> None:
    share = 100 * np.array([_known(frame).mean() for frame in tracked.points])
    for entity, name, colour, values in (
        ("seen", "markers located [%]", TENSION_OUT.rgb, share),
        ("noise", "noise [mm]", ANGLE.rgb, 1e3 * tracked.noise),
    ):
        sender.line(f"series/{entity}", name, colour, values)


def _send_images(recording: rr.RecordingStream, name: str, images: Sequence[tuple[float, bytes]]) -> None:
    sender = Sender(recording, np.array([time for time, _ in images]))
    blobs = [np.frombuffer(content, np.uint8) for _, content in images]
    sender.constant(f"camera/{name}", rr.EncodedImage.from_fields(media_type="image/jpeg"))
    sender.send(f"camera/{name}", rr.EncodedImage.columns(blob=blobs))


def _blueprint(tracked: Tracked, view: Camera) -> rrb.Blueprint:
    cameras = rrb.Grid(
        *(
            rrb.Spatial2DView(
                origin=f"camera/{name}", name=f"{name}: detected markers", background=BACKGROUND
            )
            for name in tracked.images
        ),
        grid_columns=ceil(sqrt(len(tracked.images))),
    )
    noise = float(np.nanmax(1e3 * tracked.noise, initial=0.0))
    title = f"{tracked.name}: markers along the sheath, numbered from proximal to distal"
    space = space_view(title, view, ("sensed", "route", "scale"))
    below = rrb.Horizontal(
        rrb.TextDocumentView(origin="summary", name="Summary"),
        plot("Markers located [%] against time [s]", ["series/seen"], top=100.0),
        plot("Noise of a coordinate [mm] against time [s]", ["series/noise"], top=noise or None),
        column_shares=[40, 30, 30],
    )
    above = rrb.Horizontal(space, cameras, column_shares=[45, 55])
    return layout(rrb.Vertical(above, below, row_shares=[66, 34]), time_panel())
