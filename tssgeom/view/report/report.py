"""The report of a batch: one HTML page with a statement, a table and a figure for each input."""

from __future__ import annotations

import html
from collections import Counter
from collections.abc import Collection, Sequence
from pathlib import Path

from tssgeom.atomic import write_text
from tssgeom.effects import named
from tssgeom.rig import Rig
from tssgeom.view.report.entry import ReportEntry
from tssgeom.view.report.outlying_inputs import Oddity
from tssgeom.view.report.page import filled, program_version
from tssgeom.view.report.section import COLUMNS, Rendered, anchor, rendered

__all__ = ["Rendered", "ReportEntry", "rendered", "write_report"]


def write_report(
    path: Path,
    entries: Sequence[Rendered],
    *,
    rig: Rig,
    tension_in: float,
    odd: Sequence[Oddity] = (),
    notes: Sequence[str] = (),
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
    odd
        Inputs that stand out, the oddest first.
    notes
        What else is to be said at the head.
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
        statement=_statement(entries, rig, tension_in, notes),
        head="".join(f"<th><button>{html.escape(column)}</button></th>" for column in COLUMNS),
        rows="\n".join(entry.row for entry in entries),
        odd=_oddities(odd, entries),
        rejected=_rejections(entries),
        sections="\n".join(entry.section for entry in entries if entry.section),
    )
    write_text(path, page)


def _statement(entries: Sequence[Rendered], rig: Rig, tension_in: float, notes: Sequence[str]) -> str:
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
    said = "".join(f"<p>{html.escape(text)}</p>\n" for text in (_counts(entries), *notes))
    return f"{said}<dl>{lines}</dl>"


def _counts(entries: Sequence[Rendered]) -> str:
    kinds = Counter(entry.kind for entry in entries)
    used = _many(sum(entry.used for entry in entries), "frame")
    shapes, recordings = _many(kinds["shape"], "shape"), _many(kinds["recording"], "recording")
    return (
        f"{shapes} and {recordings} were analysed, {used} in all. {_rejected_count(entries, kinds['lost'])}"
    )


def _rejected_count(entries: Sequence[Rendered], lost: int) -> str:
    frames = sum(entry.refused for entry in entries if entry.kind != "lost")
    if frames + lost == 0:
        return "Nothing was rejected."
    what = [_many(count, noun) for count, noun in ((lost, "input"), (frames, "single frame")) if count]
    return f"Rejected, each with its reason below: {' and '.join(what)}."


def _many(count: int, noun: str) -> str:
    return f"{count} {noun}" + ("" if count == 1 else "s")


def _rejections(entries: Sequence[Rendered]) -> str:
    items = "".join(entry.rejections for entry in entries)
    return f"<h3>Rejected</h3>\n<ul>{items}</ul>" if items else ""


def _oddities(odd: Sequence[Oddity], entries: Sequence[Rendered]) -> str:
    drawn = {entry.name for entry in entries if entry.section}
    items = "".join(
        f"<li>{_name(each, drawn)}: {html.escape(each.words)} (z = {each.z:.0f})</li>" for each in odd
    )
    return f"<h3>Furthest from the others</h3>\n<ul>{items}</ul>" if items else ""


def _name(odd: Oddity, drawn: Collection[str]) -> str:
    name = html.escape(odd.name)
    return f'<a href="#{anchor(odd.name)}">{name}</a>' if odd.name in drawn else f"<b>{name}</b>"
