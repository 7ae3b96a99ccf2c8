"""The section of the report of `discover` with the runs that are proposed."""

from __future__ import annotations

import html
from collections.abc import Callable, Mapping
from functools import partial

from matplotlib.figure import Figure

from tssgeom.identify.outcomes import words_of
from tssgeom.identify.proposal import Proposal, ProposedRun
from tssgeom.identify.run_limits import KEYS
from tssgeom.view.figures.plots import markup
from tssgeom.view.figures.proposal import proposal_figure

_COMMANDS = (
    "tssgeom simulate SHAPE --drive proposed/run_1.csv --rig rig.updated.toml --out simulated\n"
    "tssgeom discover CAMPAIGN --with MEASURED --out OUT --propose 1"
)


def proposed_figures(proposal: Proposal | None) -> Mapping[str, Callable[[], Figure]]:
    """Return what draws the figure of each proposed run, by name."""
    if proposal is None:
        return {}
    return {f"proposed_{run.name}": partial(proposal_figure, proposal, run) for run in proposal.runs}


def proposed_markup(proposal: Proposal) -> str:
    """Write what is proposed, each run with its figure and what its outcomes would mean."""
    limits = ", ".join(
        f"{KEYS[key]} {value:.3g} {_unit(key)}{' (as stated)' if key in proposal.stated else ''}"
        for key, value in proposal.limits.items()
    )
    parts = [f"<p>{html.escape(proposal.sentence)}</p>"]
    if proposal.in_the_way:
        parts.append(f'<p class="warning">{html.escape(proposal.in_the_way)}</p>')
    parts.append(f'<p class="soft">Within these limits: {html.escape(limits)}.</p>')
    parts += [_run(proposal, run) for run in proposal.runs]
    parts.append(
        "<p>The drive files are in <code>proposed</code>. To see a run before it is made, and to go on with "
        f"what was measured:</p><pre><code>{html.escape(_COMMANDS)}</code></pre>"
    )
    return "\n".join(parts)


def _unit(key: str) -> str:
    return {"tension_N": "N", "least_tension_N": "N", "speed_mm_per_s": "mm/s", "travel_mm": "mm"}.get(
        key, "s"
    )


def _run(proposal: Proposal, run: ProposedRun) -> str:
    items = "".join(f"<li>{html.escape(words)}.</li>" for words in run.outcomes)
    rows = "".join(
        f"<tr><td>{html.escape(words_of(each.true))}</td><td>{html.escape(words_of(each.other))}</td>"
        f"<td>{each.delta_bic:.0f}</td></tr>"
        for each in run.expected
    )
    table = (
        "<details><summary>Expected ΔBIC of each pair, with the runs before</summary>"
        f'<div class="wide"><table><thead><tr><th>if true</th><th>worse</th><th>ΔBIC</th></tr></thead>'
        f"<tbody>{rows}</tbody></table></div></details>"
    )
    return (
        f"<h3>{html.escape(run.name)}: {html.escape(run.route)}</h3>"
        f"<p>It {html.escape(run.why)}.</p>"
        f"<figure>{markup(proposal_figure(proposal, run))}</figure>"
        + (f"<ul>{items}</ul>{table}" if run.outcomes else "")
    )
