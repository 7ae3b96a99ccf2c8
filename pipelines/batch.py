"""`tssgeom batch`: every shape and recording in files and folders, to tables, recordings and a report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from pipelines.analyse import as_text
from pipelines.console import say
from pipelines.summary_table import show_summary
from pipelines.version import tssgeom_version
from pipelines.work import Options, Refusal, Tally, each_analysis, guarded, inputs_of, lumen_of
from tssgeom.io.result_tables import write_frames, write_summary
from tssgeom.io.results import Analysis, analysis_object, relative, summary_row
from tssgeom.io.run_record import (
    Input,
    Rejection,
    RunRecord,
    Settings,
    remove_earlier_run,
    sha256_of,
    write_run,
)
from tssgeom.view.report import ReportEntry, write_report
from tssgeom.view.rerun_log import write_recording

SUMMARY, REPORT = "summary.parquet", "report.html"


def run(paths: Sequence[Path], chosen: Options, *, out: Path, fresh: bool, as_json: bool, quiet: bool) -> int:
    """Analyse all inputs, write the results to `out`, and return the exit status."""
    results = Results(out, chosen)
    found = list(inputs_of(paths, besides=[out]))
    if fresh:
        remove_earlier_run(out)
    tally = each_analysis(found, chosen, results.finish, quiet=quiet)
    if tally.done:
        results.conclude(tally)
    if as_json:
        say(as_text(results.objects, one_file=False))
    elif not quiet and results.rows:
        show_summary(results.rows, chosen)
        say(f"report: {out / REPORT}   picture: tssgeom view {out}")
    return tally.status


@dataclass(slots=True)
class Results:
    """What a batch has written so far, each file whole."""

    out: Path
    chosen: Options
    rows: list[dict[str, Any]] = field(default_factory=list)
    objects: list[dict[str, Any]] = field(default_factory=list)
    inputs: list[Input] = field(default_factory=list)
    files: list[str] = field(default_factory=list)
    entries: list[ReportEntry] = field(default_factory=list)

    def finish(self, analysis: Analysis) -> None:
        """Write the table and the recording of one input.

        Raises
        ------
        ShapeError, SourceError
            Where the mesh around the route cannot be read or the disk refuses.
        """
        self.rows.append(summary_row(analysis))
        self.objects.append(analysis_object(analysis))
        self.inputs.append(_input(analysis))
        write_frames(self._file(f"frames/{analysis.name}.parquet"), analysis)
        recording = f"recordings/{analysis.name}.rrd"
        self.entries.append(
            ReportEntry.of(
                analysis.name,
                analysis.results,
                timed=analysis.timed,
                rejected=analysis.rejected,
                recording=recording,
            )
        )
        self._draw(analysis, self._file(recording))

    def _draw(self, analysis: Analysis, path: Path) -> None:
        lumen = lumen_of(analysis.source, analysis.unit, self.chosen)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_recording(path, analysis.name, analysis.results, timed=analysis.timed, lumen=lumen)

    def conclude(self, tally: Tally) -> None:
        """Write the summary, the report and, last, the record of the run."""
        write_summary(self._file(SUMMARY), self.rows)
        report = self._file(REPORT)
        if isinstance(failure := guarded(report, partial(self._report, report, tally)), Refusal):
            tally.refuse(failure)
        rejected = [Rejection(source=relative(item.source), reason=item.reason) for item in tally.refusals]
        record = RunRecord(
            version=tssgeom_version(),
            settings=_settings(self.chosen),
            inputs=self.inputs,
            rejected=rejected,
            files=self.files,
        )
        write_run(self.out, record)

    def _report(self, path: Path, tally: Tally) -> None:
        refused = [ReportEntry.refused(relative(item.source), item.reason) for item in tally.refusals]
        chosen = self.chosen
        write_report(path, [*self.entries, *refused], rig=chosen.rig, tension_in=chosen.tension_in)

    def _file(self, name: str) -> Path:
        self.files.append(name)
        return self.out / name


def _input(analysis: Analysis) -> Input:
    return Input(
        name=analysis.name,
        source=relative(analysis.source),
        sha256=sha256_of(analysis.source),
        kind=analysis.kind,
        unit=analysis.unit,
        frames=len(analysis.items),
        rejected=len(analysis.rejected),
    )


def _settings(chosen: Options) -> Settings:
    return Settings(
        tension_in_N=chosen.tension_in,
        unit=chosen.unit,
        rig_file=None if chosen.rig_file is None else relative(chosen.rig_file),
        rig=chosen.rig,
    )
