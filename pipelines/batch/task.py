"""One input of a batch, from its file to its tables, recording and part of the report; done by a worker."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path

import msgspec

from pipelines.batch.workers import report_progress
from pipelines.figures import write_shape_figures
from pipelines.inputs import Refusal, RunSettings, attempt, frame_refusals, one_line, require_used, unexpected
from pipelines.lumen import SensedLumen, add_clearance, lumen_of
from tssgeom.atomic import temporary_folder
from tssgeom.engine import alone, recorded
from tssgeom.errors import SpaceError, TssgeomError, printable
from tssgeom.io.formats.files import open_recording
from tssgeom.io.formats.laboratory.mapping import FILE as COLUMNS_FILE
from tssgeom.io.formats.meshes import lumen_beside
from tssgeom.io.formats.recording import Recording
from tssgeom.io.results.csv_table import write_csv
from tssgeom.io.results.run_record import (
    ANY_SIZE,
    Done,
    Input,
    Settings,
    begin,
    intact,
    key_of,
    note,
    noted,
    sha256_of,
)
from tssgeom.io.results.shapes import Analysis, analysis_object, summary_row
from tssgeom.io.results.tables import CHUNK, Part, part_of, parts, write_parts
from tssgeom.io.storage import Folder, fetched, local
from tssgeom.stream import Frame, Rejected
from tssgeom.summary import RunningSummary
from tssgeom.tendon.machine_stream import columns_of
from tssgeom.threads import single_threaded
from tssgeom.view.figures.style import StyleName, choose
from tssgeom.view.report.report import ReportEntry, rendered

_FORMAT = 6  # version of the files; inputs done with another one are done anew
_figure_lock = threading.Lock()  # matplotlib holds the settings of a figure in the process

Share = Callable[[Callable[..., Part], Iterator[tuple[object, ...]]], Iterator[Part]]
"""Makes calls in several workers, and yields their results in order."""


@dataclass(frozen=True, slots=True)
class Task:
    """One input of a batch, and all that a worker on another machine needs."""

    name: str
    """Name of its outputs."""
    address: str
    """Where to read it."""
    given: str
    """As the user wrote it, for messages."""
    source: str
    """As the tables name it."""
    size: int
    """[B]."""
    settings: RunSettings
    recorded: Settings
    """The settings as `run.json` has them."""
    version: str
    out: Folder
    figures: bool
    """Whether the report draws it."""
    print_folder: Folder | None = None
    """Where its figures for print go."""
    style: StyleName = "light"
    """Of these figures."""
    csv: bool = False
    """Whether its tables are written as CSV too."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of an input: done, or refused for a reason."""

    done: Done | None
    reason: str = ""
    full: bool = False
    """The disk of the results is full."""
    unchanged: bool = False
    """An earlier batch did it with the same settings, and its files are still there."""


def work(task: Task, share: Share | None = None) -> Outcome:
    """Do one input, or skip it where it is done; an error stays with it."""
    try:
        with single_threaded(), fetched(task.address) as path:
            try:
                return _outcome(task, path, share)
            except TssgeomError as error:
                reason = one_line(str(error)).replace(printable(str(path)), task.given)
                return Outcome(None, reason, full=isinstance(error, SpaceError))
    except TssgeomError as error:
        return Outcome(None, one_line(str(error)))
    except Exception as error:  # a mistake of ours must not take the other inputs down
        return Outcome(None, unexpected(task.given, error))


def _outcome(task: Task, path: Path, share: Share | None) -> Outcome:
    digest = sha256_of(path)
    key = _key(task, digest)
    before = noted(task.out, task.name)
    if before is not None and before.key == key and _intact(task, before):
        return Outcome(before, unchanged=True)
    tables, texts = _tables(task)
    begin(task.out, task.name, [*tables, *texts, _picture(task)])
    done = _done(task, path, digest, key, share)
    note(task.out, task.name, done)
    return Outcome(done)


def _intact(task: Task, done: Done) -> bool:
    figures = task.print_folder is None or intact(task.print_folder, done.figures, {})
    return intact(task.out, done.files, done.sha256) and figures


def _key(task: Task, digest: str) -> str:
    lumen = _lumen_file(task)
    identity = {
        "format": _FORMAT,
        "version": task.version,
        "settings": task.recorded,
        "name": task.name,
        "source": task.source,
        "figures": task.figures,
        "csv": task.csv,
        "printed": None if task.print_folder is None else f"{task.print_folder.address} {task.style}",
        "sha256": digest,
        "lumen": None if lumen is None else sha256_of(lumen),
        "columns": _columns_beside(task),
    }
    return key_of(msgspec.to_builtins(identity))


def _lumen_file(task: Task) -> Path | None:
    path = local(task.address)
    return task.settings.lumen or (None if path is None else lumen_beside(path))


def _columns_beside(task: Task) -> str | None:
    """Return the digest of the file beside the data that describes its columns, where there is one."""
    path = local(task.address)
    beside = None if path is None else path.parent / COLUMNS_FILE
    return sha256_of(beside) if beside is not None and beside.is_file() else None


def _done(task: Task, path: Path, digest: str, key: str, share: Share | None) -> Done:
    name, out = task.name, task.out
    tables, texts = _tables(task)
    columns = task.settings.columns.anew()
    recording = open_recording(path, task.settings.unit, columns)
    running = RunningSummary.of(recording.frame_count)
    with out.replacing(tables[0]) as frames, out.replacing(tables[1]) as segments:
        upcoming = _parts(task, recording, running.stride, share)
        write_parts(frames, segments, upcoming, running, columns_of(task.settings.rig))
        analysis = require_used(name, task.source, recording, running)
        for table, text in zip((frames, segments), texts, strict=False):
            with out.replacing(text) as draft:
                write_csv(table, draft)
    report, row = analysis_object(analysis), summary_row(analysis)
    lumen, failures = _lumen(task, analysis)
    if lumen is not None:
        add_clearance(report, row, analysis, lumen)
    lines = [line.replace(printable(str(path)), task.given) for line in frame_refusals(analysis, task.given)]
    files = [*tables, *texts]
    if task.recorded.pictures:
        file = _picture(task)
        failure = attempt(task.given, lambda: _write_recording(task, analysis, file, lumen))
        files += [file] if failure is None else []
        failures += [] if failure is None else [failure.reason]
    figures = attempt(task.given, lambda: _write_print_figures(task, analysis))
    if isinstance(figures, Refusal):
        failures, figures = [*failures, figures.reason], dict[str, int]()
    entry = _report_entry(task, analysis, plotted=any(file.endswith(".rrd") for file in files))
    sizes = {file: ANY_SIZE if file.endswith(".rrd") else out.size(file) or 0 for file in files}
    return Done(
        key=key,
        input=_input(analysis, digest),
        row=row,
        printed=report,
        lines=lines,
        unused=sorted(columns.unused),
        reading=recording.notes,
        failures=failures,
        report=entry,
        files=sizes,
        sha256={file: out.sha256(file) or "" for file, size in sizes.items() if size != ANY_SIZE},
        figures=figures,
    )


def _tables(task: Task) -> tuple[tuple[str, str], list[str]]:
    """Return the files of frames and segments, and those of the same as CSV."""
    tables = (f"frames/{task.name}.parquet", f"segments/{task.name}.parquet")
    return tables, [str(Path(table).with_suffix(".csv").as_posix()) for table in tables] if task.csv else []


def _picture(task: Task) -> str:
    return f"recordings/{task.name}.rrd"


def _parts(task: Task, recording: Recording, stride: int, share: Share | None) -> Iterator[Part]:
    """Analyse a recording chunk by chunk; where its frames stand alone, workers may share them."""
    settings, frame_size = task.settings, task.size / max(recording.frame_count, 1)
    if settings.geometry_only:
        calls = _chunks(task.name, recording, stride, settings, frame_size)
        yield from share(part_alone, calls) if share else (part_alone(*call) for call in calls)
        return
    results = recorded(
        recording.frames, settings.rig, tension_in=settings.tension_in, commander=settings.commander
    )
    for part in parts(task.name, results, stride, columns_of(settings.rig)):
        report_progress(part.summary.frames, frame_size * part.summary.frames)
        yield part


def _chunks(
    name: str, recording: Recording, stride: int, settings: RunSettings, frame_size: float
) -> Iterator[tuple[str, int, list[Frame | Rejected], int, RunSettings, float]]:
    frames, first = iter(recording.frames), 0
    while chunk := list(islice(frames, CHUNK)):
        yield name, first, chunk, stride, settings, frame_size
        first += len(chunk)


def part_alone(
    name: str,
    first: int,
    frames: list[Frame | Rejected],
    stride: int,
    settings: RunSettings,
    frame_size: float,
) -> Part:
    """Analyse the frames of one chunk, each for itself; the fit starts anew with the chunk."""
    with single_threaded():
        tension_in, commander = settings.tension_in, settings.commander
        results = alone(frames, settings.rig, tension_in=tension_in, first=first, commander=commander)
        part = part_of(name, results, stride, columns_of(settings.rig))
    report_progress(len(frames), frame_size * len(frames))
    return part


def _input(analysis: Analysis, digest: str) -> Input:
    return Input(
        name=analysis.name,
        source=analysis.source,
        sha256=digest,
        kind=analysis.kind,
        unit=analysis.unit,
        frames=analysis.summary.frames,
        rejected=analysis.summary.refused,
    )


def _lumen(task: Task, analysis: Analysis) -> tuple[SensedLumen | None, list[str]]:
    """Read the lumen around an input, where there is one; return it and the errors."""
    path = local(task.address)
    if path is None:
        return None, []
    lumen = attempt(task.given, lambda: lumen_of(path, analysis.unit, task.settings))
    return (None, [lumen.reason]) if isinstance(lumen, Refusal) else (lumen, [])


def _write_recording(task: Task, analysis: Analysis, file: str, lumen: SensedLumen | None) -> None:
    from tssgeom.view.scene.recording import write_recording  # here: a worker without pictures starts faster

    with task.out.replacing(file) as draft:
        write_recording(
            draft,
            analysis.name,
            analysis.results,
            timed=analysis.timed,
            lumen=None if lumen is None else lumen.mesh,
            clearance=None if lumen is None else lumen.clearance_in_picture,
        )


def _write_print_figures(task: Task, analysis: Analysis) -> dict[str, int]:
    """Write the figures for print, and return their names and sizes."""
    if task.print_folder is None:
        return {}
    choose(task.style)
    with temporary_folder() as folder, _figure_lock:
        what = analysis.representative, analysis.results
        written = write_shape_figures(folder, task.name, *what, timed=analysis.timed)
        for file in written:
            with task.print_folder.replacing(file) as draft:
                shutil.move(folder / file, draft)
    return {file: task.print_folder.size(file) or 0 for file in written}


def _report_entry(task: Task, analysis: Analysis, *, plotted: bool) -> dict[str, object]:
    running = analysis.summary
    entry = ReportEntry.of(
        analysis.name,
        running.results,
        timed=analysis.timed,
        rejected=running.rejected,
        recording=_picture(task) if plotted else "",
        used=running.used,
        rejected_frames=running.refused,
        warnings=running.warnings,
    )
    return asdict(rendered(entry, figures=task.figures))
