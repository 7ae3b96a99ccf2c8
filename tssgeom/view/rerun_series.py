"""Numbers of a run against time: tensions, elongation and accumulated curve angle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr

from tssgeom.arrays import Matrix, Vector
from tssgeom.stream import FrameResult
from tssgeom.view import colours
from tssgeom.view.columns import Sender
from tssgeom.view.drawn import numbers_of


def send_series(sender: Sender, results: Sequence[FrameResult]) -> None:
    """Send what changes from frame to frame, in the units of the plots' titles."""
    send_numbers(sender, np.array([numbers_of(result) for result in results]))
    _send_measured(sender, results)


def send_numbers(sender: Sender, numbers: Matrix) -> None:
    """Send the `numbers_of` many frames [m, 4], in the units of the plots' titles."""
    tension_in, tension_out, elongation, angle = numbers.T
    _line(sender, "tension_in", "T_in [N]", colours.TENSION_IN, tension_in)
    _line(sender, "tension_out", "T_out [N]", colours.TENSION_OUT, tension_out)
    _line(sender, "elongation", "elongation δ [mm]", colours.ELONGATION, 1e3 * elongation)
    _line(sender, "angle", "curve angle Φ [°]", colours.ANGLE, np.degrees(angle))


def _send_measured(sender: Sender, results: Sequence[FrameResult]) -> None:
    """Send what was measured, where every frame brings it."""
    outs = [result.frame.tension_out for result in results]
    if all(value is not None for value in outs):
        _line(sender, "tension_out_measured", "T_out measured [N]", colours.MEASURED, outs)
    elongations = [result.frame.elongation for result in results]
    if all(value is not None for value in elongations):
        values = 1e3 * np.array(elongations, dtype=np.float64)
        _line(sender, "elongation_measured", "δ measured [mm]", colours.MEASURED, values)


def _line(
    sender: Sender,
    entity: str,
    name: str,
    colour: tuple[int, int, int],
    values: Sequence[float | None] | Vector,
) -> None:
    style = rr.SeriesLines(names=name, colors=[colour], widths=[2.0])
    sender.constant(f"series/{entity}", style)
    sender.send(f"series/{entity}", rr.Scalars.columns(scalars=np.asarray(values, dtype=np.float64)))
