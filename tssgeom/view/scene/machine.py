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
from tssgeom.view.quantities import quantity
from tssgeom.view.samples import RouteSamples
from tssgeom.view.scene.blueprint import Span, layout, plot, space_view, time_panel
from tssgeom.view.scene.charts import Sender, segments_3d
from tssgeom.view.scene.labels import Camera, camera, time_position
from tssgeom.view.scene.space import send_scale_bar
from tssgeom.view.scene.writer import recording_file

Rgb = tuple[int, int, int]
_BESIDE = 0.02  # of the extent of the route: tendons on one route are so far apart [1]; chosen
_DIAL = 0.08  # of it: radius of the circle on which the hand of the joint turns [1]; chosen
_LABEL = np.array([0.12, 0.05])  # of the height of the view: from a tendon to its label [1]; chosen
_HAND = 48  # points of that circle; chosen
_NODES = 121  # of the line of a tendon; chosen: no corner shows
_SHARES = np.linspace(0.0, 1.0, _NODES)
_PLOTS = {
    "Tension T_in [N]": ("tension_in",),
    "Tension T_out [N]": ("tension_out",),
    "Angle [°]": ("motor_angle", "joint_angle", "bending_"),
    "Torque [mN·m]": ("motor_torque", "joint_torque"),
    "Tip [mm]": ("tip_",),
}
"""Plots over time, and how the names of their channels begin."""
_ALIKE = 4.0  # greatest over smallest extent of lines in one plot [1]; chosen: both show their course
_UPRIGHT = 0.2  # of the step along a route: shorter on the screen it runs along the view [1]; chosen
_BAR = 0.3  # length of the bar of colours [heights of the view]; chosen: it fits between scale and axes
_BAR_STEPS = 64  # of its colours; chosen: no step shows
_BAR_LABELS = np.array([-0.04, 0.05])  # from its ends to 0 N and to the top [heights of the view]; chosen


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
    plots = _plots(channels, (float(time[0]), float(time[-1])))
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
        _send_bar(sender, eye, top)
        _send_ends(sender, lines, eye, tension)
        if "joint_angle_rad" in channels:
            angle, colour = channels["joint_angle_rad"], _shades(channels)["joint_angle_rad"]
            _send_joint(sender, lines[0], eye, joint, radius, angle, colour)
        _send_series(sender, channels)


def _plots(channels: Mapping[str, Vector], span: Span) -> list[rrb.TimeSeriesView]:
    """Arrange the channels: all tensions on one scale, and what is much larger in a plot of its own."""
    tensions = [values for name, values in channels.items() if name.startswith("tension_")]
    top = max((float(np.max(values)) for values in tensions), default=None)
    return [
        plot(
            f"{title} against time [s]",
            [f"series/{name}" for name in names],
            top=top if title.startswith("Tension") else None,
            named=True,
            span=span,
        )
        for title, stems in _PLOTS.items()
        for names in _alike(channels, stems)
    ]


def _alike(channels: Mapping[str, Vector], stems: Sequence[str]) -> list[list[str]]:
    """Return the channels of one plot, or those of each stem where one would be flat beside another."""
    by_stem = [[name for name in channels if name.startswith(stem)] for stem in stems]
    by_stem = [names for names in by_stem if names]
    if not by_stem:
        return []
    extents = [max(float(np.max(np.abs(channels[name]))) for name in names) for names in by_stem]
    apart = max(extents) > _ALIKE * min(extents)
    return by_stem if apart else [[name for names in by_stem for name in names]]


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
    """Return the nodes of each tendon [`_NODES`, 3] [m], side by side on the screen, tendon 1 on the left."""
    lines, count = [], len(routes)
    for which, route in enumerate(routes):
        line = route.at(_SHARES * route.s[-1])
        along = np.gradient(line, axis=0) @ eye.axes[:2].T
        step = np.linalg.norm(np.gradient(line, axis=0), axis=1)
        long = np.maximum(np.linalg.norm(along, axis=1), _UPRIGHT * step)
        right = np.column_stack((along[:, 1], -along[:, 0])) / long[:, None] @ eye.axes[:2]
        lines.append(line + _BESIDE * 2.0 * eye.half_width * (which - 0.5 * (count - 1)) * right)
    return lines


def _send_bar(sender: Sender, eye: Camera, top: float) -> None:
    """Draw the colours of tension below the routes, from 0 N to the top."""
    middle = time_position(eye)[0]
    across = np.linspace(-0.5, 0.5, _BAR_STEPS + 1) * _BAR * eye.view_height
    line = middle + across[:, None] * eye.across
    shade = colours.tension_rgba32(np.linspace(0.0, top, _BAR_STEPS), top)
    strips = np.stack([line[:-1], line[1:]], axis=1)
    sender.always("scale/tension", rr.LineStrips3D(strips, colors=shade, radii=rr.Radius.ui_points(4.0)))
    ends = line[[0, -1]] + np.outer(_BAR_LABELS * eye.view_height, eye.across)
    anchor, texts = eye.label_anchor(ends, np.zeros(2)), ["0 N", f"{top:.1f} N"]
    names = rr.Points3D(anchor, radii=0.0, labels=texts, colors=[colours.WHITE], show_labels=True)
    sender.always("scale/tension/ends", names)


def _send_tendon(sender: Sender, entity: str, line: Points, tension: np.ndarray, top: float) -> None:
    """Draw a tendon in the colours of its tension at its nodes [s, `_NODES`] [N]."""
    rows, inside = len(tension), 0.5 * (tension[:, 1:] + tension[:, :-1])
    columns = rr.LineStrips3D.columns(
        strips=segments_3d([line] * rows), colors=colours.tension_rgba32(inside.ravel(), top)
    )
    sender.constant(entity, rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points(4.0)))
    sender.send(entity, columns, [inside.shape[1]] * rows)


def _send_ends(sender: Sender, lines: Sequence[Points], eye: Camera, tension: np.ndarray) -> None:
    """Write the tension [N] beside both ends of each tendon, [s, n, bars + 2] of every bar."""
    sides = np.linspace(-1.0, 1.0, len(lines)) if len(lines) > 1 else np.ones(1)
    anchors = [
        eye.label_anchor(
            line[[end]],
            _LABEL * _beside(eye.axes[:2] @ _direction(line[:2] if end == 0 else line), side, end),
        )
        for line, side in zip(lines, sides, strict=True)
        for end in (0, -1)
    ]
    shades = [colours.tendon_rgb(which) for which in range(len(lines)) for _ in (0, -1)]
    style = rr.Points3D.from_fields(radii=0.0, colors=shades, show_labels=True)
    sender.constant("labels", style)
    numbers = [f",{which + 1}" for which in range(len(lines))] if len(lines) > 1 else [""]
    names = [f"T_{end}{number}" for number in numbers for end in ("in", "out")]
    labels = [
        f"{name} {end:.1f} N"
        for row in tension[:, :, [0, -1]]
        for name, end in zip(names, row.ravel(), strict=True)
    ]
    positions = np.tile(np.concatenate(anchors), (len(tension), 1))
    columns = rr.Points3D.columns(positions=positions, labels=labels)
    sender.send("labels", columns, [2 * len(lines)] * len(tension))


def _send_joint(
    sender: Sender, line: Points, eye: Camera, middle: Vector, radius: float, angle: Vector, colour: Rgb
) -> None:
    """Draw a circle beyond the distal end, and a hand that turns with the joint, coloured as its line."""
    way = _direction(line)
    across, up = eye.axes[:2]
    start = np.arctan2(way @ up, way @ across)
    around = np.linspace(0.0, 2.0 * np.pi, _HAND)

    def at(turn: Vector) -> Points:
        return middle + radius * (np.outer(np.cos(turn), across) + np.outer(np.sin(turn), up))

    circle = rr.LineStrips3D([at(around)], colors=[colours.AXIS], radii=rr.Radius.ui_points(1.5))
    sender.constant("joint/circle", circle)
    sender.constant("joint/hand", rr.LineStrips3D.from_fields(colors=colour, radii=rr.Radius.ui_points(3.0)))
    hands = [np.stack([middle, end]) for end in at(start + angle)]
    sender.send("joint/hand", rr.LineStrips3D.columns(strips=segments_3d(hands)), [1] * len(angle))


def _send_series(sender: Sender, channels: Mapping[str, Vector]) -> None:
    for name, shade in _shades(channels).items():
        of = quantity(name)
        sender.line(f"series/{name}", of.label, shade, of.factor * channels[name])


def _shades(channels: Mapping[str, Vector]) -> dict[str, Rgb]:
    """Return the colour of each channel that is plotted; tendon 1 has the first colour in all plots."""
    return {
        name: colours.tendon_rgb(k)
        for stems in _PLOTS.values()
        for k, name in enumerate(each for each in channels if each.startswith(stems))
    }
