"""One run as a recording shows it: what holds for all its views, and its numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr

from tssgeom.arrays import Matrix, Vector
from tssgeom.stream import FrameResult
from tssgeom.summary import RANGED
from tssgeom.view import colours
from tssgeom.view.quantities import ANGLE, ELONGATION, TENSION_IN, TENSION_OUT, Quantity
from tssgeom.view.samples import Ranges, RouteSamples, front, numbers_of, ranges, route_samples
from tssgeom.view.scene.charts import Sender
from tssgeom.view.scene.labels import Camera, camera


@dataclass(frozen=True, slots=True)
class Run:
    """Everything that one recording shows, chosen once for all its views."""

    name: str
    results: Sequence[FrameResult]
    frames: Sequence[RouteSamples]
    ranges: Ranges
    camera: Camera
    timed: bool

    @property
    def fronts(self) -> Sequence[float]:
        """Arc length up to which the tendon slid in each frame [m]."""
        return [front(result, frame) for result, frame in zip(self.results, self.frames, strict=True)]


def run_of(name: str, results: Sequence[FrameResult], timed: bool) -> Run:
    """Choose nodes, ranges and a camera for all frames of a run."""
    frames = [route_samples(result) for result in results]
    limits = ranges(frames, [result.arcs for result in results])
    return Run(name, results, frames, limits, camera_of(frames), timed)


def camera_of(frames: Sequence[RouteSamples]) -> Camera:
    """Return a camera that sees every frame."""
    everywhere = np.concatenate([frame.position for frame in frames])
    return camera(everywhere, np.mean([frame.position[-1] - frame.position[0] for frame in frames], axis=0))


def send_series(sender: Sender, results: Sequence[FrameResult]) -> None:
    """Send the lines over time, in the units of the plots' titles."""
    send_numbers(sender, np.array([numbers_of(result) for result in results]))
    _send_measured(sender, results)


def send_numbers(sender: Sender, numbers: Matrix) -> None:
    """Send the `numbers_of` of m frames [m, 5], in the units of the plots' titles; Φ with its band."""
    tension_in, tension_out, elongation, angle, error = numbers.T
    send_line(sender, "tension_in", TENSION_IN, tension_in)
    send_line(sender, "tension_out", TENSION_OUT, tension_out)
    send_line(sender, "elongation", ELONGATION, elongation)
    send_line(sender, "angle", ANGLE, angle)
    for end, sign, side in (("least", "−", -1.0), ("most", "+", 1.0)):
        style = {"name": f"Φ {sign} s.e. [{ANGLE.unit}]", "colour": colours.ANGLE_BAND, "width": 1.0}
        send_line(sender, f"angle_{end}", ANGLE, angle + side * error, **style)


def _send_measured(sender: Sender, results: Sequence[FrameResult]) -> None:
    """Send measured values as crosses that leave the line of the model visible, where every frame has one."""
    for field, quantity in (("tension_out", TENSION_OUT), ("elongation", ELONGATION)):
        values = [getattr(result.frame, field) for result in results]
        if all(value is not None for value in values):
            entity, name = f"series/{field}_measured", f"{quantity.symbol} measured [{quantity.unit}]"
            marks = {"markers": ["plus"], "marker_sizes": [2.0], "colors": [colours.MEASURED]}
            sender.constant(entity, rr.SeriesPoints(names=name, **marks))
            scalars = quantity.factor * np.array(values, dtype=np.float64)
            sender.send(entity, rr.Scalars.columns(scalars=scalars))


def send_line(
    sender: Sender,
    entity: str,
    quantity: Quantity,
    values: Vector,
    *,
    name: str = "",
    colour: tuple[int, int, int] | None = None,
    width: float = 2.0,
) -> None:
    """Send a quantity [SI] against time, in its own unit; name and colour are its own unless given."""
    scalars = quantity.factor * np.asarray(values, np.float64)
    sender.line(f"series/{entity}", name or quantity.label, colour or quantity.rgb, scalars, width)


ON_ROUTE = ("s_m", "tension_N", "phi_rad", "kappa_per_m", "kappa_se_per_m", "phi_se_rad")
"""Numbers at every node that is drawn, in single precision."""
ON_JOINTS = ("length_m", "angle_rad")
"""Numbers of every piece."""
NUMBERS = (*RANGED, "slip_front_m")
"""Numbers of the frame as a whole."""
SEQUENCE = "seq"
"""Count of the frame among all that were sensed."""


def send_numbers_of_route(sender: Sender, run: Run) -> None:
    """Send the numbers of each node of the route, of each piece and of each frame, beside their pictures."""
    frames, lengths = run.frames, [len(frame.s) for frame in run.frames]
    columns = ("s", "tension", "phi", "kappa", "kappa_se", "phi_se")
    nodes = {
        name: _joined([getattr(frame, column) for frame in frames])
        for name, column in zip(ON_ROUTE, columns, strict=True)
    }
    sender.send("route", _values(nodes), lengths)
    arcs = [result.arcs for result in run.results]
    pieces = {
        name: np.concatenate([getattr(one, column) for one in arcs])
        for name, column in zip(ON_JOINTS, ("length", "angle"), strict=True)
    }
    sender.send("joints", _values(pieces), [len(one.length) for one in arcs])
    pairs = zip(run.results, run.fronts, strict=True)
    whole = np.array([(*_whole(result), front) for result, front in pairs])
    sequence = np.array([result.seq for result in run.results])
    numbers = {**dict(zip(NUMBERS, whole.T, strict=True)), SEQUENCE: sequence}
    sender.send("summary", _values(numbers))


def _whole(result: FrameResult) -> tuple[float, ...]:
    arcs, ends = result.arcs, result.transmission
    return (
        arcs.total_length,
        arcs.total_angle,
        arcs.total_angle_se,
        ends.tension_in,
        ends.tension_out,
        ends.tension_out_se,
        ends.elongation,
        ends.elongation_se,
    )


def _values(columns: Mapping[str, Any]) -> rr.ComponentColumnList:
    return rr.AnyValues.columns(**columns)


def _joined(values: Sequence[Vector]) -> pa.Array:
    return pa.array(np.concatenate(values).astype(np.float32))
