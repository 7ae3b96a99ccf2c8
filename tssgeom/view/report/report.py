"""The report of a batch: one HTML page with a statement, a table, and figures for each input."""

from __future__ import annotations

import html
import math
import re
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from urllib.parse import quote

from tssgeom.atomic import write_text
from tssgeom.effects import named
from tssgeom.rig import Rig
from tssgeom.stream import FrameResult, Rejected
from tssgeom.view import wording as words
from tssgeom.view.report.entry import ReportEntry
from tssgeom.view.report.outlying_inputs import OutlyingInput
from tssgeom.view.report.page import filled, program_version
from tssgeom.view.samples import route_samples

_MOST_WARNINGS = 5
"""Number of different warnings of one input that are written out."""
_MOST_REASONS = 10
"""Number of different reasons of rejected frames of one input that are written out."""
_PER_INCH = 88  # pixels of a page for an inch of a figure: four columns of print fit side by side
_WIDEST = 1.2  # of a figure on the page, over its width in print: one alone in its row stays legible
COLUMNS = (
    "name",
    "frames",
    "rejected",
    "L [mm]",
    "Φ ± s.e. [°]",
    "pieces",
    "T_in [N]",
    "T_out [N]",
    "δ ± s.e. [mm]",
    "noise [mm]",
    "warnings",
    "in 3-D",
)


@dataclass(frozen=True, slots=True)
class Rendered:
    """The part of one input in the report, as HTML, and its counts for the statement at the head."""

    name: str
    kind: Literal["shape", "recording", "lost"]
    used: int
    refused: int
    row: str
    section: str
    """Empty where no figures are drawn."""
    rejections: str


def write_report(
    path: Path,
    entries: Sequence[Rendered],
    *,
    rig: Rig,
    tension_in: float,
    outlying: Sequence[OutlyingInput] = (),
    notes: Sequence[str] = (),
    title: str = "Tension along the sensed routes",
) -> None:
    """Write a self-contained page; an older one gives way only when it is done.

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
    outlying
        Inputs that differ from the others, the largest z first.
    notes
        Further paragraphs at the head.
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
        outlying=_outlying(outlying, entries),
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
    paragraphs = "".join(f"<p>{html.escape(text)}</p>\n" for text in (_counts(entries), *notes))
    return f"{paragraphs}<dl>{lines}</dl>"


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
    counts = [_many(count, noun) for count, noun in ((lost, "input"), (frames, "single frame")) if count]
    return f"Rejected, each with its reason below: {' and '.join(counts)}."


def _many(count: int, noun: str) -> str:
    return f"{count} {noun}" + ("" if count == 1 else "s")


def _rejections(entries: Sequence[Rendered]) -> str:
    items = "".join(entry.rejections for entry in entries)
    return f"<h3>Rejected</h3>\n<ul>{items}</ul>" if items else ""


def _outlying(inputs: Sequence[OutlyingInput], entries: Sequence[Rendered]) -> str:
    linked = {entry.name for entry in entries if entry.section}
    items = "".join(
        f"<li>{_name(each.name, linked)}: {html.escape(each.words)} (z = {each.z:.0f})</li>"
        for each in inputs
    )
    return f"<h3>Furthest from the others</h3>\n<ul>{items}</ul>" if items else ""


def _name(name: str, linked: Collection[str]) -> str:
    text = html.escape(name)
    return f'<a href="#{anchor(name)}">{text}</a>' if name in linked else f"<b>{text}</b>"


def rendered(entry: ReportEntry, *, figures: bool = True) -> Rendered:
    """Write the part of one input in the report; figures take most of the time and room."""
    result = entry.representative
    kind = "lost" if result is None else "shape" if entry.series is None else "recording"
    text = section(entry, result) if figures and result is not None else ""
    table_row = row(entry, linked=bool(text))
    rejections = "".join(_rejection_items(entry))
    return Rendered(entry.name, kind, entry.used, entry.rejected_frames, table_row, text, rejections)


def anchor(name: str) -> str:
    """Return the address of an input inside the page."""
    return f"input-{quote(name, safe='')}"


def row(entry: ReportEntry, *, linked: bool = True) -> str:
    """Write the row of an input in the table of all."""
    result = entry.representative
    if result is None:
        cells = [(entry.name, html.escape(entry.name)), *[("-1", "–")] * (len(COLUMNS) - 3)]
        return _cells([*cells, (1e9, '<span class="warning">rejected</span>'), ("", "–")])
    name = html.escape(entry.name)
    ends, arcs = result.transmission, result.arcs
    angle, angle_se = math.degrees(arcs.total_angle), math.degrees(arcs.total_angle_se)
    return _cells(
        [
            (entry.name, _link_to(f"#{anchor(entry.name)}", name) if linked else name),
            (entry.used, f"{entry.used}"),
            (entry.rejected_frames, _warned(entry.rejected_frames)),
            (arcs.total_length, f"{1e3 * arcs.total_length:.1f}"),
            (angle, words.with_error(angle, angle_se, 1)),
            (len(arcs.length), f"{len(arcs.length)}"),
            (ends.tension_in, f"{ends.tension_in:.2f}"),
            (ends.tension_out, f"{ends.tension_out:.2f}"),
            (ends.elongation, words.with_error(1e3 * ends.elongation, 1e3 * ends.elongation_se, 3)),
            (result.sensed_noise, html.escape(words.noise(result))),
            (len(entry.warnings), _warned(len(entry.warnings))),
            (entry.name, _link_to(quote(entry.recording), "recording") if entry.recording else "–"),
        ]
    )


def _link_to(address: str, text: str) -> str:
    return f'<a href="{address}">{text}</a>'


def _warned(count: int) -> str:
    return f'<span class="warning">{count}</span>' if count else "–"


def _cells(cells: Sequence[tuple[object, str]]) -> str:
    texts = (f'<td data-value="{html.escape(str(value))}">{text}</td>' for value, text in cells)
    return f"<tr>{''.join(texts)}</tr>"


def section(entry: ReportEntry, result: FrameResult) -> str:
    """Write text, figures and pieces of an input; those of one frame are of `result`."""
    moment = (
        f" at {result.frame.time:.2f} s, the last of its highest peaks of T_in"
        if entry.series is not None
        else ""
    )
    parts = [
        f'<section id="{anchor(entry.name)}">',
        f'<h2>{html.escape(entry.name)}<span class="soft">{moment}</span></h2>',
        *(_paragraph(sentence) for sentence in words.sentences(result)),
        *_warnings(entry),
        _figures(entry, result),
        _piece_table(result),
        _link(entry),
        "</section>",
    ]
    return "\n".join(part for part in parts if part)


def _figures(entry: ReportEntry, result: FrameResult) -> str:
    """Draw the figures, each as wide on the page as it is in print."""
    from tssgeom.view.figures.plots import markup
    from tssgeom.view.figures.shapes import figures_of  # here: a page of numbers alone needs no matplotlib

    drawings = [draw() for draw in figures_of(result, entry.series).values()]
    widths = [drawing.get_figwidth() for drawing in drawings]
    parts = [
        f'<figure style="flex: {width:.2f} 1 {_PER_INCH * width:.0f}px; '
        f'max-width: min(100%, {_WIDEST * _PER_INCH * width:.0f}px)">{markup(drawing)}</figure>'
        for width, drawing in zip(widths, drawings, strict=True)
    ]
    return f'<div class="figures">{"".join(parts)}</div>'


def _paragraph(text: str) -> str:
    """Turn a paragraph of our own markdown, in which only bold occurs, into HTML."""
    return "<p>" + re.sub(r"\*\*(.+?)\*\*", r"<b>\1</b>", html.escape(text)) + "</p>"


def _warnings(entry: ReportEntry) -> list[str]:
    lines = [f"⚠ {text}{_share(entry, count)}" for text, count in entry.warnings[:_MOST_WARNINGS]]
    if len(entry.warnings) > _MOST_WARNINGS:
        lines.append(f"⚠ and {len(entry.warnings) - _MOST_WARNINGS} other warnings in single frames")
    return [f'<p class="warning">{html.escape(line)}</p>' for line in lines]


def _share(entry: ReportEntry, count: int) -> str:
    return "" if entry.series is None else f" ({count} of {entry.used} frames)"


def _piece_table(result: FrameResult) -> str:
    head, _, *rows = words.piece_table(result.arcs, route_samples(result)).splitlines()
    body = "".join(f"<tr>{_markdown_cells(row, 'td')}</tr>" for row in rows)
    table = f"<table><thead><tr>{_markdown_cells(head, 'th')}</tr></thead><tbody>{body}</tbody></table>"
    return f"<details><summary>Pieces of constant curvature</summary>{table}</details>"


def _markdown_cells(row: str, tag: str) -> str:
    return "".join(f"<{tag}>{html.escape(cell.strip())}</{tag}>" for cell in row.strip("|").split("|"))


def _link(entry: ReportEntry) -> str:
    if not entry.recording:
        return ""
    address = html.escape(entry.recording)
    return (
        f'<p class="soft">In three dimensions: <a href="{quote(entry.recording)}">{address}</a> '
        f"(<code>tssgeom view {address}</code>)</p>"
    )


def _rejection_items(entry: ReportEntry) -> list[str]:
    """Write each reason once, with its first frame; of many different reasons, the first."""
    reasons = Counter(_reason(each) for each in entry.rejected)
    first = {_reason(each): each.seq for each in reversed(entry.rejected)}
    listed = list(reasons.items())[:_MOST_REASONS]
    rest = entry.rejected_frames - sum(count for _, count in listed)
    items = [f"{_which(entry, count, first[reason])}: {html.escape(reason)}" for reason, count in listed] + (
        [f", {rest} more frames"] if rest > 0 else []
    )
    return [f"<li><b>{html.escape(entry.name)}</b>{item}</li>" for item in items]


def _reason(rejected: Rejected) -> str:
    """Omit the line or row in the file, which differs for each frame."""
    return re.sub(r"^(line|row) \d+: ", "", rejected.reason)


def _which(entry: ReportEntry, count: int, first: int) -> str:
    if entry.series is None:
        return ""
    return f", frame {first}" if count == 1 else f", {count} frames from frame {first}"
