"""Tables that NDI's programs write of tracked tools: a row for each frame, the tools side by side.

Lengths are in mm. The quaternion of a tool is scalar-first and turns its own axes into the tracker's; so do
its Euler angles [deg], about x, then y, then z.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tssgeom.arrays import Matrix, Points, read_only
from tssgeom.errors import SettingsError, ShapeError, SourceError
from tssgeom.io.formats.laboratory.mapping import NO_MAP, ColumnMap
from tssgeom.io.formats.laboratory.wide import UNOBSERVED, has_row_a_tool
from tssgeom.io.formats.paths import LONGEST_LINE, reading, stem
from tssgeom.io.formats.recording import PER_METRE, UNTIMED, Frames, Recording, agreed_unit
from tssgeom.stream import Frame, Rejected

POSE = ("q0", "qx", "qy", "qz", "tx", "ty", "tz")
_EULER = ("rz", "ry", "rx", "tx", "ty", "tz")
_STATES = ("state", "transformstatus", "status")
_FARTHEST_MM = 1e6
"""Chosen: far outside the volume of a tracker; NDI writes -3.7e28 for no number."""
_FRAMES = ("frame", "frame#")
_MARKERS = ("markers", "#markers")
_SEPARATORS = (",", "\t", ";")
_BY_FRAME = "no time column: the frame numbers are taken as time, one a second"


@dataclass(frozen=True, slots=True)
class Layout:
    """Columns of a row of numbers, by their meaning."""

    tools: tuple[tuple[int, int | None], ...]
    """First column of the pose, and column of the state, of each tool that the header names."""
    seconds: int | None
    nanoseconds: int | None
    frame: int | None
    markers: int | None
    """Column with the number of markers, the last before the markers themselves."""
    width: int = len(POSE)
    """Columns of a pose."""
    separator: str = ","
    """Where it is no comma, numbers may have decimal commas."""

    def cells(self, line: str) -> list[str]:
        """Return the cells of a row, numbers with a decimal point."""
        cells = line.split(self.separator)
        return [cell if "." in cell else cell.replace(",", ".") for cell in cells]

    def columns(self, cells: Sequence[str]) -> list[tuple[int, int | None]]:
        """Return pose and state columns of each tool in a row.

        Where the header names one tool and the row holds several, they follow each other.
        """
        count = int(cells[0]) if cells[0].strip().isdecimal() else 1
        if len(self.tools) > 1 or self.markers is None or count < 2:
            return list(self.tools)
        pose, state = next(iter(self.tools))
        columns, shift = list[tuple[int, int | None]](), 0
        for _ in range(count):
            columns.append((pose + shift, None if state is None else state + shift))
            shift += self.markers + 4 * int(cells[self.markers + shift])
        return columns


def is_ndi(path: Path) -> bool:
    """Whether the first line of a table names poses side by side as NDI's programs do."""
    try:
        return _layout(_head(path)) is not None
    except SourceError:
        return False


@dataclass(frozen=True, slots=True)
class ToolFrames(Frames):
    """The frames of a table of tools, a row each."""

    path: Path
    layout: Layout
    sense: float
    """-1 where the third axes of the tools point from the distal to the proximal end, else 1."""

    def read(self) -> Iterator[Frame | Rejected]:
        """Yield the frames as the table holds them."""
        for seq, (number, line) in enumerate(_rows(self.path)):
            try:
                yield self._frame(seq, line)
            except (ValueError, IndexError) as error:
                yield Rejected(seq, 0.0, f"line {number}: {error}: mend the row, or leave it out")

    def _frame(self, seq: int, line: str) -> Frame:
        cells = self.layout.cells(line)
        points, axes = _sensed(cells, self.layout)
        time = _time(cells, self.layout)
        per_metre = PER_METRE["mm"]
        return Frame(
            read_only(points / per_metre),
            float(seq) if time is None else time,
            directions=read_only(self.sense * axes),
        )


def open_ndi(path: Path, unit: str | None, said: ColumnMap = NO_MAP) -> Recording:
    """Open a table of tracked tools.

    Raises SettingsError where `--map` names one of its columns; ShapeError where there is no pose in the
    header or no row, or where another unit is given; SourceError where the file cannot be read.
    """
    agreed = agreed_unit(path, "mm", unit, "")
    layout = _layout(_head(path))
    if layout is None:
        raise ShapeError(
            f"{path}: no columns {','.join(POSE)} in the header: save it from NDI's program anew"
        )
    named = [name for name in _names(_head(path), layout.separator) if name in said.options]
    if named:
        raise SettingsError(
            f"--map {named[0]!r}: {path} is a table of tracked tools, read by NDI's own names: leave it out, "
            "or name the columns of each point in the file, S1_x_mm and so on"
        )
    count, sense = _survey(path, layout)
    if not count:
        raise ShapeError(f"{path}: no row of tools: record at least one frame")
    warnings = () if layout.seconds is not None else (_BY_FRAME if layout.frame is not None else UNTIMED,)
    return Recording(
        stem(path), path, agreed, "ndi", count > 1, count, ToolFrames(path, layout, sense), warnings
    )


def _layout(header: bytes) -> Layout | None:
    for separator in _SEPARATORS:
        names = [name.lower() for name in _names(header, separator)]
        if (layout := _layout_of(names, separator)) is not None:
            return None if has_row_a_tool(names) else layout
    return None


def _names(header: bytes, separator: str) -> list[str]:
    text = header.decode("utf-8-sig", errors="replace")
    return [name.strip().strip('"') for name in text.split(separator)]


def _layout_of(names: Sequence[str], separator: str) -> Layout | None:
    """Return the layout of columns, named in small letters; None where no pose is among them."""
    width, poses = next(((len(pose), at) for pose in (POSE, _EULER) if (at := _starts(names, pose))), (0, []))
    if not poses:
        return None
    first, begins = poses[0], [0, *(k + width for k in poses[:-1])]
    return Layout(
        tuple(
            (pose, _before(names, begin, pose, _STATES)) for begin, pose in zip(begins, poses, strict=True)
        ),
        _before(names, 0, first, ("time [sec]", "time [s]", "timespec_s")),
        _before(names, 0, first, ("timespec_ns",)),
        _before(names, 0, first, _FRAMES),
        next((k for k in range(first, len(names)) if names[k] in _MARKERS), None),
        width,
        separator,
    )


def _starts(names: Sequence[str], pose: Sequence[str]) -> list[int]:
    return [k for k in range(len(names)) if tuple(names[k : k + len(pose)]) == pose]


def _before(names: Sequence[str], begin: int, end: int, wanted: Sequence[str]) -> int | None:
    """Return the last column from `begin` to before `end` with one of the wanted names."""
    return next((k for k in range(end - 1, begin - 1, -1) if names[k] in wanted), None)


def _sensed(cells: Sequence[str], layout: Layout) -> tuple[Points, Points]:
    """Return positions [mm] and third axes of the tools in a row, NaN for those that were not observed."""
    poses = np.array(
        [
            _pose(cells[at : at + layout.width], "" if state is None else cells[state], layout.width)
            for at, state in layout.columns(cells)
        ]
    )
    turned = poses[:, :-3]
    return poses[:, -3:], (_third_axes if layout.width == len(POSE) else _third_axes_by_angles)(turned)


def _pose(cells: Sequence[str], state: str, width: int) -> list[float]:
    unknown = [np.nan] * width
    if state.strip().lower() in UNOBSERVED or not any(cell.strip() for cell in cells):
        return unknown
    if len(cells) < width:
        raise ValueError(f"a tool has {len(cells)} of its {width} numbers")
    pose = [float(cell) for cell in cells]
    return pose if all(abs(number) < _FARTHEST_MM for number in pose) else unknown


def _third_axes(quaternions: Matrix) -> Points:
    """Turn the third axis by unit quaternions [n, 4], scalar first."""
    size = np.linalg.norm(quaternions, axis=1)
    w, x, y, z = np.where(size > 0, quaternions.T / np.where(size > 0, size, 1.0), np.nan)
    return np.column_stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])


def _third_axes_by_angles(angles: Matrix) -> Points:
    """Turn the third axis by Euler angles about z, y and x [n, 3] [deg]: R = Rz Ry Rx, as NDI has it."""
    (sz, sy, sx), (cz, cy, cx) = np.sin(np.radians(angles.T)), np.cos(np.radians(angles.T))
    return np.column_stack([cz * sy * cx + sz * sx, sz * sy * cx - cz * sx, cy * cx])


def _time(cells: Sequence[str], layout: Layout) -> float | None:
    """Return the time of a row [s]; without a clock, the number of its frame."""
    if layout.seconds is not None:
        fraction = 0.0 if layout.nanoseconds is None else 1e-9 * float(cells[layout.nanoseconds])
        return float(cells[layout.seconds]) + fraction
    return None if layout.frame is None else float(cells[layout.frame])


def _survey(path: Path, layout: Layout) -> tuple[int, float]:
    """Count the rows, and return the sense of the third axes in the first row that determines it."""
    count, along = 0, 0.0
    for _, line in _rows(path):
        count += 1
        if along == 0.0:
            along = _along(line, layout)
    return count, -1.0 if along < 0 else 1.0


def _along(line: str, layout: Layout) -> float:
    """Sum the third axes along the way to the next observed tool; 0 for a row that cannot be read."""
    try:
        points, axes = _sensed(layout.cells(line), layout)
    except (ValueError, IndexError):
        return 0.0
    observed = ~np.isnan(points).any(axis=1)
    return float(np.nansum(axes[observed][:-1] * np.diff(points[observed], axis=0)))


def _head(path: Path) -> bytes:
    with reading(path), path.open("rb") as file:
        return file.readline(LONGEST_LINE)


def _rows(path: Path) -> Iterator[tuple[int, str]]:
    """Yield number and text of each line below the header that is not blank."""
    with reading(path), path.open("rb") as file:
        file.readline(LONGEST_LINE)
        for number, line in enumerate(iter(lambda: file.readline(LONGEST_LINE), b""), start=2):
            if line.strip():
                yield number, line.decode("utf-8", errors="replace").strip("\r\n ")
