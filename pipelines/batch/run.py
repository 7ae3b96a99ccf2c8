"""A batch: every shape and recording in files and folders, to tables, recordings and a report."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from pipelines import tssgeom_version
from pipelines.batch.sources import Source, left_out_of_batch, sources_of
from pipelines.batch.task import Outcome, Task, work
from pipelines.batch.workers import BatchLimits, WorkerLost, WorkerPool, worker_pool
from pipelines.inputs import Refusal, RunSettings, Tally, print_reading
from pipelines.left_out import left_out_text
from pipelines.summary_table import print_summary
from pipelines.terminal import SizedProgress, print_json, print_line, print_message, sized_progress
from tssgeom.errors import SpaceError
from tssgeom.io.formats.files import output_names
from tssgeom.io.results.csv_table import write_csv
from tssgeom.io.results.run_record import (
    HIDDEN,
    Done,
    Rejection,
    RunRecord,
    Settings,
    forget,
    forget_all,
    locked,
    remove_earlier_run,
    write_run,
)
from tssgeom.io.results.shapes import relative
from tssgeom.io.results.tables import write_summary
from tssgeom.io.storage import Folder
from tssgeom.view.figures.style import StyleName
from tssgeom.view.report.kinds import kinds
from tssgeom.view.report.outlying_inputs import OutlyingInput, outlying_inputs
from tssgeom.view.report.report import Rendered, ReportEntry, rendered, write_report

RESUMES = "stopped: the same command goes on with the inputs that are left"
SUMMARY, SUMMARY_CSV, REPORT = "summary.parquet", "summary.csv", "report.html"

_FOLDERS = ("frames", "segments", "recordings", f"{HIDDEN}/done", ".")


_LIMITS = BatchLimits()


@dataclass(frozen=True, slots=True)
class BatchOptions:
    """How a batch is done; the results do not depend on it, but for the pictures."""

    workers: int | None = None
    """Processes; None: as many as cores and inputs justify."""
    scheduler: str | None = None
    fresh: bool = False
    pictures: bool = True
    figures: str | None = None
    """Folder for figures for print."""
    csv: bool = False
    """Whether tables are written as CSV too."""
    style: StyleName = "light"
    """Of the figures for print."""


def run(
    inputs: Sequence[str],
    settings: RunSettings,
    options: BatchOptions,
    *,
    out: str,
    as_json: bool,
    quiet: bool,
) -> int:
    """Analyse all inputs, write the results to `out`, and return the exit status.

    Raises SourceError where the folder cannot be used; SpaceError where no room is left in it; SettingsError
    where the scheduler cannot be reached.
    """
    folder = Folder.of(out)
    with locked(folder):
        sources, refusals = sources_of(inputs, folder, settings.columns)
        if options.fresh:
            forget_all(folder)
            remove_earlier_run(folder)
        folder.tidy(_FOLDERS)
        left_out = left_out_of_batch(inputs, folder)
        batch = Batch(folder, _tasks(sources, settings, options, folder), left_out)
        try:
            batch.run(refusals, options, quiet=quiet)
            if batch.done:
                forget_all(folder, but={task.name for task in batch.tasks})
                batch.write_results(settings, options)
            elif batch.tasks:
                remove_earlier_run(folder)
        except KeyboardInterrupt:
            print_message(RESUMES)
            raise
        finally:
            folder.tidy(_FOLDERS)
    if as_json:
        print_json([done.printed for done in batch.finished])
    elif not quiet and batch.done:
        rows = [done.row for done in batch.finished]
        print_summary(rows, settings, list(batch.rejections()), _LIMITS.most_rows)
        _print_end(batch, options, out)
    return batch.tally.status


def _print_end(batch: Batch, options: BatchOptions, out: str) -> None:
    if batch.unchanged:
        done, total = batch.unchanged, len(batch.tasks)
        now = f"; {total - done} computed now" if done < total else ""
        print_line(
            f"{done} of {total} inputs were done before and are unchanged, skipped{now} (--fresh: all)"
        )
    if batch.left_out:
        print_line(left_out_text(batch.left_out))
    if len(several := kinds([done.row for done in batch.finished])) > 1:
        for kind in several[: _LIMITS.most_outlying]:
            print_line(f"kind: {kind.words}")
    for one in batch.outlying[: (most := _LIMITS.most_outlying)]:
        print_line(f"stands out: {one.name}: {one.words}")
    if len(batch.outlying) > most:
        print_line(f"stand out: {len(batch.outlying) - most} more inputs, all in the report")
    picture = f"   picture: tssgeom view {out}" if options.pictures else ""
    print_line(f"report: {out}/{REPORT}{picture}")


def _tasks(
    sources: Sequence[Source], settings: RunSettings, options: BatchOptions, out: Folder
) -> list[Task]:
    names = output_names([Path(source.address) for source in sources])
    recorded = _recorded_settings(settings, options)
    return [
        Task(
            name=names[Path(source.address)],
            address=source.address,
            given=source.given,
            source=relative(source.address),
            size=source.size,
            settings=settings,
            recorded=recorded,
            version=tssgeom_version(),
            out=out,
            figures=options.pictures and number < _LIMITS.most_figures,
            print_folder=None if options.figures is None else Folder.of(options.figures),
            style=options.style,
            csv=options.csv,
        )
        for number, source in enumerate(sources)
    ]


def _recorded_settings(settings: RunSettings, options: BatchOptions) -> Settings:
    return Settings(
        tension_in_N=settings.tension_in,
        unit=settings.unit,
        rig_file=None if settings.rig_file is None else relative(settings.rig_file),
        rig=settings.rig,
        geometry_only=settings.geometry_only,
        pictures=options.pictures,
        tube_radius_m=settings.tube_radius,
        columns=settings.columns.options,
    )


@dataclass(slots=True)
class Batch:
    """The inputs of a batch in their order, and the outcome of each."""

    out: Folder
    tasks: Sequence[Task]
    left_out: Mapping[str, int]
    """Files that no reader takes, by their endings."""
    done: dict[str, Done] = field(default_factory=dict)
    """By name."""
    refused: dict[str, str] = field(default_factory=dict)
    """Reasons, by name."""
    tally: Tally = field(default_factory=Tally)
    outlying: Sequence[OutlyingInput] = ()
    unchanged: int = 0
    """Inputs that an earlier run has done and that are as they were."""

    @property
    def finished(self) -> list[Done]:
        """What is done, in the order of the inputs."""
        return [self.done[task.name] for task in self.tasks if task.name in self.done]

    def run(self, refusals: Sequence[Refusal], options: BatchOptions, *, quiet: bool) -> None:
        """Do every input, and print errors as they happen.

        Raises SpaceError where the disk is full; finished inputs are noted, and the next run goes on from
        there.
        """
        if self.left_out:
            print_message(left_out_text(self.left_out))
        for refusal in refusals:
            self.tally.refuse(refusal)
        total = sum(task.size for task in self.tasks)
        count = options.workers or _worker_count(self.tasks, total)
        with (
            sized_progress(len(self.tasks), total, quiet=quiet) as progress,
            worker_pool(count, options.scheduler, progress.update) as pool,
        ):
            for task, outcome in _outcomes(pool, self.tasks):
                self._take(task, outcome, progress)

    def _take(self, task: Task, outcome: Outcome | WorkerLost, progress: SizedProgress) -> None:
        if isinstance(outcome, WorkerLost):
            outcome = Outcome(None, f"{task.given}: {outcome.reason}")
        if outcome.full:
            raise SpaceError(outcome.reason)
        if outcome.done is None:
            forget(self.out, task.name)
            self.refused[task.name] = outcome.reason
            self.tally.refuse(Refusal(task.given, outcome.reason))
        else:
            self._count(task, outcome.done)
            self.unchanged += outcome.unchanged
        frames = 0 if outcome.done is None else outcome.done.input.frames
        progress.end(task.given, frames, task.size, unchanged=outcome.unchanged)

    def _count(self, task: Task, done: Done) -> None:
        self.done[task.name] = done
        self.tally.done += 1
        self.tally.frames_refused += done.input.rejected
        print_reading(Path(task.given), done.reading, task.settings.columns)
        task.settings.columns.unused.intersection_update(done.unused)
        for line in done.lines:
            print_message(line)
        for failure in done.failures:
            self.tally.refuse(Refusal(task.given, failure))

    def write_results(self, settings: RunSettings, options: BatchOptions) -> None:
        """Write the summary, the report and, last, the record of the run.

        Raises SourceError where the disk refuses.
        """
        finished = self.finished
        self.outlying = outlying_inputs([done.row for done in finished])
        with self.out.replacing(SUMMARY) as draft:
            write_summary(draft, (done.row for done in finished))
            if options.csv:
                with self.out.replacing(SUMMARY_CSV) as text:
                    write_csv(draft, text)
        with self.out.replacing(REPORT) as draft:
            rig, tension_in = settings.rig, settings.tension_in
            write_report(
                draft,
                list(self._rendered()),
                rig=rig,
                tension_in=tension_in,
                summary=[done.row for done in finished],
                outlying=self.outlying,
                notes=self._notes(settings, options),
            )
        own = [SUMMARY, SUMMARY_CSV, REPORT] if options.csv else [SUMMARY, REPORT]
        record = RunRecord(
            version=tssgeom_version(),
            settings=_recorded_settings(settings, options),
            inputs=[done.input for done in finished],
            rejected=[Rejection(source=source, reason=reason) for source, reason in self.rejections()],
            files=[*(file for done in finished for file in done.files), *own],
            sha256={name: digest for done in finished for name, digest in done.sha256.items()}
            | {name: self.out.sha256(name) or "" for name in own},
            left_out=self.left_out,
        )
        write_run(self.out, record)

    def _notes(self, settings: RunSettings, options: BatchOptions) -> list[str]:
        notes = [f"{left_out_text(self.left_out)}."] if self.left_out else list[str]()
        if settings.geometry_only:
            notes.append("Every frame stands alone: its tension is that of a first pull on its route.")
        if not options.pictures:
            notes.append("No recordings or charts were asked for (--no-pictures).")
        elif len(self.tasks) > (most := _LIMITS.most_figures):
            notes.append(f"The first {most} inputs have charts here; each has a recording.")
        return notes

    def _rendered(self) -> Iterator[Rendered]:
        for task in self.tasks:
            if task.name in self.done:
                yield msgspec.convert(self.done[task.name].report, Rendered)
        for source, reason in self.rejections():
            yield rendered(ReportEntry.refused(source, reason))

    def rejections(self) -> Iterator[tuple[str, str]]:
        """Yield source and reason, in the order of the inputs; inputs that do not exist come first."""
        known = {task.given for task in self.tasks}
        for refusal in self.tally.refusals:
            if refusal.source not in known:
                yield relative(refusal.source), refusal.reason
        for task in self.tasks:
            failures = self.done[task.name].failures if task.name in self.done else [self.refused[task.name]]
            for reason in failures:
                yield task.source, reason


def _worker_count(tasks: Sequence[Task], total: int) -> int:
    """Return how many processes cores and input justify, by its size and by the pictures."""
    most = 1 + total // _LIMITS.worker_size if any(_is_shared(task) for task in tasks) else len(tasks)
    pictures = sum(task.recorded.pictures for task in tasks)
    justified = 1 + total // _LIMITS.worker_size + pictures // _LIMITS.worker_pictures
    return max(1, min(_cores(), most, justified))


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _is_shared(task: Task) -> bool:
    """Whether several workers share the frames of an input."""
    return task.settings.geometry_only and task.size > _LIMITS.worker_size


def _outcomes(pool: WorkerPool, tasks: Iterable[Task]) -> Iterator[tuple[Task, Outcome | WorkerLost]]:
    """Yield every task with its outcome: those for one worker first, then those that all share."""
    tasks = list(tasks)
    yield from pool.unordered(work, [task for task in tasks if not _is_shared(task)])
    for task in tasks:
        if _is_shared(task):
            yield task, work(task, pool.ordered)
