"""What commands share on their inputs: settings, one input at a time, and refusals."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import count, islice
from pathlib import Path
from typing import TypeVar

from msgspec.structs import replace as changed

from pipelines.left_out import column_map
from pipelines.options import TENSION_IN
from pipelines.terminal import print_message, sized_progress
from tssgeom.engine import alone, recorded
from tssgeom.errors import (
    SettingsError,
    ShapeError,
    SpaceError,
    TssgeomError,
    lacks_memory,
    on_one_line,
    out_of_memory,
    refused,
)
from tssgeom.io.formats.files import Recording, find_inputs, open_recording, output_names, real
from tssgeom.io.formats.laboratory.mapping import NO_MAP, ColumnMap
from tssgeom.io.formats.paths import size_of
from tssgeom.io.results.shapes import Analysis, frame_row, relative
from tssgeom.mechanism import Drive, End
from tssgeom.plausibility.frames import rig_remarks, unused_parts
from tssgeom.rig import Rig, read_uncertain_rig
from tssgeom.stream import Frame, FrameResult, Rejected
from tssgeom.summary import RunningSummary
from tssgeom.tendon.commander import Commander, carried_errors
from tssgeom.uncertain import UNKNOWNS, Uncertain, require_known

Done = TypeVar("Done")

ONE_TENDON = "[drive] and [end] are not used here: a tendon counts as one on the spring of [load]"
"""Note of commands on one tendon where the rig is that of a machine."""
MOST_REPORTED = 5
"""Rejected frames of one input with a line each; the others are counted. Chosen: they fit a terminal."""


@dataclass(frozen=True, slots=True)
class RunSettings:
    """What the user chose for a run."""

    rig: Rig
    rig_file: Path | None
    tension_in: float
    """Proximal tension for frames without one [N]."""
    unit: str | None
    lumen: Path | None
    geometry_only: bool = False
    """Whether each frame is the first pull of its tendon, whatever came before it."""
    tube_radius: float = 0.0
    """Radius of the tube along the route, for its clearance [m]."""
    columns: ColumnMap = NO_MAP
    """The user's statements on columns of tables."""
    uncertain: tuple[Uncertain, ...] = ()
    """What is not certain of the rig; commands and standard errors count it."""
    at: float | None = None
    """Time of the frame that represents a recording [s]; None: at the highest peak of T_in."""
    tension_in_given: bool = True
    """False where `tension_in` is the default."""

    @property
    def commander(self) -> Commander | None:
        """What carries one tendon with the errors of its rig; None where there are none."""
        return carried_errors(self.rig, self.uncertain)


@dataclass(frozen=True, slots=True)
class Refusal:
    """An input that could not be used."""

    source: str
    reason: str
    """One line that names the input."""


def run_settings(
    rig: Path | None,
    tension_in: float | None,
    unit: str | None,
    *,
    lumen: Path | None = None,
    geometry_only: bool = False,
    tube_mm: float | None = None,
    columns: Sequence[str] | None = None,
    at: float | None = None,
    may_be_uncertain: bool = False,
    takes_machines: bool = False,
) -> RunSettings:
    """Check what the user chose.

    Raises SettingsError where the rig file, the tension or the tube cannot be used.
    """
    given = tension_in is not None
    tension_in = TENSION_IN if tension_in is None else tension_in
    if not math.isfinite(tension_in) or tension_in < 0:
        raise SettingsError(f"--tension-in is {tension_in:g} N: give a finite tension >= 0 N")
    if at is not None and not math.isfinite(at):
        raise SettingsError(f"--at is {at} s: give the time of a frame")
    rig_read, uncertain = (Rig(), ()) if rig is None else read_uncertain_rig(rig)
    if rig is not None and not may_be_uncertain:
        require_known(rig, uncertain)
    if rig_read.is_machine and not takes_machines:
        print_message(f"{rig}: warning: {ONE_TENDON}")
    for text in (
        *unused_parts(rig_read, fitted=may_be_uncertain),
        *(each.text for each in rig_remarks(rig_read)),
    ):
        print_message(f"{rig}: warning: {text}")
    if tube_mm is not None and not 0 < tube_mm < math.inf:
        raise SettingsError(f"--tube-mm is {tube_mm:g} mm: give the outer diameter of the tube, > 0 mm")
    radius, said = 0.5e-3 * (tube_mm or 0.0), column_map(columns, rig_read.columns)
    options = (tension_in, unit, lumen, geometry_only, radius, said, uncertain, at, given)
    return RunSettings(rig_read, rig, *options)


def opened(path: Path, settings: RunSettings) -> Recording:
    """Open an input, and print how it was read where its names are not those of the formats.

    Raises ShapeError or SourceError where the file cannot be used.
    """
    recording = open_recording(path, settings.unit, settings.columns)
    print_reading(path, recording.notes, settings.columns)
    return recording


def print_reading(path: Path, notes: Sequence[str], columns: ColumnMap) -> None:
    """Print in one line how a file was read; once for files that are read alike."""
    if notes and (text := "; ".join(notes)) not in columns.reported:
        columns.reported.add(text)
        print_message(f"{path}: {text}")


def with_unknown_angle(settings: RunSettings, *, sensed: bool) -> RunSettings:
    """Return the settings with a route whose angle is unknown, of 1 m unless a length is given or sensed."""
    key, route = "route.angle_rad", settings.rig.route
    given = any(each.key == key for each in settings.uncertain)
    if not sensed and not route.length_m:
        print_message("the length of the route is not given: it counts as 1 m, for compliance too")
    added = () if given else (Uncertain(key, UNKNOWNS[key], stated=False),)
    angle = route.angle_rad if given else UNKNOWNS[key].centre
    route = changed(route, angle_rad=angle, length_m=route.length_m or (None if sensed else 1.0))
    return replace(settings, rig=changed(settings.rig, route=route), uncertain=(*settings.uncertain, *added))


def as_one_tendon(settings: RunSettings) -> RunSettings:
    """Return the settings of one tendon on the spring of `[load]`."""
    return replace(settings, rig=changed(settings.rig, drive=Drive(), end=End()))


def without_effects(settings: RunSettings) -> RunSettings:
    """Return the settings for the fit of a route, where tendons and what they pull do not matter."""
    return replace(settings, rig=changed(settings.rig, effects=(), drive=Drive(), end=End()))


def inputs_of(
    paths: Iterable[Path], besides: Collection[Path] = (), columns: ColumnMap = NO_MAP
) -> Iterator[Path | Refusal]:
    """Yield each file in files and folders once, and a refusal for a folder without shapes."""
    yielded = set[Path]()
    for path in paths:
        files = attempt(path, partial(find_inputs, [path], besides, columns))
        for item in [files] if isinstance(files, Refusal) else files:
            if isinstance(item, Refusal) or real(item) not in yielded:
                yield item
            if isinstance(item, Path):
                yielded.add(real(item))


def attempt(source: str | Path, work: Callable[[], Done]) -> Done | Refusal:
    """Do the work for one input; an error becomes the refusal of that input alone."""
    try:
        return work()
    except SpaceError:
        raise  # nothing else could be written either
    except TssgeomError as error:
        return Refusal(str(source), one_line(str(error)))
    except OSError as error:
        return Refusal(str(source), one_line(f"{source}: {refused(error)}"))
    except Exception as error:  # a mistake of ours must not take the other inputs down
        return Refusal(str(source), unexpected(source, error))


def analysis_of(
    name: str,
    path: Path,
    settings: RunSettings,
    step: Callable[[int, float], None] = lambda frames, size: None,
) -> Analysis:
    """Read and process one input.

    Parameters
    ----------
    name
        Name of its outputs.
    path
        The file.
    settings
        Rig, tension and unit.
    step
        Called after each frame with 1 and the share of the file that the frame is [B].

    Raises
    ------
    ShapeError, SourceError
        Where the file cannot be used, or none of its frames.
    """
    recording = opened(path, settings)
    running = RunningSummary.of(recording.frame_count, settings.at)
    share = size_of(path) / max(recording.frame_count, 1)
    processed = first_pulls if settings.geometry_only else recorded
    for item in processed(
        recording.frames, settings.rig, tension_in=settings.tension_in, commander=settings.commander
    ):
        running.add(item, frame_row(item))
        step(1, share)
    return require_used(name, relative(path), recording, running.close())


def require_used(name: str, source: str, recording: Recording, running: RunningSummary) -> Analysis:
    """Return the analysis of an input; raises ShapeError where none of its frames could be used."""
    if running.used:
        kind, timed = recording.kind, recording.timed
        return Analysis(name, source, recording.unit, kind, timed, running, recording.warnings)
    first = f"{running.rejected[0].reason}" if running.rejected else "it holds no frame"
    where = f"none of {running.frames} frames can be used; the first: " if running.frames > 1 else ""
    hints = "".join(f" ({warning})" for warning in recording.warnings)
    raise ShapeError(f"{recording.path}: {where}{first}{hints}")


def frame_refusals(analysis: Analysis, source: str) -> list[str]:
    """Return a line for each frame that was rejected; of many, the first few and a count."""
    return rejection_lines(source, analysis.summary.rejected, analysis.summary.refused)


def rejection_lines(source: str, rejected: Sequence[Rejected], count: int) -> list[str]:
    """Return a line for each of the first rejected frames, and one for the rest of their `count`."""
    lines = [f"{source}: frame {one.seq}: {one_line(one.reason)}" for one in rejected[:MOST_REPORTED]]
    more = count - len(lines)
    if more:
        lines.append(f"{source}: {more} more frames rejected: see tssgeom check --json")
    return lines


@dataclass(slots=True)
class Tally:
    """Counts of the inputs of a run by outcome."""

    done: int = 0
    frames_refused: int = 0
    refusals: list[Refusal] = field(default_factory=list)

    @property
    def status(self) -> int:
        """Exit status: 0 all done, 1 something was rejected and the rest done, 2 nothing done."""
        if not self.done:
            return 2
        return 1 if self.refusals or self.frames_refused else 0

    def refuse(self, refusal: Refusal) -> None:
        """Count a refusal, and print its reason."""
        print_message(refusal.reason)
        self.refusals.append(refusal)


def each_analysis(
    inputs: Sequence[Path | Refusal],
    settings: RunSettings,
    finish: Callable[[Analysis], None],
    *,
    quiet: bool,
) -> Tally:
    """Analyse input after input; an error is printed and counted, and stays with its input.

    Parameters
    ----------
    inputs
        Files, and folders and files that were refused before.
    settings
        Rig, tension and unit.
    finish
        Called with each analysis; where it fails, the analysis counts as done and the failure is printed.
    quiet
        Show no progress.
    """
    tally = Tally()
    names = output_names([item for item in inputs if isinstance(item, Path)])
    total = sum(size_of(item) for item in inputs if isinstance(item, Path))
    with sized_progress(len(inputs), total, quiet=quiet) as progress:
        for item in inputs:
            if isinstance(item, Refusal):
                tally.refuse(item)
            else:
                work = partial(analysis_of, names[item], item, settings, progress.advance)
                frames = _count(tally, item, attempt(item, work), finish)
                progress.end(str(item), frames, size_of(item))
    return tally


def _count(tally: Tally, path: Path, outcome: Analysis | Refusal, finish: Callable[[Analysis], None]) -> int:
    """Count an input, and return how many frames it had."""
    if isinstance(outcome, Refusal):
        tally.refuse(outcome)
        return 0
    tally.done += 1
    tally.frames_refused += outcome.summary.refused
    for line in frame_refusals(outcome, str(path)):
        print_message(line)
    if isinstance(failure := attempt(path, partial(finish, outcome)), Refusal):
        tally.refuse(failure)
    return outcome.summary.frames


def unexpected(source: str | Path, error: Exception) -> str:
    """Return the one line for an error that is a mistake of the program, or a lack of memory."""
    if lacks_memory(error):
        return f"{source}: {out_of_memory(error)}"
    return (
        f"{source}: unexpected {one_line(f'{type(error).__name__}: {error}')}: please report it with the file"
    )


def one_line(text: str) -> str:
    """Return a text without its line breaks, printable and no longer than a message."""
    return on_one_line(" ".join(text.split()))


def first_pulls(
    frames: Iterable[Frame | Rejected], rig: Rig, *, tension_in: float, commander: Commander | None = None
) -> Iterator[FrameResult | Rejected]:
    """Yield the result of each frame, chunk by chunk as `batch` shares them among its workers."""
    from tssgeom.io.results.tables import CHUNK

    frames = iter(frames)
    for first in count(0, CHUNK):
        chunk = list(islice(frames, CHUNK))
        if not chunk:
            return
        yield from alone(chunk, rig, tension_in=tension_in, first=first, commander=commander)
