"""`tssgeom discover`: the effects that the model of a rig lacks, identified from measured runs.

What it needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipelines import tssgeom_version
from pipelines.options import Figures, FigureStyle, Json, Map, Quiet, Unit
from pipelines.remarks import grouped
from pipelines.terminal import print_json, print_line, print_table, step_progress
from tssgeom.view.figures.style import choose

if TYPE_CHECKING:
    from tssgeom.identify.campaign import Campaign
    from tssgeom.identify.finding import Finding
    from tssgeom.identify.proposal import Asked
    from tssgeom.io.formats.laboratory.mapping import ColumnMap

PAGE, PICTURE = "report.html", "discover.rrd"
_MOST_EXPERIMENTS = 3  # chosen: experiments in the notes; the report has all
_READ, _IDENTIFIED = 0.03, 0.92  # share of the work done when the identification begins, and ends; chosen
_BASE = ("friction", "compliance_per_N")
_RUNS = {"held_out": "runs held out", "fitted": "fitted runs"}


def discover(
    campaign: Annotated[
        Path, typer.Argument(help="Folder with campaign.toml: measured runs and their shapes.")
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder for report, updated rig and recording.")],
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the simulated clean campaigns.")] = 0,
    unit: Unit = None,
    columns: Map = None,
    figures: Figures = None,
    style: FigureStyle = "light",
    propose: Annotated[
        int | None,
        typer.Option(
            "--propose",
            metavar="N",
            min=1,
            help="Design the next N runs, into OUT/proposed: drives and outcomes.",
        ),
    ] = None,
    limits: Annotated[
        list[str] | None,
        typer.Option(
            "--limits",
            metavar="KEY=VALUE …",
            help="What a proposed run stays within: tension_N, least_tension_N, speed_mm_per_s, travel_mm, "
            "duration_s; what is left out is as far as the runs of the campaign went.",
        ),
    ] = None,
    more: Annotated[
        list[Path] | None,
        typer.Option(
            "--with",
            metavar="FOLDER",
            help="Folder of new measured runs, added to the campaign's: named as those proposed, or listed "
            "in a campaign.toml with their shapes, as those of a machine are; may be repeated.",
        ),
    ] = None,
    with_errors: Annotated[
        bool,
        typer.Option(
            "--with-errors",
            help="Write what is fitted as { value, sd }, and what stays unexplained: commands count both.",
        ),
    ] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Find what the model lacks on measured runs, name it, put it into the rig, and show the misfit shrink.

    With --propose it designs what to measure next; --with adds what was measured, until the verdict stands.
    """
    from pipelines.left_out import column_map
    from tssgeom.errors import SettingsError
    from tssgeom.io.results.findings import report_object

    choose(style)
    if out.exists() and not out.is_dir():
        raise SettingsError(f"--out {out} is a file: name a folder")
    design = asked(propose, limits or ())
    check_folders(out, more or (), proposes=design is not None)
    with step_progress(quiet=quiet or as_json) as report_step:

        def identifying(step: str, share: float) -> None:
            report_step(step, _READ + share * (_IDENTIFIED - _READ))

        report_step("reading the campaign", 0.0)
        said, seeded = column_map(columns), (seed, more or (), design)
        finding = _identified(campaign, out, unit, said, seeded, identifying)
        report_step("writing the report", _IDENTIFIED)
        files = _write(out, finding, with_errors=with_errors)
        if figures is not None:
            _write_figures(figures, finding)
        report_step("done", 1.0)
    if as_json:
        print_json(report_object(finding, tssgeom_version()))
    elif not quiet:
        _print_table(finding, out, files)
    raise typer.Exit(0)


def _identified(
    campaign: Path,
    out: Path,
    unit: str | None,
    said: ColumnMap,
    how: tuple[int, Sequence[Path], Asked | None],
    report: Callable[[str, float], None],
) -> Finding:
    """Read a campaign and find what its model lacks, that of one tendon or of a machine.

    `how` is the seed, folders of new runs, and what is to be designed.
    """
    from tssgeom.io.formats.machine_campaigns import (
        is_machine_campaign,
        read_machine_campaign,
        with_machine_runs,
    )

    seed, more, design = how
    if is_machine_campaign(campaign, said):
        from tssgeom.identify.machine_discovery import discover_machine

        machine = read_machine_campaign(campaign, unit, said)
        for folder in more:
            machine = with_machine_runs(machine, folder, unit, said)
        return discover_machine(machine, progress=report, propose=design, seed=seed)
    from tssgeom.identify import workflow
    from tssgeom.io.formats.campaigns import read_campaign

    read = joined(read_campaign(campaign, unit, said), more, out, unit, said)
    return workflow.discover(read, seed=seed, progress=report, propose=design)


def _write(out: Path, finding: Finding, *, with_errors: bool) -> list[str]:
    """Write all files together, so that a report never stands beside the rig of another."""
    from tssgeom.atomic import replacing_all
    from tssgeom.io.results.findings import PROPOSED, write_proposal, write_report, write_updated_rig
    from tssgeom.view.report.finding import write_finding_report
    from tssgeom.view.scene.finding.recording import write_finding_recording

    with replacing_all(out) as draft:
        if finding.proposal is not None:
            with replacing_all(out / PROPOSED) as drives:
                write_proposal(drives, finding.proposal, tssgeom_version())
        write_report(draft, finding, tssgeom_version())
        write_updated_rig(draft, finding, tssgeom_version(), with_errors=with_errors)
        write_finding_report(draft / PAGE, finding)
        if not finding.is_machine:
            write_finding_recording(draft / PICTURE, finding)
        return sorted(path.name for path in draft.iterdir())


def _write_figures(folder: Path, finding: Finding) -> None:
    from pipelines.figures import write_figures
    from tssgeom.view.report.finding import figures_of

    write_figures(folder, finding.campaign.name, figures_of(finding))


def _print_table(finding: Finding, out: Path, files: Sequence[str]) -> None:
    from tssgeom.view import finding_wording as words

    judged = words.judged_runs(finding.misfit)
    title = (
        f"Measured less simulated, rms, on the {_RUNS[judged]}; “before” has friction and compliance refitted"
    )
    rows = []
    for name, before in finding.misfit.before[judged].items():
        channel = words.channel(name)
        numbers = (finding.misfit.noise[name], before, finding.misfit.after[judged][name])
        rows.append((channel.label, *(f"{channel.factor * number:.3g}" for number in numbers)))
    print_table(title, ("channel", "sensors", "before", "after"), rows, notes=_notes(finding))
    picture = f"; picture: tssgeom view {out / PICTURE}" if PICTURE in files else ""
    print_line(f"written to {out}: {', '.join(files)}{picture}")
    print_line(f"{words.VERDICTS[finding.verdict]}: {finding.sentence}")


def _notes(finding: Finding) -> list[str]:
    """Return ties, experiments that break them, the refitted base, and warnings on the data, a line each."""
    from tssgeom.view import finding_wording as words

    notes = [
        f"tied ({tie.gauge}): {', '.join(map(words.plain, tie.names))}: {tie.why}"
        for tie in words.effect_ties(finding)
    ]
    notes += [f"next: {step}" for step in words.next_steps(finding)[:_MOST_EXPERIMENTS]]
    notes += [f"proposed: {step}" for step in words.proposed_steps(finding)]
    notes += [
        f"{words.plain(name)}: {_in_rig_file(finding, name)} in the rig file, {each.value:.4g} refitted"
        for name, each in finding.base.items()
        if name in _BASE
    ]
    remarks = grouped((*finding.campaign.notes, *finding.notes), [run.name for run in finding.campaign.runs])
    return [*notes, *([finding.base_tie] if finding.base_tie else []), *(f"note: {one}" for one in remarks)]


def _in_rig_file(finding: Finding, name: str) -> str:
    return f"{finding.nominal[name]:.4g}" if name in finding.nominal else "unknown"


def asked(runs: int | None, limits: Sequence[str]) -> Asked | None:
    """Return how many experiments are asked for, and within which limits; None where none is.

    Raises SettingsError where a limit is no `key=value`, or no experiment is asked for.
    """
    from tssgeom.errors import SettingsError
    from tssgeom.identify.proposal import Asked

    words = [word for text in limits for word in text.replace(",", " ").split()]
    if runs is None:
        if words:
            raise SettingsError(f"--limits {words[0]}: it limits proposed runs: add --propose N")
        return None
    return Asked(runs, dict(_limit(word) for word in words))


def _limit(word: str) -> tuple[str, float]:
    from tssgeom.errors import SettingsError

    key, _, text = word.partition("=")
    try:
        return key, float(text)
    except ValueError as error:
        raise SettingsError(
            f'--limits {word}: give key=value, such as "tension_N=20 duration_s=60"'
        ) from error


def check_folders(out: Path, more: Sequence[Path], *, proposes: bool) -> None:
    """Refuse to write proposals over measured runs.

    Raises SettingsError where a folder of new runs is the one that proposals are written to.
    """
    from tssgeom.errors import SettingsError
    from tssgeom.io.results.findings import PROPOSED

    for folder in more:
        if proposes and folder.resolve() == (out / PROPOSED).resolve():
            raise SettingsError(
                f"--with {folder}: --propose would write over these runs: move them, or give another --out"
            )


def joined(
    campaign: Campaign, more: Sequence[Path], out: Path, unit: str | None, columns: ColumnMap
) -> Campaign:
    """Return a campaign with the new runs; `out` may hold the proposal that they follow.

    Raises SettingsError, ShapeError or SourceError where a folder has no run, or one cannot be used.
    """
    from tssgeom.io.formats.joined_campaigns import PROPOSAL, with_runs
    from tssgeom.io.results.findings import PROPOSED

    for folder in more:
        campaign = with_runs(campaign, folder, unit, columns, (out / PROPOSED / PROPOSAL,))
    return campaign
