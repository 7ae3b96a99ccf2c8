"""`tssgeom batch`: every shape and recording in files and folders, to tables, recordings and a report."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path, PurePosixPath

import msgspec

from pipelines.analyse import as_text
from pipelines.batch_task import Outcome, Task, work
from pipelines.console import complain, say
from pipelines.progress import Progression, progressing
from pipelines.summary_table import show_summary
from pipelines.version import tssgeom_version
from pipelines.work import Options, Refusal, Tally, guarded, inputs_of
from pipelines.workers import Crew, Died, hired
from tssgeom.errors import SpaceError
from tssgeom.io.formats.files import READERS, RESULTS_MARK, output_names, real
from tssgeom.io.results.ledger import HIDDEN, Done, forget_all, locked
from tssgeom.io.results.result_tables import write_summary
from tssgeom.io.results.run_record import Rejection, RunRecord, Settings, remove_earlier_run, write_run
from tssgeom.io.results.shapes import relative
from tssgeom.io.storage import Folder, files_at, local
from tssgeom.view.report.outlying_inputs import OutlyingInput, outlying_inputs
from tssgeom.view.report.report import Rendered, ReportEntry, rendered, write_report

SUMMARY, REPORT = "summary.parquet", "report.html"
MOST_FIGURES = 200
"""The report draws so many inputs; of all others it has the numbers and the link to the recording."""

_FOLDERS = ("frames", "segments", "recordings", f"{HIDDEN}/done", ".")
_SPREAD = 4 << 20  # B: smaller inputs are one worker's work even where their frames stand alone
_WORTH = 4 << 20  # B of input that make one more worker worth its start


@dataclass(frozen=True, slots=True)
class How:
    """How a batch is to be done; the results do not depend on it, but for the pictures."""

    workers: int | None = None
    """Processes; as many as the work and the machine are worth where left out."""
    scheduler: str | None = None
    fresh: bool = False
    pictures: bool = True
    figures: str | None = None
    """Folder for figures for print."""


@dataclass(frozen=True, slots=True)
class Source:
    """A file to be analysed."""

    address: str
    given: str
    """As the user wrote it."""
    size: int


def run(inputs: Sequence[str], chosen: Options, how: How, *, out: str, as_json: bool, quiet: bool) -> int:
    """Analyse all inputs, write the results to `out`, and return the exit status.

    Raises
    ------
    SourceError
        Where the folder cannot be used; SpaceError where no room is left in it.
    SettingsError
        Where the scheduler cannot be reached.
    """
    folder = Folder.of(out)
    with locked(folder):
        sources, refusals = _found(inputs, folder)
        if how.fresh:
            forget_all(folder)
            remove_earlier_run(folder)
        folder.tidy(_FOLDERS)
        batch = Batch(folder, _tasks(sources, chosen, how, folder))
        try:
            batch.do(refusals, how, quiet=quiet)
            if batch.done:
                batch.conclude(chosen, how)
        finally:
            folder.tidy(_FOLDERS)
    if as_json:
        say(as_text([done.told for done in batch.finished], one_file=False))
    elif not quiet and batch.done:
        show_summary([done.row for done in batch.finished], chosen)
        _say_end(batch, out)
    return batch.tally.status


def _say_end(batch: Batch, out: str) -> None:
    for odd in batch.odd:
        say(f"stands out: {odd.name}: {odd.words} (z = {odd.z:.0f})")
    say(f"report: {out}/{REPORT}   picture: tssgeom view {out}")


def _found(inputs: Sequence[str], folder: Folder) -> tuple[list[Source], list[Refusal]]:
    """Return every file that is asked for once, and what could not be found."""
    sources, refusals, seen = list[Source](), list[Refusal](), set[str]()
    for given in inputs:
        found = guarded(given, partial(_sources, given, folder))
        for item in [found] if isinstance(found, Refusal) else found:
            if isinstance(item, Refusal):
                refusals.append(item)
            elif item.address not in seen:
                sources.append(item)
                seen.add(item.address)
    return sources, refusals


def _sources(given: str, folder: Folder) -> list[Source | Refusal]:
    path = local(given)
    if path is not None:
        besides = [] if folder.here is None else [folder.here]
        return [item if isinstance(item, Refusal) else _here(item) for item in inputs_of([path], besides)]
    found = files_at(given)
    results = {str(PurePosixPath(address).parent) for address, _ in found if address.endswith(RESULTS_MARK)}
    return [
        Source(address, address, size)
        for address, size in found
        if (len(found) == 1 or PurePosixPath(address).suffix.lower() in READERS)
        and not any(str(above) in results for above in PurePosixPath(address).parents)
    ] or [Refusal(given, f"{given}: no shape file there: put {', '.join(READERS)} files there")]


def _here(path: Path) -> Source:
    size = 0
    with suppress(OSError):
        size = path.stat().st_size
    return Source(str(real(path)), str(path), size)


def _tasks(sources: Sequence[Source], chosen: Options, how: How, out: Folder) -> list[Task]:
    names = output_names([Path(source.address) for source in sources])
    settings = _settings(chosen, how)
    return [
        Task(
            name=names[Path(source.address)],
            address=source.address,
            given=source.given,
            source=relative(source.address),
            size=source.size,
            chosen=chosen,
            settings=settings,
            version=tssgeom_version(),
            out=out,
            figures=how.pictures and number < MOST_FIGURES,
            printed=None if how.figures is None else Folder.of(how.figures),
        )
        for number, source in enumerate(sources)
    ]


def _settings(chosen: Options, how: How) -> Settings:
    return Settings(
        tension_in_N=chosen.tension_in,
        unit=chosen.unit,
        rig_file=None if chosen.rig_file is None else relative(chosen.rig_file),
        rig=chosen.rig,
        geometry_only=chosen.geometry_only,
        pictures=how.pictures,
        tube_radius_m=chosen.tube_radius,
    )


@dataclass(slots=True)
class Batch:
    """The inputs of a run in their order, and what became of them."""

    out: Folder
    tasks: Sequence[Task]
    done: dict[str, Done] = field(default_factory=dict)
    """By name."""
    refused: dict[str, str] = field(default_factory=dict)
    """Reasons, by name."""
    tally: Tally = field(default_factory=Tally)
    odd: Sequence[OutlyingInput] = ()

    @property
    def finished(self) -> list[Done]:
        """What is done, in the order of the inputs."""
        return [self.done[task.name] for task in self.tasks if task.name in self.done]

    def do(self, refusals: Sequence[Refusal], how: How, *, quiet: bool) -> None:
        """Do every input, and tell what goes wrong as it happens.

        Raises
        ------
        SpaceError
            Where no room is left; what is finished is noted, and the next run goes on from there.
        """
        for refusal in refusals:
            self.tally.refuse(refusal)
        total = sum(task.size for task in self.tasks)
        count = how.workers or _worth(self.tasks, total)
        with (
            progressing(len(self.tasks), total, quiet=quiet) as progress,
            hired(count, how.scheduler, progress.seen) as crew,
        ):
            for task, outcome in _outcomes(crew, self.tasks):
                self._take(task, outcome, progress)

    def _take(self, task: Task, outcome: Outcome | Died, progress: Progression) -> None:
        if isinstance(outcome, Died):
            outcome = Outcome(None, f"{task.given}: {outcome.reason}")
        if outcome.full:
            raise SpaceError(outcome.reason)
        if outcome.done is None:
            self.refused[task.name] = outcome.reason
            self.tally.refuse(Refusal(task.given, outcome.reason))
        else:
            self._count(task, outcome.done)
        frames = 0 if outcome.done is None else outcome.done.input.frames
        progress.end(task.given, frames, task.size, unchanged=outcome.unchanged)

    def _count(self, task: Task, done: Done) -> None:
        self.done[task.name] = done
        self.tally.done += 1
        self.tally.frames_refused += done.input.rejected
        for line in done.lines:
            complain(line)
        for failure in done.failures:
            self.tally.refuse(Refusal(task.given, failure))

    def conclude(self, chosen: Options, how: How) -> None:
        """Write the summary, the report and, last, the record of the run.

        Raises
        ------
        SourceError
            Where the disk refuses.
        """
        finished = self.finished
        self.odd = outlying_inputs([done.row for done in finished])
        with self.out.replacing(SUMMARY) as draft:
            write_summary(draft, (done.row for done in finished))
        with self.out.replacing(REPORT) as draft:
            rig, tension_in = chosen.rig, chosen.tension_in
            write_report(
                draft,
                list(self._rendered()),
                rig=rig,
                tension_in=tension_in,
                outlying=self.odd,
                notes=self._notes(chosen),
            )
        record = RunRecord(
            version=tssgeom_version(),
            settings=_settings(chosen, how),
            inputs=[done.input for done in finished],
            rejected=[Rejection(source=source, reason=reason) for source, reason in self._rejections()],
            files=[*(file for done in finished for file in done.files), SUMMARY, REPORT],
        )
        write_run(self.out, record)

    def _notes(self, chosen: Options) -> list[str]:
        notes = list[str]()
        if chosen.geometry_only:
            notes.append("Every frame stands alone: its tension is that of a first pull on its route.")
        if len(self.tasks) > MOST_FIGURES:
            notes.append(f"The first {MOST_FIGURES} inputs are drawn; of all there is a recording.")
        return notes

    def _rendered(self) -> Iterator[Rendered]:
        for task in self.tasks:
            if task.name in self.done:
                yield msgspec.convert(self.done[task.name].report, Rendered)
        for source, reason in self._rejections():
            yield rendered(ReportEntry.refused(source, reason))

    def _rejections(self) -> Iterator[tuple[str, str]]:
        """Yield source and reason, in the order of the inputs; what was not even found comes first."""
        known = {task.given for task in self.tasks}
        for refusal in self.tally.refusals:
            if refusal.source not in known:
                yield relative(refusal.source), refusal.reason
        for task in self.tasks:
            failures = self.done[task.name].failures if task.name in self.done else [self.refused[task.name]]
            for reason in failures:
                yield task.source, reason


def _worth(tasks: Sequence[Task], total: int) -> int:
    """Return how many processes are worth their start: one for every few megabytes of input."""
    most = len(tasks) if not any(_is_spread(task) for task in tasks) else 1 + total // _SPREAD
    return max(1, min(_cores(), most, 1 + total // _WORTH))


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _is_spread(task: Task) -> bool:
    return task.chosen.geometry_only and task.size > _SPREAD


def _outcomes(crew: Crew, tasks: Iterable[Task]) -> Iterator[tuple[Task, Outcome | Died]]:
    """Yield every task with what came of it: those for one worker first, then those that all share."""
    tasks = list(tasks)
    yield from crew.each(work, [task for task in tasks if not _is_spread(task)])
    for task in tasks:
        if _is_spread(task):
            yield task, work(task, crew.in_order)
