"""Frames from a long-form table: a row for each point, the rows of one time being one frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from tssgeom.arrays import Points, Vector, read_only
from tssgeom.errors import ShapeError
from tssgeom.io.formats.columns import MEASURED, POINT, TIME, of_machine
from tssgeom.io.formats.recording import PER_METRE, Frames
from tssgeom.io.formats.tables import Rows, Table
from tssgeom.stream import Frame, Rejected

MOST_AT_ONCE = 64 << 20
"""Files up to this size are read at once [B]; a larger one is read twice, in blocks. Chosen."""
MOST_POINTS = 100_000
"""The highest point number within a frame; chosen: a column with a higher one holds something else."""


@dataclass(frozen=True, slots=True)
class LongFrames(Frames):
    """The frames of a table."""

    table: Table
    runs: tuple[Rows, ...]
    """Rows of each frame."""
    lowest: float
    """The lowest point number of the file."""

    def read(self) -> Iterator[Frame | Rejected]:
        """Yield the frames as the table holds them."""
        return map(self._frame_or_rejected, self.runs)

    def _frame_or_rejected(self, rows: Rows) -> Frame | Rejected:
        try:
            return self._frame(rows)
        except ShapeError as error:
            return Rejected(0, self._time(rows), str(error))

    def _frame(self, rows: Rows) -> Frame:
        for row in rows if self.table.faults else ():
            if row in self.table.faults:
                raise ShapeError(self.table.faults[row])
        columns = self.table.columns
        if columns.timed and np.isnan(self.table.values[TIME][rows]).any():
            missing = rows[np.isnan(self.table.values[TIME][rows])][0]
            raise ShapeError(f"{self._where(missing)}: {TIME} is empty: write the time of the frame in s")
        index = self._index_of_points(rows)
        per_metre = PER_METRE[columns.unit]
        sensed = np.column_stack([self.table.values[axis][rows] for axis in columns.axes])
        sensed[np.isnan(sensed).any(axis=1)] = np.nan
        stations = None
        if columns.station:
            stations = _spread(self.table.values[columns.station][rows] / per_metre, index)
        measured = self._measured(rows)
        if columns.bend_unit is None:
            points = _spread(sensed / per_metre, index)
            directions = self._directions(rows, index)
            return Frame(points, self._time(rows), stations, directions=directions, **measured)
        bends = _spread(sensed * PER_METRE[columns.bend_unit], index)
        unknown = read_only(np.full((len(bends), 3), np.nan))
        return Frame(unknown, self._time(rows), stations, curvatures=bends, **measured)

    def _directions(self, rows: Rows, index: Rows) -> Points | None:
        if not self.table.columns.directions:
            return None
        sensed = np.column_stack([self.table.values[name][rows] for name in self.table.columns.directions])
        sensed[np.isnan(sensed).any(axis=1)] = np.nan
        return _spread(sensed, index)

    def _time(self, rows: Rows) -> float:
        return float(self.table.values[TIME][rows[0]]) if self.table.columns.timed else 0.0

    def _index_of_points(self, rows: Rows) -> Rows:
        """Return the index of each row in its frame; missing numbers are points that were not observed."""
        if not self.table.columns.numbered:
            return np.arange(len(rows))
        with np.errstate(invalid="ignore"):  # an infinite one is no whole number
            numbers = self.table.values[POINT][rows] - self.lowest
        good = (numbers >= 0) & (numbers <= MOST_POINTS) & (numbers == np.floor(numbers))
        if not good.all():
            where = self._where(rows[int(np.argmin(good))])
            raise ShapeError(f"{where}: point is no whole number from 0 to {MOST_POINTS}: number the points")
        again = np.flatnonzero(np.diff(numbers) == 0)
        if len(again):
            where = self._where(rows[int(again[0]) + 1])
            raise ShapeError(f"{where}: point {numbers[again[0]] + self.lowest:g} is there twice: keep one")
        return numbers.astype(np.int64)

    def _measured(self, rows: Rows) -> dict[str, Any]:
        """Return the measurements of the frame, in SI; a column of empty cells is none."""
        measured, machine = dict[str, Any](), dict[str, float]()
        for name in self.table.columns.measured:
            values = self.table.values[name][rows]
            known = values[~np.isnan(values)]
            if len(known) and (known != known[0]).any():
                other = float(known[known != known[0]][0])
                raise ShapeError(
                    f"{self._where(rows[0])}: {name} is {known[0]:g} and {other:g} in one frame: give one"
                )
            if len(known) and name in MEASURED:
                field, per_unit = MEASURED[name]
                measured[field] = float(known[0]) / per_unit
            elif len(known):
                machine[name] = float(known[0])
        return measured | ({"of_machine": of_machine(machine)} if machine else {})

    def _where(self, row: int) -> str:
        return f"{self.table.number_name} {self.table.number[row]}"


def _spread(values: Points | Vector, index: Rows) -> Points | Vector:
    """Return an array with the values at their indices and NaN at the others."""
    if index[-1] == len(index) - 1:
        return read_only(values)
    spread = np.full((int(index[-1]) + 1, *values.shape[1:]), np.nan)
    spread[index] = values
    return read_only(spread)
