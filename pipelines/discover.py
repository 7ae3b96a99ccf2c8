"""`tssgeom discover`: what the model of a rig lacks, found in measured runs, named, and put into the rig."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from pipelines.console import say, show, stepping
from pipelines.drawing import write_figures
from pipelines.version import tssgeom_version
from tssgeom.atomic import replacing_all
from tssgeom.errors import SettingsError
from tssgeom.identify.finding import Finding
from tssgeom.identify.workflow import discover
from tssgeom.io.formats.campaigns import read_campaign
from tssgeom.io.results.findings import report_object, write_report, write_updated_rig

PAGE, PICTURE = "report.html", "discover.rrd"
_MOST_TOLD = 3
_FOUND, _READ = 0.92, 0.03  # share of the work that is done when the search has ended, and begins


def run(
    campaign: Path,
    *,
    out: Path,
    seed: int,
    unit: str | None,
    figures: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Find what is missing, write report, page, rig and recording, and return the exit status.

    Raises
    ------
    SettingsError, ShapeError, SourceError, FitError
        Where the campaign cannot be used or the disk refuses.
    """
    if out.exists() and not out.is_dir():
        raise SettingsError(f"--out {out} is a file: name a folder")
    with stepping(quiet=quiet or as_json) as tell:
        tell("reading the campaign", 0.0)
        given = read_campaign(campaign, unit)
        finding = discover(given, seed=seed, progress=lambda step, share: tell(step, _overall(share)))
        tell("writing the report", _FOUND)
        files = _write(out, finding)
        if figures is not None:
            from tssgeom.view.report.finding import figures_of

            write_figures(figures, finding.campaign.name, figures_of(finding))
        tell("done", 1.0)
    if as_json:
        report = report_object(finding, tssgeom_version())
        say(json.dumps(report, indent=1, ensure_ascii=False, allow_nan=False))
    elif not quiet:
        _tell(finding, out, files)
    return 0


def _overall(share: float) -> float:
    return _READ + share * (_FOUND - _READ)


def _write(out: Path, finding: Finding) -> list[str]:
    """Write all files together, so that a report never stands beside the rig of another."""
    from tssgeom.view.report.finding import write_finding_report
    from tssgeom.view.scene.finding.recording import write_finding_recording

    with replacing_all(out) as draft:
        write_report(draft, finding, tssgeom_version())
        write_updated_rig(draft, finding, tssgeom_version())
        write_finding_report(draft / PAGE, finding)
        write_finding_recording(draft / PICTURE, finding)
        return sorted(path.name for path in draft.iterdir())


def _tell(finding: Finding, out: Path, files: Sequence[str]) -> None:
    from tssgeom.view import finding_wording as words

    say(f"{words.VERDICTS[finding.verdict]}: {finding.sentence}")
    judged = words.judged_runs(finding.gap)
    title = (
        f"Measured less simulated, rms, on the {_RUNS[judged]}; “before” has friction and compliance refitted"
    )
    rows = []
    for name, before in finding.gap.before[judged].items():
        told = words.channel(name)
        numbers = (finding.gap.noise[name], before, finding.gap.after[judged][name])
        rows.append((told.label, *(f"{told.factor * number:.3g}" for number in numbers)))
    show(title, ("channel", "sensors", "before", "after"), rows, notes=_notes(finding))
    say(f"written to {out}: {', '.join(files)}; picture: tssgeom view {out / PICTURE}")


_RUNS = {"held_out": "runs held out", "fitted": "fitted runs"}


def _notes(finding: Finding) -> list[str]:
    """Return ties, what to measure, the refitted base, and what is odd about the data, a line each."""
    from tssgeom.view import finding_wording as words

    notes = [
        f"tied ({tie.gauge}): {', '.join(map(words.plain, tie.names))}: {tie.why}"
        for tie in words.effect_ties(finding)
    ]
    notes += [
        f"next: {each.experiment} (expected ΔBIC {words.expected(each)})"
        for each in finding.breaks_tie[:_MOST_TOLD]
    ]
    notes += [
        f"{words.plain(name)}: {finding.nominal[name]:.4g} in the rig file, {each.value:.4g} refitted"
        for name, each in finding.base.items()
        if name in finding.nominal
    ]
    odd = dict.fromkeys((*finding.campaign.notes, *finding.notes))
    return [*notes, *([finding.base_tie] if finding.base_tie else []), *(f"note: {note}" for note in odd)]
