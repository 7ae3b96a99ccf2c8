"""The recording of a machine: its tendons in the colours of their tension, its joint, and lines over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from tssgeom.arrays import Points, Vector
from tssgeom.tendon.machine import Machine
from tssgeom.view import colours
from tssgeom.view.quantities import ANGLE, quantity
from tssgeom.view.samples import RouteSamples
from tssgeom.view.scene.blueprint import layout, plot, space_view, time_panel
from tssgeom.view.scene.camera import Camera, camera
from tssgeom.view.scene.columns import Sender, segments_3d
from tssgeom.view.scene.space import send_scale_bar
from tssgeom.view.scene.writer import recording_file

_BESIDE = 0.02  # of the extent of the route: tendons on one route are so far apart [1]; chosen
_DIAL = 0.08  # of it: radius of the circle on which the hand of the joint turns [1]; chosen
_LABEL = np.array([0.12, 0.05])  # of the height of the view: from a tendon to its label [1]; chosen
_HAND = 48  # points of that circle; chosen
_NODES = 121  # of the line of a tendon; chosen: no corner shows
_SHARES = np.linspace(0.0, 1.0, _NODES)
_PLOTS = {
    "Tension T_in [N] against time [s]": ("tension_in",),
    "Tension T_out [N] against time [s]": ("tension_out",),
    "Angle [°] against time [s]": ("motor_angle", "joint_angle", "bending_"),
    "Torque [mN·m] against time [s]": ("motor_torque", "joint_torque"),
}


def write_machine_recording(
    path: Path,
    name: str,
    machine: Machine,
    routes: Sequence[RouteSamples],
    time: Vector,
    channels: Mapping[str, Vector],
    tension: np.ndarray,
) -> None:
    """Write the Rerun recording of a run of a machine.

    Parameters
    ----------
    path
        The `.rrd` file.
    name
        Name of the run.
    machine
        The machine.
    routes
        The route of each tendon.
    time
        [s] Increasing [s].
    channels
        [s] What every channel reads, by name.
    tension
        [s, n, bars + 2] Tension of every bar [N].

    Raises
    ------
    SourceError
        Where the file cannot be written.
    """
    points = np.concatenate([route.position for route in routes])
    radius = _DIAL * float(np.max(np.ptp(points, axis=0)))
    joint = routes[0].position[-1] + 1.3 * radius * _direction(routes[0].position)
    room = [
        at + 2.0 * radius * way for at in (joint, routes[0].position[0]) for way in (*np.eye(3), *-np.eye(3))
    ]
    eye = camera(np.vstack([points, *room]), routes[0].position[-1] - routes[0].position[0])
    lines = _lines(routes, eye)
    top = float(np.max(tension))
    plots = [
        plot(title, [f"series/{channel}" for channel in channels if channel.startswith(stems)], named=True)
        for title, stems in _PLOTS.items()
        if any(channel.startswith(stems) for channel in channels)
    ]
    space = space_view(
        f"{name}: tendons coloured by tension [N]", eye, ("tendon", "joint", "labels", "scale")
    )
    views = rrb.Horizontal(space, rrb.Vertical(*plots), column_shares=[3, 2])
    with recording_file(path, name, layout(views, time_panel())) as recording:
        sender = Sender(recording, time)
        for which, line in enumerate(lines):
            middles = np.concatenate(([0.0], 0.5 * (machine.edge[1:] + machine.edge[:-1]), [1.0]))
            along = np.array([np.interp(_SHARES, middles, row) for row in tension[:, which]])
            _send_tendon(sender, f"tendon/{which + 1}", line, along, top)
        send_scale_bar(sender, eye)
        _send_ends(sender, lines, eye, tension)
        if "joint_angle_rad" in channels:
            _send_joint(sender, lines[0], eye, joint, radius, channels["joint_angle_rad"])
        _send_series(sender, channels)


def _direction(line: Points) -> Vector:
    """Return the direction of the end of a line."""
    way = line[-1] - line[-2]
    return way / float(np.linalg.norm(way))


def _beside(way: Vector, side: float, end: int) -> Vector:
    """Return where the label of an end is on the screen: beside its line, or at 0 beyond it."""
    along = way / max(float(np.linalg.norm(way)), 1e-9)
    outward = -along if end == 0 else along
    return side * np.array([along[1], -along[0]]) + (1.0 - abs(side)) * outward


def _lines(routes: Sequence[RouteSamples], eye: Camera) -> list[Points]:
    """Return the nodes of each tendon [`_NODES`, 3] [m], tendons side by side."""
    lines, count = [], len(routes)
    for which, route in enumerate(routes):
        beside = _BESIDE * 2.0 * eye.half_width * (which - 0.5 * (count - 1))
        lines.append(route.at(_SHARES * route.s[-1]) + beside * eye.axes[1])
    return lines


def _send_tendon(sender: Sender, entity: str, line: Points, tension: np.ndarray, top: float) -> None:
    """Draw a tendon in the colours of its tension at its nodes [s, `_NODES`] [N]."""
    rows, inside = len(tension), 0.5 * (tension[:, 1:] + tension[:, :-1])
    columns = rr.LineStrips3D.columns(
        strips=segments_3d([line] * rows), colors=colours.tension_rgba32(inside.ravel(), top)
    )
    sender.constant(entity, rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points(4.0)))
    sender.send(entity, columns, [inside.shape[1]] * rows)


def _send_ends(sender: Sender, lines: Sequence[Points], eye: Camera, tension: np.ndarray) -> None:
    """Write number and tension [N] beside both ends of each tendon, [s, n, bars + 2] of every bar."""
    sides = np.linspace(-1.0, 1.0, len(lines)) if len(lines) > 1 else np.ones(1)
    anchors = [
        eye.label_anchor(
            line[[end]],
            _LABEL * _beside(eye.axes[:2] @ _direction(line[:2] if end == 0 else line), side, end),
        )
        for line, side in zip(lines, sides, strict=True)
        for end in (0, -1)
    ]
    style = rr.Points3D.from_fields(radii=0.0, colors=colours.WHITE, show_labels=True)
    sender.constant("labels", style)
    labels = [
        f"tendon {which + 1}: {end:.1f} N"
        for row in tension[:, :, [0, -1]]
        for which, of in enumerate(row)
        for end in of
    ]
    positions = np.tile(np.concatenate(anchors), (len(tension), 1))
    columns = rr.Points3D.columns(positions=positions, labels=labels)
    sender.send("labels", columns, [2 * len(lines)] * len(tension))


def _send_joint(
    sender: Sender, line: Points, eye: Camera, middle: Vector, radius: float, angle: Vector
) -> None:
    """Draw a circle beyond the distal end, and a hand that turns with the joint."""
    way = _direction(line)
    across, up = eye.axes[:2]
    start = np.arctan2(way @ up, way @ across)
    around = np.linspace(0.0, 2.0 * np.pi, _HAND)

    def at(turn: Vector) -> Points:
        return middle + radius * (np.outer(np.cos(turn), across) + np.outer(np.sin(turn), up))

    circle = rr.LineStrips3D([at(around)], colors=[colours.AXIS], radii=rr.Radius.ui_points(1.5))
    sender.constant("joint/circle", circle)
    sender.constant(
        "joint/hand", rr.LineStrips3D.from_fields(colors=ANGLE.rgb, radii=rr.Radius.ui_points(3.0))
    )
    hands = [np.stack([middle, end]) for end in at(start + angle)]
    sender.send("joint/hand", rr.LineStrips3D.columns(strips=segments_3d(hands)), [1] * len(angle))


def _send_series(sender: Sender, channels: Mapping[str, Vector]) -> None:
    for stems in _PLOTS.values():
        for k, name in enumerate(each for each in channels if each.startswith(stems)):
            of = quantity(name)  # in every plot tendon 1 has the first colour
            style = rr.SeriesLines(names=of.label, colors=[colours.piece_rgb(k)], widths=[2.0])
            sender.constant(f"series/{name}", style)
            sender.send(f"series/{name}", rr.Scalars.columns(scalars=of.factor * channels[name]))
