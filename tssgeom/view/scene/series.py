"""Numbers of a run against time: tensions, elongation and accumulated curve angle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr

from tssgeom.arrays import Matrix, Vector
from tssgeom.stream import FrameResult
from tssgeom.view import colours
from tssgeom.view.quantities import ANGLE, ELONGATION, TENSION_IN, TENSION_OUT, Quantity
from tssgeom.view.samples import numbers_of
from tssgeom.view.scene.columns import Sender


def send_series(sender: Sender, results: Sequence[FrameResult]) -> None:
    """Send what changes from frame to frame, in the units of the plots' titles."""
    send_numbers(sender, np.array([numbers_of(result) for result in results]))
    _send_measured(sender, results)


def send_numbers(sender: Sender, numbers: Matrix) -> None:
    """Send the `numbers_of` many frames [m, 4], in the units of the plots' titles."""
    tension_in, tension_out, elongation, angle = numbers.T
    send_line(sender, "tension_in", TENSION_IN, tension_in)
    send_line(sender, "tension_out", TENSION_OUT, tension_out)
    send_line(sender, "elongation", ELONGATION, elongation)
    send_line(sender, "angle", ANGLE, angle)


def _send_measured(sender: Sender, results: Sequence[FrameResult]) -> None:
    """Send what was measured, where every frame brings it."""
    outs = [result.frame.tension_out for result in results]
    if all(value is not None for value in outs):
        _send_reading(sender, "tension_out", TENSION_OUT, np.array(outs, dtype=np.float64))
    elongations = [result.frame.elongation for result in results]
    if all(value is not None for value in elongations):
        _send_reading(sender, "elongation", ELONGATION, np.array(elongations, dtype=np.float64))


def _send_reading(sender: Sender, entity: str, told: Quantity, values: Vector) -> None:
    send_line(
        sender,
        f"{entity}_measured",
        told,
        values,
        name=f"{told.symbol} measured [{told.unit}]",
        colour=colours.MEASURED,
    )


def send_line(
    sender: Sender,
    entity: str,
    told: Quantity,
    values: Vector,
    *,
    name: str = "",
    colour: tuple[int, int, int] | None = None,
) -> None:
    """Send a quantity [SI] against time, in its own unit; name and colour are its own unless given."""
    style = rr.SeriesLines(names=name or told.label, colors=[colour or told.rgb], widths=[2.0])
    sender.constant(f"series/{entity}", style)
    sender.send(f"series/{entity}", rr.Scalars.columns(scalars=told.factor * np.asarray(values, np.float64)))
