"""The numbers behind a picture, kept beside it: a selection shows them, and other programs read them back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr

from tssgeom.arrays import Vector
from tssgeom.stream import FrameResult
from tssgeom.view.scene.columns import Sender
from tssgeom.view.scene.run import Run

ON_ROUTE = ("s_m", "tension_N", "phi_rad", "kappa_per_m", "kappa_se_per_m", "phi_se_rad")
"""Numbers at every node that is drawn, in single precision."""
ON_JOINTS = ("length_m", "angle_rad")
"""Numbers of every piece."""
NUMBERS = (
    "length_m",
    "total_angle_rad",
    "total_angle_se_rad",
    "tension_in_N",
    "tension_out_N",
    "tension_out_se_N",
    "elongation_m",
    "elongation_se_m",
    "slip_front_m",
)
"""Numbers of the frame as a whole."""


def send_numbers_of_route(sender: Sender, run: Run) -> None:
    """Send what each node of the route, each piece and each frame is, beside what draws them."""
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
    told = dict[str, Vector](zip(NUMBERS, whole.T, strict=True))
    sender.send("summary", _values(told))


def _whole(result: FrameResult) -> tuple[float, ...]:
    arcs, seen = result.arcs, result.transmission
    return (
        arcs.total_length,
        arcs.total_angle,
        arcs.total_angle_se,
        seen.tension_in,
        seen.tension_out,
        seen.tension_out_se,
        seen.elongation,
        seen.elongation_se,
    )


def _values(columns: Mapping[str, Any]) -> rr.ComponentColumnList:
    return rr.AnyValues.columns(**columns)


def _joined(values: Sequence[Vector]) -> pa.Array:
    return pa.array(np.concatenate(values).astype(np.float32))
