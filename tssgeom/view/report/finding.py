"""The report of `discover`: the answer first, then the evidence, on one page."""

from __future__ import annotations

import html
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from tssgeom.atomic import write_text
from tssgeom.identify.finding import Candidate, Finding
from tssgeom.identify.misfit import beyond_noise
from tssgeom.version import __version__
from tssgeom.view import colours
from tssgeom.view import finding_wording as words
from tssgeom.view.figures.finding import (
    judged,
    law_figure,
    laws_of,
    listed_candidates,
    missing_figure,
    ranking_figure,
    residual_figure,
    transmission_figure,
)
from tssgeom.view.figures.heat_map import along_figure, heat_figure
from tssgeom.view.figures.plots import markup
from tssgeom.view.report.misfit_table import misfit_table, phase_table
from tssgeom.view.report.page import filled, with_subscripts
from tssgeom.view.report.proposed_runs import proposed_figures, proposed_markup

_ACCENTS = {"none": "#009e73", "effect": "#0072b2", "tie": "#a35c00", "unknown": "#a3508a"}
_ACCENTS |= {"law": _ACCENTS["effect"], "partial": _ACCENTS["tie"]}
_MOST_CELLS = 5
_NOTHING = 0.05  # of the noise; less is left by chance


def write_finding_report(path: Path, finding: Finding) -> None:
    """Write the page; an older one gives way only when it is done.

    Raises SourceError where the file cannot be written.
    """
    sections = (draw(finding) for draw in _SECTIONS)
    page = filled(
        "finding.html",
        title=html.escape(f"What the model of {finding.campaign.name} lacks"),
        subtitle=html.escape(_subtitle(finding)),
        accent=_ACCENTS[finding.verdict],
        accent_dark=colours.on_dark(_ACCENTS[finding.verdict]),
        word=html.escape(words.VERDICTS[finding.verdict]),
        sentence=html.escape(finding.sentence),
        sections="\n".join(section for section in sections if section),
    )
    write_text(path, page)


def _subtitle(finding: Finding) -> str:
    traces = finding.traces
    held = [trace.run for trace in traces if trace.held_out]
    samples = sum(len(trace.time) for trace in traces)
    kept = f"held out: {', '.join(held)}" if held else "none held out"
    return (
        f"{len(traces)} runs with {samples} samples, {kept}; "
        f"done in {finding.seconds:.1f} s by tssgeom {__version__}"
    )


def _effects(finding: Finding) -> str:
    if not finding.effects:
        return ""
    rows = [row for each in finding.effects for row in _effect_rows(each)]
    head = (
        "effect",
        "what it is",
        "parameters [95 % interval]",
        f"{words.TOTAL} (threshold)",
        "size / detection limit",
        "held-out misfit, ratio",
    )
    return _section("What acts", _table(head, rows, text=(1, 2)), _tie_words(finding))


def _effect_rows(each: Candidate) -> list[list[str]]:
    observed = each.evidence
    return [
        [
            words.plain(name),
            words.meaning(name),
            "\n".join([*(f"{key} = {value}" for key, value in words.parameters(effect, reported).items())])
            or "–",
            f"{words.total(observed)} ({observed.threshold:.0f})",
            words.ratio(observed.size_over_limit),
            words.ratio(observed.heldout_ratio),
        ]
        for name, effect, reported in zip(each.names, each.effects, each.parameters, strict=True)
    ]


def _tie_words(finding: Finding) -> str:
    lines = [
        f"These data cannot separate {' and '.join(words.plain(name) for name in tie.names)} "
        f"({tie.gauge}): {tie.why}"
        for tie in words.effect_ties(finding)
    ]
    return "".join(f'<p class="warning">{html.escape(line)}</p>' for line in lines)


def _laws(finding: Finding) -> str:
    if not laws_of(finding):
        return ""
    text = (
        "<p>No formula of the library has this law. It was learnt inside the model; beyond the ends of its "
        "curve, where nothing was measured, it is taken as constant.</p>"
    )
    near = [
        f"{words.plain(name)} (2 ln Z {less:.0f} less)"
        for each in laws_of(finding)
        for name, less in (each.law.nearest if each.law else ())
    ]
    nearest = f"<p>Nearest formulae: {html.escape(', '.join(near))}.</p>" if near else ""
    return _section("The law", text, _figure(law_figure, finding, ""), nearest)


def _misfit(finding: Finding) -> str:
    one = not finding.effects
    phases = ""
    if finding.misfit.by_phase:
        table = phase_table(finding.misfit, one=one)
        phases = f"<details><summary>By phase, on the same runs</summary>{table}</details>"
    trace = judged(finding)
    held = ", which was held out" if trace.held_out and not finding.is_machine else ""
    where = f" on route {trace.route}" if trace.route else ""
    return _section(
        "The misfit" if one else "The misfit before and after",
        f"<p>{_misfit_text(finding)}</p>",
        misfit_table(finding.misfit, one=one),
        phases,
        _figure(transmission_figure, finding, f"Run {trace.run}{where}{held}."),
    )


def _misfit_text(finding: Finding) -> str:
    reported = words.judged_runs(finding.misfit)
    runs = {"held_out": "runs that were held out", "fitted": "the fitted runs, since none was held out,"}[
        reported
    ]
    before, after = (
        beyond_noise(rms[reported], finding.misfit.noise)
        for rms in (finding.misfit.before, finding.misfit.after)
    )
    if not finding.effects:
        return f"On {runs} the model with friction and compliance refitted leaves {_beyond(after)}."
    return (
        f"On {runs} what is left beyond the noise goes from <b>{before:.3g}</b> to <b>{after:.3g}</b> times "
        "the noise (root mean over channels). “Before” is the model with friction and compliance refitted."
    )


def _beyond(misfit: float) -> str:
    if misfit < _NOTHING:
        return "nothing beyond the noise of the sensors"
    return f"<b>{misfit:.3g}</b> times the noise beyond it (root mean over channels)"


def _next(finding: Finding) -> str:
    steps = "".join(f"<li>{with_subscripts(html.escape(step))}</li>" for step in words.next_steps(finding))
    return _section(
        "What to do next",
        f"<ul>{steps}</ul>",
        "<p>The updated rig is <code>rig.updated.toml</code>; every other command takes it:</p>",
        f"<pre><code>{_MACHINE_USE if finding.is_machine else _USE}</code></pre>",
    )


_USE = "tssgeom batch SHAPES --rig rig.updated.toml --out results"
_MACHINE_USE = "tssgeom simulate SHAPE --drive RUN --rig rig.updated.toml --out results"


def _proposed(finding: Finding) -> str:
    if finding.proposal is None:
        return ""
    return _section("What to measure next, designed", proposed_markup(finding.proposal))


def _where(finding: Finding) -> str:
    if not finding.heat.rows:
        return ""
    items = "".join(
        f"<li>{with_subscripts(html.escape(words.misfit_cell(each)))}</li>"
        for each in finding.where[:_MOST_CELLS]
    )
    text = (
        f"<p>Of all that the sensors do not explain, before:</p><ul>{items}</ul>"
        if items
        else "<p>Nowhere beyond what the sensors explain.</p>"
    )
    along = _figure(along_figure, finding, _ALONG) if finding.along else ""
    return _section("Where it was", text, along, _figure(heat_figure, finding, ""))


_ALONG = (
    "What each stretch of a route would have to turn more, were the misfit all friction there. "
    "A peak at one arc length on every route is evidence for a bend; waves that differ are not."
)


def _residuals(finding: Finding) -> str:
    return _section("What is left, over time", _figure(residual_figure, finding, ""))


def _missing(finding: Finding) -> str:
    if not finding.missing_shapes:
        return ""
    text = "<p>No effect of the library explains it. This is the friction that fits the data instead:</p>"
    return _section("The shape of what is missing", text, _figure(missing_figure, finding, ""))


def _ranking(finding: Finding) -> str:
    reported = listed_candidates(finding)
    if not reported:
        return ""
    rows = [
        [
            words.candidate(each),
            "chosen" if words.is_selected(finding, each) else each.why_not,
            words.total(each.evidence),
            words.ratio(each.evidence.size_over_limit),
            words.ratio(each.evidence.heldout_ratio),
        ]
        for each in reported
    ]
    head = ("candidate", "why not", words.TOTAL, "size / detection limit", "held-out misfit, ratio")
    more = len(finding.ranking) - len(reported)
    note = f'<p class="soft">and {more} more in report.json</p>' if more > 0 else ""
    alone = (
        "<p>Each is tried alone on the base model. “What acts” compares the model with and without the "
        "effect.</p>"
        if _differs_alone(finding)
        else ""
    )
    figure = _figure(ranking_figure, finding, "")
    return _section("Runners-up, and why not", alone, figure, _table(head, rows, text=(1,)), note)


def _differs_alone(finding: Finding) -> bool:
    """Whether an effect has another ΔBIC beside the others, or on the final model, than when tried alone."""
    alone = {each.names: words.total(each.evidence) for each in finding.ranking}
    return any(alone.get(each.names) != words.total(each.evidence) for each in finding.effects)


def _unobservable(finding: Finding) -> str:
    if not finding.unobservable:
        return ""
    rows = [[words.plain(name), why] for name, why in finding.unobservable.items()]
    return _section(
        "What these data cannot show",
        "<p>Whether these act is not known; they leave no mark in what was measured.</p>",
        _table(("effect", "why"), rows, text=(1,)),
    )


def _base(finding: Finding) -> str:
    rows = [
        [
            words.plain(name).removesuffix(" per N"),
            f"{finding.nominal[name]:.4g}" if name in finding.nominal else "",
            words.significant(each.value, 4),
            f"{words.significant(each.low, 4)} to {words.significant(each.high, 4)}",
            "" if each.unit == "1" else each.unit,
        ]
        for name, each in finding.base.items()
    ]
    text = f"{finding.base_tie[:1].upper()}{finding.base_tie[1:].rstrip('.')}."
    tie = f"<p>{html.escape(text)}</p>" if finding.base_tie else ""
    head = ("", "rig file", "refitted", "95 % interval", "unit")
    title = "Numbers of the rig, refitted" if finding.is_machine else "Friction and compliance, refitted"
    return _section(title, _table(head, rows), tie)


def _notes(finding: Finding) -> str:
    notes = list(dict.fromkeys((*finding.campaign.notes, *finding.notes)))
    if not notes:
        return ""
    return _section("Notes", f"<ul>{''.join(f'<li>{html.escape(note)}</li>' for note in notes)}</ul>")


def figures_of(finding: Finding) -> Mapping[str, Callable[[], Figure]]:
    """Return what draws each figure of the page, by name."""
    own = {name: partial(draw, finding) for name, (draw, there) in _FIGURES.items() if there(finding)}
    return {**own, **proposed_figures(finding.proposal)}


_FIGURES: Mapping[str, tuple[Callable[[Finding], Figure], Callable[[Finding], object]]] = {
    "transmission": (transmission_figure, lambda finding: finding.traces),
    "residual": (residual_figure, lambda finding: finding.traces),
    "along": (along_figure, lambda finding: finding.along),
    "heat": (heat_figure, lambda finding: finding.heat.rows),
    "ranking": (ranking_figure, listed_candidates),
    "laws": (law_figure, laws_of),
    "missing": (missing_figure, lambda finding: finding.missing_shapes),
}

_SECTIONS: tuple[Callable[[Finding], str], ...] = (
    _effects,
    _laws,
    _missing,
    _misfit,
    _next,
    _proposed,
    _where,
    _residuals,
    _ranking,
    _unobservable,
    _base,
    _notes,
)


def _section(title: str, *parts: str) -> str:
    return (
        f"<section><h2>{html.escape(title)}</h2>\n" + "\n".join(part for part in parts if part) + "</section>"
    )


def _figure(draw: Callable[[Finding], Figure], finding: Finding, caption: str) -> str:
    reported = f"<figcaption>{html.escape(caption)}</figcaption>" if caption else ""
    return f"<figure>{markup(draw(finding))}{reported}</figure>"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]], text: Sequence[int] = ()) -> str:
    """Write a table; the columns `text` hold words and may be broken."""
    kinds = [' class="text"' if k in text else "" for k in range(len(head))]
    top = _cells("th", kinds, head)
    body = "".join(f"<tr>{_cells('td', kinds, row)}</tr>" for row in rows)
    return f'<div class="wide"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def _cells(tag: str, kinds: Sequence[str], texts: Sequence[str]) -> str:
    pairs = zip(kinds, texts, strict=True)
    return "".join(f"<{tag}{kind}>{_MINUS.sub(_SIGN, html.escape(text))}</{tag}>" for kind, text in pairs)


_MINUS, _SIGN = re.compile(r"(?<![\w.])-(?=\d)"), "\N{MINUS SIGN}"
