"""The report of a batch: one HTML page with distributions, outlying inputs, a table, and charts."""

from __future__ import annotations

import html
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

from tssgeom.atomic import write_text
from tssgeom.effects import named
from tssgeom.rig import Rig
from tssgeom.stream import FrameResult, Rejected
from tssgeom.version import __version__
from tssgeom.view import wording as words
from tssgeom.view.report.at_a_glance import (
    anchor,
    breakable,
    distributions,
    input_name,
    kinds_list,
    outlying_table,
    rejected_table,
)
from tssgeom.view.report.entry import ReportEntry
from tssgeom.view.report.outlying_inputs import OutlyingInput
from tssgeom.view.report.page import filled, with_subscripts
from tssgeom.view.samples import route_samples

_MOST_WARNINGS = 5
"""Number of different warnings of one input that are written out."""
_MOST_REASONS = 10
"""Number of different reasons of rejected frames of one input that are written out."""
_MOST_OPEN = 3
"""Inputs on a page up to which the charts of each are open from the beginning."""
COLUMNS = (
    "name",
    "frames",
    "rejected",
    "L [mm]",
    "Φ ± s.e. [°]",
    "pieces",
    "T_in [N]",
    "T_out ± s.e. [N]",
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
    summary: Sequence[Mapping[str, Any]] = (),
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
    summary
        Rows of the summary, for the distributions.
    outlying
        Inputs that differ from the others of their kind, in their order.
    notes
        Further paragraphs at the head.
    title
        Heading of the page.

    Raises
    ------
    SourceError
        Where the file cannot be written.
    """
    linked = {entry.name for entry in entries if entry.section}
    sections = [entry.section for entry in entries if entry.section]
    if len(sections) <= _MOST_OPEN:
        sections = [text.replace("<details ", "<details open ", 1) for text in sections]
    page = filled(
        "report.html",
        title=html.escape(title),
        counts="".join(f"<p>{html.escape(text)}</p>" for text in (_counts(entries), *notes)),
        distributions=distributions(summary, {each.name for each in outlying}),
        statement=_statement(rig, tension_in),
        head="".join(f"<th><button>{_text(column)}</button></th>" for column in COLUMNS),
        rows="\n".join(entry.row for entry in entries),
        outlying=kinds_list(summary) + outlying_table(outlying, linked),
        rejected=rejected_table([entry.rejections for entry in entries if entry.rejections]),
        sections="\n".join(sections),
    )
    write_text(path, page)


def _statement(rig: Rig, tension_in: float) -> str:
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
        else f"{rig.shape.noise_mm:g} mm, as the rig states",
        "Program": f"tssgeom {__version__}",
    }
    lines = "".join(f"<dt>{name}</dt><dd>{_text(text)}</dd>" for name, text in facts.items())
    return f"<h3>Settings</h3>\n<dl>{lines}</dl>"


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


def rendered(entry: ReportEntry, *, figures: bool = True) -> Rendered:
    """Write the part of one input in the report; figures take most of the time and room."""
    result = entry.representative
    kind = "lost" if result is None else "shape" if entry.series is None else "recording"
    text = section(entry, result) if figures and result is not None else ""
    table_row = row(entry, linked=bool(text))
    rejections = "".join(_rejection_items(entry))
    return Rendered(entry.name, kind, entry.used, entry.rejected_frames, table_row, text, rejections)


def row(entry: ReportEntry, *, linked: bool = True) -> str:
    """Write the row of an input in the table of all."""
    result = entry.representative
    if result is None:
        reason = html.escape(f"rejected: {_reason(entry, entry.rejected[0])}")
        span = f'<td class="text warning" colspan="{len(COLUMNS) - 1}" data-value="-1">{reason}</td>'
        name = html.escape(entry.name)
        return f'<tr><td data-value="{name}">{breakable(entry.name)}</td>{span}</tr>'
    name = html.escape(entry.name)
    ends, arcs = result.transmission, result.arcs
    angle, angle_se = math.degrees(arcs.total_angle), math.degrees(arcs.total_angle_se)
    return _cells(
        [
            (entry.name, input_name(entry.name, {entry.name}) if linked else breakable(entry.name)),
            (entry.used, f"{entry.used}"),
            (entry.rejected_frames, _warned(entry.rejected_frames)),
            (arcs.total_length, f"{1e3 * arcs.total_length:.1f}"),
            (angle, _text(words.with_error(angle, angle_se, 1))),
            (len(arcs.length), f"{len(arcs.length)}"),
            (ends.tension_in, f"{ends.tension_in:.2f}"),
            (ends.tension_out, _text(words.with_error(ends.tension_out, ends.tension_out_se, 2))),
            (ends.elongation, _text(words.with_error(1e3 * ends.elongation, 1e3 * ends.elongation_se, 3))),
            (result.sensed_noise, html.escape(words.noise(result))),
            (len(entry.warnings), _warned(len(entry.warnings))),
            (entry.name, f'<a href="{quote(entry.recording)}">recording</a>' if entry.recording else "–"),
        ]
    )


def _text(text: str) -> str:
    return with_subscripts(html.escape(text))


def _warned(count: int) -> str:
    return f'<span class="warning">{count}</span>' if count else "–"


def _cells(cells: Sequence[tuple[object, str]]) -> str:
    texts = (f'<td data-value="{html.escape(str(value))}">{text}</td>' for value, text in cells)
    return f"<tr>{''.join(texts)}</tr>"


def section(entry: ReportEntry, result: FrameResult) -> str:
    """Write text, figures and pieces of an input; those of one frame are of `result`."""
    moment = "" if entry.series is None else f" at {result.frame.time:.2f} s"
    if entry.series is not None and entry.series.driven:
        moment += _text(", the last of its highest peaks of T_in")
    parts = [
        f'<details class="input" id="{anchor(entry.name)}">',
        f'<summary><b>{html.escape(entry.name)}</b><span class="soft">{moment}</span></summary>',
        *(_paragraph(sentence) for sentence in words.sentences(result)),
        *_warnings(entry),
        _figures(entry, result),
        _piece_table(result),
        _link(entry),
        "</details>",
    ]
    return "\n".join(part for part in parts if part)


def _figures(entry: ReportEntry, result: FrameResult) -> str:
    from tssgeom.view.report.shape_charts import shape_charts  # here: numbers alone need no colours

    charts = "".join(f"<figure>{chart}</figure>" for chart in shape_charts(result, entry.series))
    return f'<div class="figures">{charts}</div>'


def _paragraph(text: str) -> str:
    """Turn a paragraph of our own markdown, in which only bold occurs, into HTML."""
    return "<p>" + with_subscripts(re.sub(r"\*\*(.+?)\*\*", r"<b>\1</b>", html.escape(text))) + "</p>"


def _warnings(entry: ReportEntry) -> list[str]:
    lines = [f"⚠ {text}{_share(entry, count)}" for text, count in entry.warnings[:_MOST_WARNINGS]]
    if len(entry.warnings) > _MOST_WARNINGS:
        more = len(entry.warnings) - _MOST_WARNINGS
        lines.append(f"⚠ and {more} other warning{'s' * (more > 1)} in single frames")
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
    reasons = Counter(_reason(entry, each) for each in entry.rejected)
    first = {_reason(entry, each): each.seq for each in reversed(entry.rejected)}
    listed = list(reasons.items())[:_MOST_REASONS]
    rest = entry.rejected_frames - sum(count for _, count in listed)
    items = [(_which(entry, count, first[reason]), reason) for reason, count in listed]
    items += [(f"{rest} more", "other reasons")] if rest > 0 else []
    return [
        f'<tr><td><b>{html.escape(entry.name)}</b></td><td class="left">{which}</td>'
        f'<td class="text">{html.escape(reason)}</td></tr>'
        for which, reason in items
    ]


def _reason(entry: ReportEntry, rejected: Rejected) -> str:
    """Omit the name of the input, and the line or row in the file, which differs for each frame."""
    return re.sub(r"^(line|row) \d+: ", "", rejected.reason.removeprefix(f"{entry.name}: "))


def _which(entry: ReportEntry, count: int, first: int) -> str:
    if entry.series is None:
        return "all"
    return f"frame {first}" if count == 1 else f"{count} frames from frame {first}"
