"""What a hidden bend is taken for on the routes of a campaign, in words; docs/model.md (339)."""

from __future__ import annotations

from collections.abc import Sequence

from tssgeom.effects import HiddenBend
from tssgeom.identify.finding import Candidate
from tssgeom.identify.readings import Reading


def bend_words(effects: Sequence[Candidate], runs: Sequence[Reading]) -> str:
    """Say that hidden bends are at one arc length on all routes, and which routes end before it.

    Empty where there is no hidden bend, or one route alone.
    """
    length = {run.route.name: run.route.arcs.total_length for run in runs}
    bends = [own for one in effects for own in one.effects if isinstance(own, HiddenBend)]
    if len(length) < 2 or not bends:
        return ""
    text = f"{'The' if len(bends) == 1 else 'Each'} bend is taken to be at one arc length on all routes"
    short = [
        f"{name} ends at {1e3 * length[name]:.0f} mm, before the bend at {1e3 * bend.at_m:.0f} mm"
        for bend in bends
        for name in length
        if bend.at_m >= length[name]
    ]
    if short:
        return f"{text}; {', and '.join(short)}, so that it does not act there."
    return f"{text}."
