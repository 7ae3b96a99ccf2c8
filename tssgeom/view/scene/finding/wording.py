"""The texts of the recording: the verdict, and the run of the moment."""

from __future__ import annotations

import numpy as np
import rerun as rr

from tssgeom.identify.finding import Finding, Trace
from tssgeom.view import finding_wording as words
from tssgeom.view.scene.columns import Sender


def send_words(runs: Sender, finding: Finding) -> None:
    """Send the verdict for all time, and for each run what it is and what its channels leave."""
    verdict = rr.TextDocument(verdict_words(finding), media_type=rr.MediaType.MARKDOWN)
    runs.constant("summary", verdict)
    runs.constant("table", rr.TextDocument.from_fields(media_type=rr.MediaType.MARKDOWN))
    runs.send("table", rr.TextDocument.columns(text=[run_words(trace) for trace in finding.traces]))


def verdict_words(finding: Finding) -> str:
    """Say the verdict, the effects with their numbers, and what to measure next, as markdown."""
    lines = [f"### {words.VERDICTS[finding.verdict].capitalize()}", finding.sentence]
    for each in finding.effects:
        for name, reported in zip(each.names, each.parameters, strict=True):
            numbers = ", ".join(
                f"{words.parameter(key)} {words.displayed(value)}" for key, value in reported.items()
            )
            lines += [f"- **{words.plain(name)}**: {numbers}"] if numbers else []
    lines += [
        f"- tied ({tie.gauge}): {', '.join(map(words.plain, tie.names))}"
        for tie in words.effect_ties(finding)
    ]
    lines += [f"- next: {step}" for step in words.next_steps(finding)[:2]]
    return "\n\n".join(lines)


def run_words(trace: Trace) -> str:
    """Return the run of the moment and the misfit of each channel, as markdown."""
    kept = "held out from every fit" if trace.held_out else "fitted"
    rows = [
        f"| {words.channel(name).label} | {_rms(trace, name, 'before')} | {_rms(trace, name, 'after')} |"
        for name in trace.measured
    ]
    head = f"### Run {trace.run}\n\nOn route {trace.route}; {kept}.\n"
    return "\n".join([head, "| left, rms | before | after |", "|---|--:|--:|", *rows])


def _rms(trace: Trace, name: str, when: str) -> str:
    left = words.channel(name).factor * (trace.measured[name] - getattr(trace, when)[name])
    return f"{float(np.sqrt(np.nanmean(left**2))):.3g}"
