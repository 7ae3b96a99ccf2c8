"""The section of the report of `discover` with the runs that are proposed, and their figures."""

from __future__ import annotations

import html
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tssgeom.identify.outcomes import words_of
from tssgeom.identify.proposal import Proposal, ProposedRun
from tssgeom.identify.run_limits import KEYS
from tssgeom.view.figures.plots import BLUE, GREEN, INK, ORANGE, PAGE, PURPLE, figure, markup, titles
from tssgeom.view.quantities import quantity

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


_COLOURS = (INK, BLUE, ORANGE, PURPLE, GREEN)
_SPREAD = "#d9dee6"
_SIGMAS = 2.0
_MOST = 99.0  # percentile of differences that the axis shows: next to a turn they peak


def proposal_figure(proposal: Proposal, run: ProposedRun) -> Figure:
    """Draw drive, clearest channel of each model, and differences beside the sensors, over time."""
    names, channel = proposal.candidates, run.clearest
    rows = 3 if run.differences else 2
    with figure((PAGE, 1.75 * rows)) as drawing:
        axes: Sequence[Axes] = drawing.subplots(rows, 1, sharex=True)
        _draw_drive(axes[0], run)
        for name, colour in zip(names, _COLOURS, strict=False):
            values = quantity(channel).factor * run.channels[name][channel]
            axes[1].plot(run.time, values, color=colour, label=words_of(name), linewidth=1.2)
        titles(axes[1], f"{quantity(channel).words}, as each model predicts it", "", quantity(channel).label)
        if run.differences:
            _draw_differences(axes[2], run, names)
        axes[-1].set_xlabel("time [s]")
        labelled = axes[2] if run.differences else axes[1]
        drawing.legend(*labelled.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return drawing


def _draw_drive(axes: Axes, run: ProposedRun) -> None:
    factor, several = quantity(run.drives[0]).factor, len(run.drives) > 1
    for name, values, corners, colour in zip(
        run.drives, run.values.T, run.corners.T, cycle(_COLOURS), strict=False
    ):
        label = quantity(name).symbol if several else None
        axes.plot(run.time, factor * values, color=colour, linewidth=1.2, label=label)
        axes.plot(run.corner_time, factor * corners, "o", color=colour, markersize=2.5)
    words = "the drives" if several else "the drive"
    titles(axes, f"{run.name}, {run.route}: {words}", "", quantity(run.drives[0]).label)
    if several:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _draw_differences(axes: Axes, run: ProposedRun, names: Sequence[str]) -> None:
    """Draw each model less the first, which is refitted to it."""
    drawn, channel = quantity(run.clearest), run.clearest
    sigma = _SIGMAS * drawn.factor * run.sigma[channel]
    axes.fill_between(
        run.time, -sigma, sigma, color=_SPREAD, linewidth=0, label=f"± {_SIGMAS:.0f} σ of the sensors"
    )
    axes.axhline(0.0, color=_COLOURS[0], linewidth=1.2, label=words_of(names[0]))
    reach = 1.5 * float(np.nanmedian(sigma))
    for name, colour in zip(names[1:], _COLOURS[1:], strict=False):
        left = drawn.factor * run.differences[name][channel]
        reach = max(reach, float(np.nanpercentile(np.abs(left), _MOST)))
        axes.plot(run.time, left, color=colour, linewidth=1.2, label=words_of(name))
    axes.set_ylim(-1.15 * reach, 1.15 * reach)
    titles(axes, f"less {words_of(names[0])}, refitted to it", "", drawn.label)
