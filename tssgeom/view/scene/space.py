"""The three-dimensional view of a recording: route, sensed points, pieces, labels, lumen and clearance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from tssgeom.arrays import Points
from tssgeom.lumen.clearance import Clearance
from tssgeom.route.pieces import Arcs
from tssgeom.view import colours
from tssgeom.view import wording as words
from tssgeom.view.samples import RouteSamples, outliers
from tssgeom.view.scene.charts import Sender, segments_3d
from tssgeom.view.scene.labels import (
    Camera,
    LabelPositions,
    label_positions,
    labelled,
    scale_label,
    time_position,
)
from tssgeom.view.scene.run import Run, send_numbers_of_route

if TYPE_CHECKING:
    import trimesh

_FEW_POINTS = 40
"""Up to this number sensed points are drawn larger, as each of them is a marker."""

_NAMED = 64
"""Least number of pieces with a name and a colour. Chosen: later frames of a stream seldom have more."""


def send_space(sender: Sender, run: Run, lumen: trimesh.Trimesh | None) -> None:
    """Send everything in the three-dimensional view; the lumen only where there is one."""
    pieces = [result.arcs for result in run.results]
    send_piece_names(sender, pieces)
    send_scale_bar(sender, run.camera)
    if run.timed:
        _send_time(sender, run)
    if lumen is not None:
        _send_lumen(sender, run, lumen)
    send_route(sender, run.frames, run.ranges.tension)
    _send_sensed(sender, run)
    send_joints(sender, run.frames, pieces)
    located = [
        label_positions(run.camera, frame, arcs) for frame, arcs in zip(run.frames, pieces, strict=True)
    ]
    ends = [result.transmission for result in run.results]
    texts = [
        label_texts(end.tension_in, end.tension_out, arcs) for end, arcs in zip(ends, pieces, strict=True)
    ]
    send_labels(sender, located, texts)
    send_numbers_of_route(sender, run)


def send_piece_names(sender: Sender, pieces: Sequence[Arcs]) -> None:
    """Give every piece its name and colour; they hold for the whole recording."""
    if not sender.repeats:
        return
    most = max(_NAMED, *(len(arcs.length) for arcs in pieces))
    names = [(number, f"piece {number + 1}", colours.piece_rgb(number)) for number in range(most)]
    sender.always("/", rr.AnnotationContext(names))


def send_scale_bar(sender: Sender, camera: Camera, text_scale: float = 1.0) -> None:
    """Draw a bar of a round length below the route, with its length, and the directions of x, y and z."""
    if not sender.repeats:
        return
    axes, letters = camera.triad(camera.room_below)
    lines = rr.LineStrips3D(list(axes), colors=[colours.AXIS], radii=rr.Radius.ui_points(1.5))
    sender.always("scale/axes", lines)
    anchor = camera.label_anchor(letters, np.zeros(2), text_scale)
    names = rr.Points3D(anchor, radii=0.0, labels=["x", "y", "z"], colors=[colours.SENSED], show_labels=True)
    sender.always("scale/axes/letters", names)
    bar, text, anchor = scale_label(camera, text_scale)
    sender.always("scale", rr.LineStrips3D([bar], colors=[colours.AXIS], radii=rr.Radius.ui_points(1.5)))
    label = rr.Points3D(anchor, radii=0.0, labels=[text], colors=[colours.WHITE], show_labels=True)
    sender.always("scale/length", label)


def _send_time(sender: Sender, run: Run) -> None:
    """Write the time of each frame below the route."""
    anchor = run.camera.label_anchor(time_position(run.camera), np.zeros(2))
    style = rr.Points3D.from_fields(positions=anchor, radii=0.0, colors=colours.WHITE, show_labels=True)
    sender.always("scale/time", style)
    labels = [f"t = {result.frame.time:.2f} s" for result in run.results]
    sender.send("scale/time", rr.Points3D.columns(labels=labels))


def _send_lumen(sender: Sender, run: Run, lumen: trimesh.Trimesh) -> None:
    """Draw the inner side of the wall only, so that the near wall does not hide the route."""
    outward = _outward(lumen, run.frames[-1].position)
    wall = rr.Mesh3D(
        vertex_positions=outward.vertices.astype(np.float32),
        triangle_indices=outward.faces.astype(np.uint32),
        vertex_normals=-outward.vertex_normals.astype(np.float32),
        albedo_factor=colours.LUMEN,
        face_rendering="Back",
    )
    sender.constant("lumen", wall)


def _outward(lumen: trimesh.Trimesh, route: Points) -> trimesh.Trimesh:
    """Turn the faces of a wall away from the route inside it."""
    import trimesh
    from scipy.spatial import KDTree

    corners = lumen.vertices[lumen.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    centre = corners.mean(axis=1)
    _, nearest = KDTree(route).query(centre)
    away = np.sum(normal * (centre - route[nearest])) >= 0
    return trimesh.Trimesh(lumen.vertices, lumen.faces if away else lumen.faces[:, ::-1], process=False)


def send_route(sender: Sender, frames: Sequence[RouteSamples], top: float) -> None:
    """Draw routes in the colours of their tension, the brightest for `top` [N]."""
    middles = np.concatenate([0.5 * (frame.tension[:-1] + frame.tension[1:]) for frame in frames])
    columns = rr.LineStrips3D.columns(
        strips=segments_3d([frame.position for frame in frames]), colors=colours.tension_rgba32(middles, top)
    )
    sender.constant("route", rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points(3.5)))
    sender.send("route", columns, [len(frame.s) - 1 for frame in frames])


def _send_sensed(sender: Sender, run: Run) -> None:
    """Draw the sensed points small, and once more in red where the route does not follow them."""
    sensed = [result.frame.points for result in run.results]
    points = [cloud[~np.isnan(cloud).any(axis=1)] for cloud in sensed]
    few = max(len(cloud) for cloud in points) <= _FEW_POINTS
    _send_points(sender, "sensed", points, colours.SENSED, 4.5 if few else 1.8)
    beside = [outliers(result) for result in run.results]
    _send_points(sender, "sensed/outliers", beside, colours.OUTLIER, 5.5)


def _send_points(
    sender: Sender, entity: str, clouds: Sequence[Points], colour: tuple[int, int, int], radius: float
) -> None:
    style = rr.Points3D.from_fields(colors=colour, radii=rr.Radius.ui_points(radius))
    sender.constant(entity, style)
    columns = rr.Points3D.columns(positions=np.concatenate(clouds))
    sender.send(entity, columns, [len(cloud) for cloud in clouds])


def send_joints(sender: Sender, frames: Sequence[RouteSamples], pieces: Sequence[Arcs]) -> None:
    """Mark where each piece begins, in the colour of the piece."""
    counts = [len(arcs.length) for arcs in pieces]
    pairs = zip(frames, pieces, strict=True)
    columns = rr.Points3D.columns(
        positions=np.concatenate([frame.at(arcs.s_start) for frame, arcs in pairs]),
        class_ids=np.concatenate([np.arange(count) for count in counts]),
    )
    sender.constant("joints", rr.Points3D.from_fields(radii=rr.Radius.ui_points(7.0), show_labels=False))
    sender.send("joints", columns, counts)


def send_labels(sender: Sender, located: Sequence[LabelPositions], texts: Sequence[Sequence[str]]) -> None:
    """Write the tension beside each end, and the angle and radius beside each piece where there is room."""
    style = rr.Points3D.from_fields(radii=0.0, colors=colours.WHITE, show_labels=True)
    sender.constant("labels", style)
    columns = rr.Points3D.columns(
        positions=np.concatenate([one.position for one in located]),
        labels=[
            text if whole else text.partition(" · ")[0]
            for one, row in zip(located, texts, strict=True)
            for text, whole in zip(row, one.whole.tolist(), strict=True)
        ],
    )
    sender.send("labels", columns, [len(row) for row in texts])


def label_texts(tension_in: float, tension_out: float, arcs: Arcs) -> list[str]:
    """Return the texts beside both ends, with their tensions [N], and beside the labelled pieces."""
    pieces = words.piece_labels(arcs)
    return [*words.end_labels(tension_in, tension_out), *(pieces[k] for k in labelled(arcs))]


def send_clearance(sender: Sender, run: Run, measured: Sequence[Clearance]) -> None:
    """Mark the wall where the tube touches it, and the least clearance of each frame."""
    touching = [_contact_points(one) for one in measured]
    _send_points(sender, "lumen/contact", touching, colours.CONTACT, 4.0)
    _send_narrowest(sender, run, measured)


def _contact_points(one: Clearance) -> Points:
    inside = [(region.begin <= one.s) & (one.s <= region.end) for region in (*one.contacts, *one.outside)]
    return one.wall_position[np.any(inside, axis=0)] if inside else np.zeros((0, 3))


def _send_narrowest(sender: Sender, run: Run, measured: Sequence[Clearance]) -> None:
    """Draw a line from the route to the wall at the least clearance, which is its label."""
    known = [one.narrowest >= 0 for one in measured]
    lines = [
        np.array([frame.at(one.s[[one.narrowest]])[0], one.wall_position[one.narrowest]])
        for frame, one, is_known in zip(run.frames, measured, known, strict=True)
        if is_known
    ]
    if not lines:
        return
    counts = [int(is_known) for is_known in known]
    style = rr.LineStrips3D.from_fields(colors=colours.CONTACT, radii=rr.Radius.ui_points(2.0))
    sender.constant("lumen/narrowest", style)
    sender.send("lumen/narrowest", rr.LineStrips3D.columns(strips=segments_3d(lines)), counts)
    label = rr.Points3D.from_fields(radii=0.0, colors=colours.WHITE, show_labels=True)
    sender.constant("lumen/narrowest/label", label)
    texts = [_distance_words(one.least) for one in measured if one.least is not None]
    columns = rr.Points3D.columns(positions=np.array([line[1] for line in lines]), labels=texts)
    sender.send("lumen/narrowest/label", columns, counts)


def clearance_words(one: Clearance) -> str:
    """Describe the clearance of a tube in its lumen, as markdown."""
    if one.least is None:
        return "The route lies beyond the ends of the lumen mesh."
    tube = f"A tube of {2e3 * one.radius:.1f} mm" if one.radius else "The middle of the tube"
    at = f"at s = {1e3 * one.s[one.narrowest]:.0f} mm"
    text = f"{tube} is at its narrowest **{_distance_words(one.least)}** of the lumen, {at}."
    if one.contacts:
        length = sum(region.end - region.begin for region in one.contacts)
        text += f" It touches the wall on {1e3 * length:.0f} mm, within the noise of the route."
    return " ".join([text, *(f"⚠ {warning}." for warning in one.warnings())])


def _distance_words(least: float) -> str:
    return f"{1e3 * abs(least):.1f} mm {'into' if least < 0 else 'from'} the wall"
