"""What the public calls accept for rigs, routes and runs: objects, columns, or the paths of their files."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import numpy as np
from msgspec.structs import replace as changed

from tssgeom.api.arguments import require_no_unit
from tssgeom.arrays import Vector
from tssgeom.engine import recorded
from tssgeom.errors import SettingsError, ShapeError, TssgeomError
from tssgeom.io.formats.files import open_recording
from tssgeom.io.formats.laboratory.mapping import ColumnMap
from tssgeom.io.formats.recording import Recording, in_order
from tssgeom.io.formats.runs import MeasuredRun, read_run, run_of_columns
from tssgeom.mechanism import Drive, End
from tssgeom.plausibility.rules import warnings_of
from tssgeom.plausibility.runs import run_remarks
from tssgeom.rig import Rig, read_rig, read_uncertain_rig
from tssgeom.route.pieces import Arcs
from tssgeom.stream import Frame, FrameResult, Rejected
from tssgeom.tendon.bars.model import setup_of
from tssgeom.tendon.bars.sensors import recorded_late
from tssgeom.tendon.commander import Commander, carried_errors
from tssgeom.tendon.machine import route_of_rig
from tssgeom.tendon.moving import MovingRoute
from tssgeom.uncertain import Uncertain, require_known

if TYPE_CHECKING:
    from tssgeom.tendon.simulation import Measured

_WORDS = (
    (re.compile(r"--unit mm\|m\|cm\|in\|…"), 'unit="mm" or unit="m" (cm, in, …)'),
    (re.compile(r"--unit\b"), "unit"),
    (re.compile(r'--map "([^"]*)"'), r"read(…, columns=['\1'])"),
    (re.compile(r"--map\b"), "columns of read"),
)
"""Options of the command line in messages, and what they are in Python."""


@contextmanager
def _python_words() -> Iterator[None]:
    """Name the parameters of Python, not options, in the errors of a `with` block."""
    try:
        yield
    except TssgeomError as error:
        text = str(error)
        for option, parameter in _WORDS:
            text = option.sub(parameter, text)
        error.args = (text, *error.args[1:])
        raise


class Table(Protocol):
    """Columns by name: a mapping of arrays, or a data frame of pandas or polars."""

    def __getitem__(self, name: Any, /) -> Any:
        """Return a column."""
        ...

    @property
    def columns(self) -> Any:
        """Names of the columns."""
        ...


RigGiven: TypeAlias = Rig | str | Path | None
ShapesGiven: TypeAlias = str | Path | Frame | FrameResult | Arcs | MovingRoute | None
RunGiven: TypeAlias = str | Path | MeasuredRun | Mapping[str, Any] | Table


def read(path: str | Path, unit: str | None = None, columns: Iterable[str] = ()) -> Recording:
    """Open a file of sensed shapes, of any format that `tssgeom` reads.

    Parameters
    ----------
    path
        A file, one recording of a file of several as `FILE#PART`, or the folder of a colonoscope recording or
        a ROS 2 bag.
    unit
        Unit of length, such as "mm" or "in", where the file states none.
    columns
        What columns of a table are, as `--map` has it: "NAME=channel[:unit]".

    Returns
    -------
    Recording
        A sequence of `Frame` in metres; a frame that cannot be read is a `Rejected` with the reason. Frames
        are read from the file when they are asked for, and anew at each pass.

    Raises
    ------
    ShapeError
        Where the file as a whole cannot be used: unit or columns missing or mixed, no points.
    SourceError
        Where the file cannot be read, or has an ending that no reader takes.
    SettingsError
        Where `columns` cannot be understood, or names a column that the file does not have.

    Notes
    -----
    Source: docs/formats.md, Shapes and recordings.

    Examples
    --------
    >>> import tssgeom
    >>> frames = tssgeom.read("sample_shapes/half_circle.csv")
    >>> len(frames), frames[0].points.shape
    (1, (101, 3))
    """
    said = ColumnMap(columns)
    with _python_words():
        recording = open_recording(path, unit, said)
        if said.unused:
            raise SettingsError(
                f"{path}: columns: no column {sorted(said.unused)[0]!r} in the file: mend the name"
            )
    return recording


def last_result(
    recording: Recording, rig: Rig | None, tension_in: float, commander: Commander | None = None
) -> FrameResult:
    """Carry a tendon through a recording, and return the result of the last frame that can be used.

    Raises
    ------
    ShapeError
        Where none can be.
    """
    with _python_words():
        return _last_result(recording, rig, tension_in, commander)


def _last_result(
    recording: Recording, rig: Rig | None, tension_in: float, commander: Commander | None
) -> FrameResult:
    last, first = None, "it holds no frame"
    for item in recorded(recording.frames, rig or Rig(), tension_in=tension_in, commander=commander):
        if isinstance(item, FrameResult):
            last = item
        elif last is None and item.seq == 0:
            first = item.reason
    if last is None:
        raise ShapeError(f"{recording.path}: no frame can be used; the first: {first}")
    return replace(last, warnings=(*recording.warnings, *last.warnings))


def rig_of(rig: RigGiven) -> Rig:
    """Return a rig, read from its file where a path is given, the paper's where nothing is; as `read_rig`."""
    if rig is None:
        return Rig()
    return rig if isinstance(rig, Rig) else read_rig(rig)


def carried_rig_of(rig: RigGiven) -> tuple[Rig, Commander | None]:
    """Return a rig, and what carries its tendon where its file gives errors of its numbers."""
    known, uncertain = uncertain_rig_of(rig)
    return known, carried_errors(known, uncertain)


def uncertain_rig_of(rig: RigGiven, *, may_be_unknown: bool = False) -> tuple[Rig, tuple[Uncertain, ...]]:
    """Return a rig as `rig_of` does, and what of it is not certain; errors as `read_rig`."""
    if rig is None or isinstance(rig, Rig):
        return rig_of(rig), ()
    known, uncertain = read_uncertain_rig(rig)
    if not may_be_unknown:
        require_known(rig, uncertain)
    return known, uncertain


@dataclass(frozen=True, slots=True)
class SensedFrames:
    """The routes of a shape, or of a recording over time."""

    name: str
    results: tuple[FrameResult, ...]
    rejected: tuple[Rejected, ...]
    """Frames that could not be used."""

    @property
    def route(self) -> MovingRoute:
        """The route at any time."""
        times = np.array([result.frame.time for result in self.results])
        return MovingRoute(times, [result.arcs for result in self.results])

    def nearest(self, time: float) -> FrameResult:
        """Return the frame nearest to a time [s]."""
        times = np.array([result.frame.time for result in self.results])
        return self.results[int(np.argmin(np.abs(times - time)))]


def sensed_frames(recording: Recording, rig: Rig) -> SensedFrames:
    """Fit the route of every frame of a recording; its drives do not count.

    Raises
    ------
    ShapeError
        Where no frame can be used.
    """
    plain = changed(rig, effects=(), drive=Drive(), end=End())
    shapes = in_order(_without_drives(recording.frames))  # anew: a frame may be usable without its drive
    items = list(recorded(shapes, plain, tension_in=rig.tendon.pretension_N))
    rejected = tuple(item for item in items if isinstance(item, Rejected))
    results = tuple(item for item in items if isinstance(item, FrameResult))
    if not results:
        reason = rejected[0].reason if rejected else "it holds no frame"
        raise ShapeError(f"{recording.path}: no frame can be used; the first: {reason}")
    return SensedFrames(recording.name, results, rejected)


_NO_DRIVE = dict.fromkeys(
    ("tension_in", "displacement_in", "displacement_target", "tension_out_target", "of_machine")
)


def _without_drives(frames: Iterable[Frame | Rejected]) -> Iterator[Frame | Rejected]:
    """Yield the frames without their drives: the run brings its own."""
    for frame in frames:
        yield frame if isinstance(frame, Rejected) else replace(frame, **_NO_DRIVE)


def route_of(shapes: ShapesGiven, rig: Rig, unit: str | None = None) -> MovingRoute:
    """Return the route over time of what was given for it; of the rig where nothing is.

    Raises
    ------
    ShapeError, SourceError, FitError
        Where the file or its frames cannot be used.
    SettingsError
        Where nothing is given, by the rig neither.
    """
    if not isinstance(shapes, str | Path):
        require_no_unit(unit, f"a {type(shapes).__name__}")
    if shapes is None:
        return route_of(route_of_rig(rig), rig)
    if isinstance(shapes, MovingRoute):
        return shapes
    if isinstance(shapes, Arcs):
        return MovingRoute(np.array([0.0]), [shapes])
    if isinstance(shapes, FrameResult):
        return MovingRoute(np.array([shapes.frame.time]), [shapes.arcs])
    if isinstance(shapes, Frame):
        from tssgeom.analysis import analyse

        return route_of(analyse(replace(shapes, **_NO_DRIVE), changed(rig, effects=())), rig)
    return sensed_frames(read(shapes, unit), rig).route


def run_of(run: RunGiven, rig: Rig) -> MeasuredRun:
    """Return a measured run of its columns, or from its file; errors as `read_run` has them."""
    if isinstance(run, MeasuredRun):
        return run
    if isinstance(run, str | Path):
        return read_run(Path(run), ColumnMap((), rig.columns))
    names = run.keys() if isinstance(run, Mapping) else run.columns
    return run_of_columns({name: run[name] for name in names})


def warnings_of_run(run: MeasuredRun, rig: Rig, route: MovingRoute, *, fitted: bool) -> tuple[str, ...]:
    """Return what is implausible in a run on the longest of its routes.

    Raises
    ------
    SettingsError
        Where a rule refuses the run; docs/checks.md.
    """
    arcs = max(route.arcs, key=lambda each: each.total_length)
    remarks = run_remarks(run.columns, rig, length=arcs.total_length, angle=arcs.total_angle, fitted=fitted)
    return (*run.warnings, *warnings_of(run.path, remarks))


def temperature_of(run: MeasuredRun, rig: Rig) -> Vector | None:
    """Return the temperature of a run where an effect of the rig needs it [°C].

    Raises
    ------
    SettingsError
        Where the column lacks a sample.
    """
    if run.temperature is None or not any("temperature_C" in effect.needs for effect in rig.effects):
        return None
    return run.channel(("temperature_C",))[1]


def measured_of(run: MeasuredRun, rig: Rig) -> Measured:
    """Return the columns of a run as `calibrate` takes them; docs/model.md (353)."""
    from tssgeom.tendon.simulation import Measured

    elongation = run.elongation
    if elongation is None and run.displacement_in is not None and run.displacement_out is not None:
        delay = setup_of(rig).distal_delay_s  # an elongation is late as a whole
        elongation = recorded_late(run.time, run.displacement_in, delay) - run.displacement_out  # (44)
    return Measured(
        run.time, run.tension_in, run.displacement_in, run.tension_out, elongation, run.temperature
    )
