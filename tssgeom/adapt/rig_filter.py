"""The filter that follows a rig of one tendon, and its sensors, whose readings may depend on earlier ones.

Source: docs/model.md (62), (200) to (205), (319), (338), (353).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import get_args

import numpy as np

from tssgeom import core
from tssgeom.adapt.ensemble import Ensemble
from tssgeom.adapt.followed import FollowedNumber, straight_lines
from tssgeom.adapt.members import PLAYS, SETTINGS, Rows, Standing
from tssgeom.adapt.readings import CHANNELS, Moment, Readings, lagged, mean_and_sd, used
from tssgeom.adapt.stepped import Stepped
from tssgeom.adapt.trailed_drive import TrailedDrive
from tssgeom.arrays import Matrix, Vector
from tssgeom.core.constants_tendon import BAR
from tssgeom.effects import Setup
from tssgeom.effects.laws import SensorOver
from tssgeom.errors import SettingsError
from tssgeom.rig import Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import bends_of, edges
from tssgeom.tendon.bars.model import BARS, begin, model_of, setup_of
from tssgeom.tendon.bars.plant import Memory
from tssgeom.tendon.bars.sensors import behind_play, check_drive

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
        Where a sensor has a law of its own, or the distal recorder is late, which is not followed.
    """

    def __init__(self, setup: Setup, keys: Sequence[str]) -> None:
        for curve in setup.curves:
            channel, _, over = curve.table.partition(" over ")
            if over in get_args(SensorOver) and channel in (*CHANNELS, "displacement_in_m"):
                raise SettingsError(
                    f"effects.sensor_law: {channel} over {over} is not followed: leave it out"
                )
        if setup.distal_delay_s > 0.0:
            raise SettingsError(
                "effects.channel_lag: a late distal recorder is not followed: take "
                f"{setup.distal_delay_s:g} s off the times of its columns, and leave the effect out"
            )
        self._late = [(CHANNELS.index(name), lag) for name, lag in setup.lags if name in CHANNELS]
        self._play, self._open = setup.load_play_m, setup.load_play_open_m
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
            before = np.where(np.isnan(block[:, 0]), position + self._open, block[:, 0])
            kept[:, 0] = behind_play(position, width, before)
            read[:, CHANNELS.index("elongation_m")] += position - (kept[:, 0] - self._open)
        for k, (channel, lag) in enumerate(self._late):
            follows = k == 0 and self._first >= 0
            at, late = PLAYS + 2 * k, np.maximum(numbers[:, self._first], 0.0) if follows else lag
            kept[:, at] = read[:, channel]
            read[:, channel] = lagged(read[:, channel], block[:, at], block[:, at + 1], late, span)
            kept[:, at + 1] = read[:, channel]
        return read, kept


DRIVES = ("displacement_in_m", "tension_in_N")
"""What may drive: a position, or else the tension."""


class RigFilter(Ensemble):
    """Follows numbers of a rig of one tendon from frame to frame.

    Parameters
    ----------
    rig, numbers, arcs, seed
        As of `Ensemble`.
    """

    of_machines = False

    def __init__(
        self,
        rig: Rig,
        numbers: Sequence[FollowedNumber],
        arcs: Arcs,
        *,
        seed: int = 0,
    ) -> None:
        self.count, self.edge = 1, edges(arcs, BARS)
        self._setup = setup_of(rig)
        self.sensors = TendonSensors(self._setup, [one.key for one in numbers])
        super().__init__(rig, numbers, arcs, CHANNELS, DRIVES, seed)
        self.drives = DRIVES[:1]
        rest = begin(model_of(setup_of(rig), arcs, "displacement_in_m", self.edge)).memory
        count = len(self.members)
        none, sensed = np.empty((count, 0)), np.full((count, self.sensors.columns), np.nan)
        self.stand(Standing(np.tile(rest.block, (count, 1)), none, sensed, np.zeros(count), False, math.nan))

    def go_on(self, memory: Memory, position: float) -> None:
        """Let all members stand where a tendon stands, whose drive is at a position [m]."""
        for one in (self.kept, self.now):
            one.memory[:], one.position[:] = memory.block, position
        self.is_history_known = True

    def _at_rest(self) -> Vector:
        return np.array([self.rig.tendon.pretension_N if self.drives == DRIVES[1:] else 0.0])

    def ends_after(
        self, arcs: Arcs, span: float, *, displacement_in: float | None, tension_in: float = 0.0
    ) -> tuple[Vector, Vector]:
        """Return both ends after a move of the drive, and their standard errors [4]; nothing is changed.

        A position [m], or else a true tension [N]; docs/model.md (205).
        """
        drive = tension_in if displacement_in is None else displacement_in
        rows = np.arange(SETTINGS.members // 2)
        read, readings = np.full((len(rows), 1), drive), Readings(tension_in, displacement_in, commanded=True)
        at, span = Moment(self.time, arcs, readings), max(span, SETTINGS.first_span)
        return mean_and_sd(self._stepped(self.now, rows, read, at, span, 0.0).ends)

    def drive_value(self, by_force: bool) -> float:
        """Return where the drive is, as it follows from its readings [N] or [m]."""
        return self.trackers[DRIVES[by_force]].position

    def _used(self, at: Moment) -> tuple[Moment, list[float]]:
        readings: Readings = at.readings
        if "displacement_in_m" in self.muted:
            readings = readings._replace(displacement_in=None)
        by_force = readings.by_force
        check_drive(self._setup, "tension_in_N" if by_force else "displacement_in_m")
        self.drives = (DRIVES[by_force],)
        if by_force != self.now.by_force and not math.isnan(self.time):
            self.kept = self.now.copied()
            self.trackers[DRIVES[by_force]] = TrailedDrive(self.trackers[DRIVES[by_force]].noise)
        given = readings.tension_in if by_force else readings.displacement_in
        return at._replace(readings=readings), [0.0 if given is None else given]

    def _given(self, at: Moment) -> Vector:
        return np.array(used(at.readings, self.muted))

    def _stepped(
        self, start: Standing, rows: Rows, read: Matrix, at: Moment, span: float, passed: float
    ) -> Stepped:
        readings: Readings = at.readings
        lines, drive, by_force = self._lines, read[:, 0], readings.by_force
        if by_force and not readings.commanded:
            zero, gain = lines.of_tension_in(self.members[rows])
            drive = np.maximum((drive - zero) / gain, 0.0)
        taken_up = self._setup.backlash_open_m  # docs/model.md (334)
        drive = drive if by_force else drive - taken_up
        done, memory, ends, predicted = core.step_ensemble(
            self.edge,
            lines.plant,
            lines.slope,
            lines.sensors,
            lines.sensor_slope,
            self.members - lines.about,
            start.memory,
            rows,
            at.arcs.length,
            at.arcs.angle,
            self._gains(),
            self._bends,
            at.arcs is not self.cut,
            by_force,
            start.by_force,
            start.position - taken_up,
            drive,
            max(span, BAR.least_time),
            at.warmth,
        )
        self._require_all(done, rows, "tendon")
        ends[:, 2] += taken_up
        predicted[:, CHANNELS.index("elongation_m")] += taken_up
        block = start.block
        if self.sensors.columns:
            kept = (self.members[rows], start.block[rows])
            predicted, block = self.sensors.read(*kept, predicted, ends[:, 3], passed)
        standing = Standing(memory, start.coordinate, block, ends[:, 2], by_force, at.time)
        return Stepped(standing, predicted, ends)

    def _gains(self) -> Vector:
        if self._same_gains is not None:
            return self._same_gains
        return np.ascontiguousarray(self.members[:, self.keys.index("route.angle_gain")])

    def _draw_lines(self) -> None:
        self._bends = bends_of(setup_of(self.rig))
        followed, gain = "route.angle_gain" in self.keys, self.rig.route.angle_gain
        self._same_gains = None if followed else np.full(len(self.members), gain)
        self._lines = straight_lines(self.rig, self.numbers, self.about, self.cut, self.edge)
