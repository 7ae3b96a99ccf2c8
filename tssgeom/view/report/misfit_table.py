"""The misfit in numbers: measured less simulated, by channel and phase, before and after."""

from __future__ import annotations

import html

from tssgeom.identify.finding import Misfit
from tssgeom.view import finding_wording as words
from tssgeom.view.report.page import with_subscripts

_CLEARLY = 0.05  # share of a change below which a number is neither better nor worse


def misfit_table(misfit: Misfit, *, one: bool) -> str:
    """Write the root mean squares of every channel, fitted and held out; `one` where before is after."""
    groups = [(runs, title) for runs, title in _GROUPS if misfit.before.get(runs)]
    names = ["left"] if one else ["before", "after"]
    first = "".join(f'<th colspan="{len(names)}">{title}</th>' for _, title in groups)
    second = "".join(f"<th>{name}</th>" for name in names) * len(groups)
    rows = "".join(_row(misfit, name, [runs for runs, _ in groups], one) for name in misfit.noise)
    return (
        '<div class="wide"><table><thead>'
        f'<tr><th rowspan="2">channel, rms</th><th rowspan="2">sensors</th>{first}</tr><tr>{second}</tr>'
        f"</thead><tbody>{rows}</tbody></table></div>"
    )


_GROUPS = (("held_out", "held-out runs"), ("fitted", "fitted runs"))


def _row(misfit: Misfit, name: str, groups: list[str], one: bool) -> str:
    quantity = words.channel(name)
    cells = [
        f"<td>{with_subscripts(html.escape(quantity.label))}</td>",
        f"<td>{words.significant(quantity.factor * misfit.noise[name], 3)}</td>",
    ]
    for runs in groups:
        if name not in misfit.before[runs]:
            cells.append("<td>–</td>" * (1 if one else 2))
            continue
        cells.append(
            _pair(*(quantity.factor * rms[runs][name] for rms in (misfit.before, misfit.after)), one=one)
        )
    return f"<tr>{''.join(cells)}</tr>"


def _pair(before: float, after: float, *, one: bool) -> str:
    if one:
        return f"<td>{words.significant(after, 3)}</td>"
    change = after - before
    kind = "" if abs(change) <= _CLEARLY * before else ' class="better"' if change < 0 else ' class="worse"'
    return f"<td>{words.significant(before, 3)}</td><td{kind}>{words.significant(after, 3)}</td>"


def phase_table(misfit: Misfit, *, one: bool) -> str:
    """Write the same by channel and phase, for the runs that judge."""
    rows = [
        f"<tr><td>{with_subscripts(html.escape(words.channel(name).label))}</td>"
        f"<td>{html.escape(words.plain(phase))}</td>"
        + _pair(*(words.channel(name).factor * value for value in pair), one=one)
        + "</tr>"
        for name, phases in misfit.by_phase.items()
        for phase, pair in phases.items()
    ]
    names = "<th>left</th>" if one else "<th>before</th><th>after</th>"
    head = f"<tr><th>channel, rms</th><th>phase</th>{names}</tr>"
    return f"<table><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table>"
