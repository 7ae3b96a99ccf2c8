"""Sensors of one tendon that is followed, and whose readings depend on earlier ones: lags, play of the load.

Source: docs/model.md (62), (319), (338).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tssgeom.adapt.members import PLAYS
from tssgeom.adapt.readings import CHANNELS, behind_play, lagged
from tssgeom.arrays import Matrix, Vector
from tssgeom.effects import Setup
from tssgeom.errors import SettingsError

LAG, PLAY = "channel_lag.lag_s", "load_play.width_m"
"""Keys of these numbers where they are followed."""


class TendonSensors:
    """What the channels of many members read, some of them late or behind a play.

    Parameters
    ----------
    setup
        The rig.
    keys
        Numbers that are followed; of several lags the first one is.

    Raises
    ------
    SettingsError
        Where a sensor has a law of its own, which is not followed.
    """

    def __init__(self, setup: Setup, keys: Sequence[str]) -> None:
        for curve in setup.curves:
            channel, _, over = curve.table.partition(" over ")
            if over in ("reading", "time") and channel in (*CHANNELS, "displacement_in_m"):
                raise SettingsError(
                    f"effects.sensor_law: {channel} over {over} is not followed: leave it out"
                )
        self._late = [(CHANNELS.index(name), lag) for name, lag in setup.lags if name in CHANNELS]
        self._play = setup.load_play_m
        self._first = list(keys).index(LAG) if LAG in keys else -1
        self._width = list(keys).index(PLAY) if PLAY in keys else -1
        has_history = bool(self._late) or self._play > 0.0 or self._width >= 0
        self.columns = PLAYS + 2 * len(self._late) if has_history else 0
        """Of a `Standing.block`: the load behind its play [m], nothing, and of each channel that is late what
        it is and what it reads."""

    def read(
        self, numbers: Matrix, block: Matrix, true: Matrix, position: Vector, span: float
    ) -> tuple[Matrix, Matrix]:
        """Return what the channels read [rows, c], and the columns of a `block` after that; model.md (338).

        Parameters
        ----------
        numbers
            [rows, d] What is followed.
        block
            [rows, …] What plays and late channels kept.
        true, position
            [rows, c] What the channels would read at once, and [rows] where the load is [m].
        span
            Time since the last readings [s].
        """
        read, kept = true.copy(), block.copy()
        if self._play > 0.0 or self._width >= 0:
            width = self._play if self._width < 0 else np.maximum(numbers[:, self._width], 0.0)
            kept[:, 0] = behind_play(position, width, block[:, 0])
            read[:, CHANNELS.index("elongation_m")] += position - kept[:, 0]
        for k, (channel, lag) in enumerate(self._late):
            follows = k == 0 and self._first >= 0
            at, late = PLAYS + 2 * k, np.maximum(numbers[:, self._first], 0.0) if follows else lag
            kept[:, at] = read[:, channel]
            read[:, channel] = lagged(read[:, channel], block[:, at], block[:, at + 1], late, span)
            kept[:, at + 1] = read[:, channel]
        return read, kept
