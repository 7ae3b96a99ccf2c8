"""The report of a batch: one HTML page with a statement, a table and a figure for each input."""

from __future__ import annotations

import html
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from tssgeom.settings import Rig
from tssgeom.tendon.effects import named
from tssgeom.view.page import filled, program_version, write_page
from tssgeom.view.report_entry import ReportEntry
from tssgeom.view.report_section import COLUMNS, row, section

__all__ = ["ReportEntry", "write_report"]


def write_report(
    path: Path,
    entries: Sequence[ReportEntry],
    *,
    rig: Rig,
    tension_in: float,
    title: str = "Tension along the sensed routes",
) -> None:
    """Write a page that needs nothing beside itself; an older one gives way only when it is done.

    Parameters
    ----------
    path
        The `.html` file.
    entries
        One for each input, in the order of the table.
    rig
        Tendon, friction and sensors that were used.
    tension_in
        Tension at the proximal end of frames that bring none [N].
    title
        Heading of the page.

    Raises
    ------
    SourceError
        Where the file cannot be written.
    """
    page = filled(
        "report.html",
        title=html.escape(title),
        statement=_statement(entries, rig, tension_in),
        head="".join(f"<th><button>{html.escape(column)}</button></th>" for column in COLUMNS),
        rows="\n".join(row(number, entry) for number, entry in enumerate(entries)),
        rejected=_rejections(entries),
        sections="\n".join(
            section(number, entry, entry.shown)
            for number, entry in enumerate(entries)
            if entry.shown is not None
        ),
    )
    write_page(path, page)


def _statement(entries: Sequence[ReportEntry], rig: Rig, tension_in: float) -> str:
    facts = {
        "Proximal tension": f"as recorded; T_in = {tension_in:g} N where an input brings none",
        "Friction": f"μ = {rig.friction.coefficient:g}",
        "Tendon": (
            f"compliance ρ = {rig.tendon.compliance_per_N:.3g} per N, "
            f"pretension T_0 = {rig.tendon.pretension_N:g} N"
        ),
        "Effects": named(rig.effects) or "none beside the base model",
        "Sensor noise": "estimated from the points"
        if rig.shape.noise_mm is None
        else f"{rig.shape.noise_mm:g} mm, as the rig says",
        "Program": f"tssgeom {program_version()}",
    }
    lines = "".join(f"<dt>{name}</dt><dd>{html.escape(text)}</dd>" for name, text in facts.items())
    return f"<p>{html.escape(_counts(entries))}</p>\n<dl>{lines}</dl>"


def _counts(entries: Sequence[ReportEntry]) -> str:
    runs = sum(entry.series is not None for entry in entries)
    lost = [entry for entry in entries if entry.shown is None]
    used = _many(sum(entry.used for entry in entries), "frame")
    shapes, recordings = _many(len(entries) - runs - len(lost), "shape"), _many(runs, "recording")
    return f"{shapes} and {recordings} were analysed, {used} in all. {_rejected_count(entries, len(lost))}"


def _rejected_count(entries: Sequence[ReportEntry], lost: int) -> str:
    frames = sum(len(entry.rejected) for entry in entries if entry.shown is not None)
    if frames + lost == 0:
        return "Nothing was rejected."
    what = [_many(count, noun) for count, noun in ((lost, "input"), (frames, "single frame")) if count]
    return f"Rejected, each with its reason below: {' and '.join(what)}."


def _many(count: int, noun: str) -> str:
    return f"{count} {noun}" + ("" if count == 1 else "s")


def _rejections(entries: Sequence[ReportEntry]) -> str:
    items = [item for entry in entries for item in _rejection_items(entry)]
    return f"<h3>Rejected</h3>\n<ul>{''.join(items)}</ul>" if items else ""


def _rejection_items(entry: ReportEntry) -> list[str]:
    reasons = Counter(each.reason for each in entry.rejected)
    first = {each.reason: each.seq for each in reversed(entry.rejected)}
    return [
        f"<li><b>{html.escape(entry.name)}</b>{_which(entry, count, first[reason])}: "
        f"{html.escape(reason)}</li>"
        for reason, count in reasons.items()
    ]


def _which(entry: ReportEntry, count: int, first: int) -> str:
    if entry.series is None:
        return ""
    return f", frame {first}" if count == 1 else f", {count} frames from frame {first}"
