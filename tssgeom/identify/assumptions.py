"""What parts are taken for in all runs and on all routes alike, in words; docs/model.md (334), (339)."""

from __future__ import annotations

from collections.abc import Sequence

from tssgeom.effects import Backlash, HiddenBend, LoadPlay
from tssgeom.identify.finding import Candidate
from tssgeom.identify.readings import Reading


def assumed(effects: Sequence[Candidate], runs: Sequence[Reading]) -> str:
    """Say what the effects chosen take to be alike in these runs; empty where they take nothing so."""
    words = (_bends(effects, runs), _starts(effects, runs))
    return " ".join(each for each in words if each)


def _bends(effects: Sequence[Candidate], runs: Sequence[Reading]) -> str:
    """Say that hidden bends are at one arc length on all routes, and which routes end before it."""
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
    return f"{text}; {', and '.join(short)}, so that it does not act there." if short else f"{text}."


def _starts(effects: Sequence[Candidate], runs: Sequence[Reading]) -> str:
    """Say that all runs start with one part of a play to be taken up."""
    plays = [own for one in effects for own in one.effects if isinstance(own, Backlash | LoadPlay)]
    if len(runs) < 2 or not any(play.open_m > 0.0 for play in plays):
        return ""
    return "All runs are taken to start with the same part of the play to be taken up."
