"""What a worker of a batch does: one input, from its file to its tables, recording and part of the report."""

from __future__ import annotations

import shutil
import tempfile
import threading
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path

import msgspec
from threadpoolctl import threadpool_limits

from pipelines.drawing import write_shape_figures
from pipelines.surroundings import Surroundings, surroundings, tell_clearance
from pipelines.work import Options, Refusal, frame_refusals, guarded, one_line, useful
from pipelines.workers import tell
from tssgeom.errors import SpaceError, TssgeomError
from tssgeom.io.formats.files import open_recording
from tssgeom.io.formats.meshes import lumen_beside
from tssgeom.io.formats.recording import Recording
from tssgeom.io.results.ledger import ANY_SIZE, Done, forget, intact, key_of, note, noted
from tssgeom.io.results.result_tables import CHUNK, Part, part_of, parts, write_parts
from tssgeom.io.results.run_record import Input, Settings, sha256_of
from tssgeom.io.results.shapes import Analysis, analysis_object, summary_row
from tssgeom.io.storage import Folder, fetched, local
from tssgeom.stream import Frame, Rejected, alone, process
from tssgeom.summary import Account
from tssgeom.view.report.report import ReportEntry, rendered

_FORMAT = 2  # of the files: where it changes, nothing older is taken for done
_drawing = threading.Lock()  # the settings of a figure belong to the process

Spread = Callable[[Callable[..., Part], Iterator[tuple[object, ...]]], Iterator[Part]]


@dataclass(frozen=True, slots=True)
class Task:
    """One input of a batch, and all that a worker elsewhere needs to know."""

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
    chosen: Options
    settings: Settings
    version: str
    out: Folder
    figures: bool
    """Whether the report draws it."""
    printed: Folder | None = None
    """Where its figures for print go."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of an input: done, or refused for a reason."""

    done: Done | None
    reason: str = ""
    full: bool = False
    """No room was left where the results go."""
    unchanged: bool = False
    """It was done before, by a run with the same settings, and its files are still there."""


def work(task: Task, spread: Spread | None = None) -> Outcome:
    """Do one input, or find that it is done; whatever goes wrong stays with it."""
    try:
        with threadpool_limits(1), fetched(task.address) as path:
            try:
                return _worked(task, path, spread)
            except TssgeomError as error:
                reason = one_line(str(error)).replace(str(path), task.given)
                return Outcome(None, reason, full=isinstance(error, SpaceError))
    except TssgeomError as error:
        return Outcome(None, one_line(str(error)))
    except Exception as error:  # a mistake of ours must not take the other inputs down
        what = one_line(f"{type(error).__name__}: {error}")
        return Outcome(None, f"{task.given}: unexpected {what}: please report it with the file")


def _worked(task: Task, path: Path, spread: Spread | None) -> Outcome:
    digest = sha256_of(path)
    key = _key(task, digest)
    before = noted(task.out, task.name)
    if before is not None and before.key == key and _intact(task, before):
        return Outcome(before, unchanged=True)
    forget(task.out, task.name)
    done = _done(task, path, digest, key, spread)
    note(task.out, task.name, done)
    return Outcome(done)


def _intact(task: Task, done: Done) -> bool:
    figures = task.printed is None or intact(task.printed, done.figures)
    return intact(task.out, done.files) and figures


def _key(task: Task, digest: str) -> str:
    lumen = _lumen(task)
    parts_of_it = {
        "format": _FORMAT,
        "version": task.version,
        "settings": task.settings,
        "name": task.name,
        "source": task.source,
        "figures": task.figures,
        "printed": None if task.printed is None else task.printed.address,
        "sha256": digest,
        "lumen": None if lumen is None else sha256_of(lumen),
    }
    return key_of(msgspec.to_builtins(parts_of_it))


def _lumen(task: Task) -> Path | None:
    here = local(task.address)
    return task.chosen.lumen or (None if here is None else lumen_beside(here))


def _done(task: Task, path: Path, digest: str, key: str, spread: Spread | None) -> Done:
    name, out = task.name, task.out
    recording = open_recording(path, task.chosen.unit)
    account = Account.of(recording.frame_count)
    tables = (f"frames/{name}.parquet", f"segments/{name}.parquet")
    with out.replacing(tables[0]) as frames, out.replacing(tables[1]) as segments:
        write_parts(frames, segments, _parts(task, recording, account.stride, spread), account)
        analysis = useful(name, task.source, recording, account)
    told, row = analysis_object(analysis), summary_row(analysis)
    around, failures = _around(task, analysis)
    if around is not None:
        tell_clearance(told, row, analysis, around)
    lines = [line.replace(str(path), task.given) for line in frame_refusals(analysis, task.given)]
    files = list(tables)
    if task.settings.pictures:
        files, undrawn = _drawn(task, analysis, files, around)
        failures += undrawn
    figures = guarded(task.given, lambda: _printed(task, analysis))
    if isinstance(figures, Refusal):
        failures, figures = [*failures, figures.reason], dict[str, int]()
    report = _reported(task, analysis, drawn=len(files) > len(tables))
    return Done(
        key=key,
        input=_input(analysis, digest),
        row=row,
        told=told,
        lines=lines,
        failures=failures,
        report=report,
        files={file: ANY_SIZE if file.endswith(".rrd") else out.size(file) or 0 for file in files},
        figures=figures,
    )


def _parts(task: Task, recording: Recording, stride: int, spread: Spread | None) -> Iterator[Part]:
    """Analyse a recording chunk by chunk; where its frames stand alone, wherever there is a worker."""
    chosen, share = task.chosen, task.size / max(recording.frame_count, 1)
    if chosen.geometry_only:
        calls = _chunks(task.name, recording, stride, chosen, share)
        yield from spread(part_alone, calls) if spread else (part_alone(*call) for call in calls)
        return
    results = process(recording.frames, chosen.rig, tension_in=chosen.tension_in)
    for part in parts(task.name, results, stride):
        tell(part.account.frames, share * part.account.frames)
        yield part


def _chunks(
    name: str, recording: Recording, stride: int, chosen: Options, share: float
) -> Iterator[tuple[str, int, list[Frame | Rejected], int, Options, float]]:
    frames, first = iter(recording.frames), 0
    while chunk := list(islice(frames, CHUNK)):
        yield name, first, chunk, stride, chosen, share
        first += len(chunk)


def part_alone(
    name: str, first: int, frames: list[Frame | Rejected], stride: int, chosen: Options, share: float
) -> Part:
    """Analyse the frames of one chunk, each for itself; the fit starts anew with the chunk."""
    with threadpool_limits(1):
        results = alone(frames, chosen.rig, tension_in=chosen.tension_in, first=first)
        part = part_of(name, results, stride)
    tell(len(frames), share * len(frames))
    return part


def _input(analysis: Analysis, digest: str) -> Input:
    return Input(
        name=analysis.name,
        source=analysis.source,
        sha256=digest,
        kind=analysis.kind,
        unit=analysis.unit,
        frames=analysis.account.frames,
        rejected=analysis.account.refused,
    )


def _around(task: Task, analysis: Analysis) -> tuple[Surroundings | None, list[str]]:
    """Read the lumen around an input, where there is one; and return what went wrong."""
    here = local(task.address)
    if here is None:
        return None, []
    found = guarded(task.given, lambda: surroundings(here, analysis.unit, task.chosen))
    return (None, [found.reason]) if isinstance(found, Refusal) else (found, [])


def _drawn(
    task: Task, analysis: Analysis, files: list[str], around: Surroundings | None
) -> tuple[list[str], list[str]]:
    """Write the recording; return all files, and what went wrong."""
    file = f"recordings/{task.name}.rrd"
    failure = guarded(task.given, lambda: _draw(task, analysis, file, around))
    if failure is None:
        return [*files, file], []
    return files, [failure.reason]


def _draw(task: Task, analysis: Analysis, file: str, around: Surroundings | None) -> None:
    from tssgeom.view.scene.recording import (
        write_recording,  # here, since a worker that draws nothing starts faster
    )

    with task.out.replacing(file) as draft:
        write_recording(
            draft,
            analysis.name,
            analysis.results,
            timed=analysis.timed,
            lumen=None if around is None else around.mesh,
            clearance=None if around is None else around.sketch,
        )


def _printed(task: Task, analysis: Analysis) -> dict[str, int]:
    """Write the figures for print, and return their names and sizes."""
    if task.printed is None:
        return {}
    with tempfile.TemporaryDirectory() as here, _drawing:
        written = write_shape_figures(Path(here), task.name, analysis.results, timed=analysis.timed)
        for file in written:
            with task.printed.replacing(file) as draft:
                shutil.move(Path(here) / file, draft)
    return {file: task.printed.size(file) or 0 for file in written}


def _reported(task: Task, analysis: Analysis, *, drawn: bool) -> dict[str, object]:
    account = analysis.account
    entry = ReportEntry.of(
        analysis.name,
        account.results,
        timed=analysis.timed,
        rejected=account.rejected,
        recording=f"recordings/{task.name}.rrd" if drawn else "",
        used=account.used,
        rejected_frames=account.refused,
        warnings=account.warnings,
    )
    with _drawing:
        return asdict(rendered(entry, figures=task.figures))
