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
from tssgeom.view.report.outlying_inputs import Oddity
from tssgeom.view.report.page import filled, program_version
from tssgeom.view.samples import route_samples

_MOST_WARNINGS = 5
"""So many different warnings of one input are written out."""
_MOST_REASONS = 10
"""So many different reasons of rejected frames of one input are written out."""
_PER_INCH = 88  # pixels of a page for an inch of a figure: four columns of print stand side by side
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
    """The part of one input in the report, as HTML, and what the statement at the head counts."""

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


def rendered(entry: ReportEntry, *, figures: bool = True) -> Rendered:
    """Write everything that the report says of one input; figures take most of the time and room."""
    drawn = figures and entry.shown is not None
    kind = "lost" if entry.shown is None else "shape" if entry.series is None else "recording"
    text = section(entry, entry.shown) if figures and entry.shown is not None else ""
    told = "".join(_rejection_items(entry))
    return Rendered(entry.name, kind, entry.used, entry.lost, row(entry, linked=drawn), text, told)


def anchor(name: str) -> str:
    """Return the place of an input on the page."""
    return f"input-{quote(name, safe='')}"


def row(entry: ReportEntry, *, linked: bool = True) -> str:
    """Write the row of an input in the table of all."""
    shown = entry.shown
    if shown is None:
        cells = [(entry.name, html.escape(entry.name)), *[("-1", "–")] * (len(COLUMNS) - 3)]
        return _cells([*cells, (1e9, '<span class="warning">rejected</span>'), ("", "–")])
    name = html.escape(entry.name)
    seen, arcs = shown.transmission, shown.arcs
    angle, angle_se = math.degrees(arcs.total_angle), math.degrees(arcs.total_angle_se)
    return _cells(
        [
            (entry.name, _link_to(f"#{anchor(entry.name)}", name) if linked else name),
            (entry.used, f"{entry.used}"),
            (entry.lost, _warned(entry.lost)),
            (arcs.total_length, f"{1e3 * arcs.total_length:.1f}"),
            (angle, words.with_error(angle, angle_se, 1)),
            (len(arcs.length), f"{len(arcs.length)}"),
            (seen.tension_in, f"{seen.tension_in:.2f}"),
            (seen.tension_out, f"{seen.tension_out:.2f}"),
            (seen.elongation, words.with_error(1e3 * seen.elongation, 1e3 * seen.elongation_se, 3)),
            (shown.route.noise, html.escape(words.noise(shown))),
            (len(entry.warnings), _warned(len(entry.warnings))),
            (entry.name, _link_to(quote(entry.recording), "recording") if entry.recording else "–"),
        ]
    )


def _link_to(place: str, text: str) -> str:
    return f'<a href="{place}">{text}</a>'


def _warned(count: int) -> str:
    return f'<span class="warning">{count}</span>' if count else "–"


def _cells(cells: Sequence[tuple[object, str]]) -> str:
    texts = (f'<td data-value="{html.escape(str(value))}">{text}</td>' for value, text in cells)
    return f"<tr>{''.join(texts)}</tr>"


def section(entry: ReportEntry, shown: FrameResult) -> str:
    """Write the words, figures and pieces of an input; `shown` is drawn."""
    moment = (
        f" at {shown.frame.time:.2f} s, the last of its highest peaks of T_in"
        if entry.series is not None
        else ""
    )
    parts = [
        f'<section id="{anchor(entry.name)}">',
        f'<h2>{html.escape(entry.name)}<span class="soft">{moment}</span></h2>',
        *(_paragraph(sentence) for sentence in words.sentences(shown)),
        *_warnings(entry),
        _figures(entry, shown),
        _piece_table(shown),
        _link(entry),
        "</section>",
    ]
    return "\n".join(part for part in parts if part)


def _figures(entry: ReportEntry, shown: FrameResult) -> str:
    """Draw what `figures_of` names, each as wide on the page as it is in print."""
    from tssgeom.view.figures.plots import markup
    from tssgeom.view.figures.shapes import figures_of  # here: a page of numbers alone needs no matplotlib

    drawings = [draw() for draw in figures_of(shown, entry.series).values()]
    widths = [drawing.get_figwidth() for drawing in drawings]
    parts = [
        f'<figure style="flex: {width:.2f} 1 {_PER_INCH * width:.0f}px">{markup(drawing)}</figure>'
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


def _piece_table(shown: FrameResult) -> str:
    head, _, *rows = words.piece_table(shown.arcs, route_samples(shown)).splitlines()
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
    """Write each reason once, with the first frame it applies to; of many different ones, the first."""
    reasons = Counter(_reason(each) for each in entry.rejected)
    first = {_reason(each): each.seq for each in reversed(entry.rejected)}
    told = list(reasons.items())[:_MOST_REASONS]
    rest = entry.lost - sum(count for _, count in told)
    items = [f"{_which(entry, count, first[reason])}: {html.escape(reason)}" for reason, count in told] + (
        [f", {rest} more frames"] if rest > 0 else []
    )
    return [f"<li><b>{html.escape(entry.name)}</b>{item}</li>" for item in items]


def _reason(rejected: Rejected) -> str:
    """Leave out the place in the file, which is another for each frame."""
    return re.sub(r"^(line|row) \d+: ", "", rejected.reason)


def _which(entry: ReportEntry, count: int, first: int) -> str:
    if entry.series is None:
        return ""
    return f", frame {first}" if count == 1 else f", {count} frames from frame {first}"
