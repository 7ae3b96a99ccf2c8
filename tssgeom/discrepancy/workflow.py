"""The workflow: base fit, error model, where, what, decision, ties, next experiment, updated rig.

Steps and constants: docs/discovery.md, "How it decides"; equations: docs/model.md (100)-(119).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace

from tssgeom.discrepancy.assembly import (
    Places,
    Work,
    base_estimates,
    experiments,
    found,
    nominal,
    ranking,
    updated,
)
from tssgeom.discrepancy.base import base_fit, posed
from tssgeom.discrepancy.campaign import Campaign
from tssgeom.discrepancy.finding import Finding
from tssgeom.discrepancy.heldout import held_out
from tssgeom.discrepancy.outcome import gap_of, traces
from tssgeom.discrepancy.problem import Fit, columns
from tssgeom.discrepancy.readings import Reading, readings
from tssgeom.discrepancy.select import name_of, selected
from tssgeom.discrepancy.shapes import missing_shapes
from tssgeom.discrepancy.stack import stacked
from tssgeom.discrepancy.ties import base_ties, ties_of, unobservable
from tssgeom.discrepancy.variants import variants
from tssgeom.discrepancy.verdict import judged
from tssgeom.discrepancy.where import along_routes, heat_map, pointed
from tssgeom.discrepancy.words import sentence

Progress = Callable[[str, float], None]


def discover(
    campaign: Campaign, *, seed: int = 0, progress: Callable[[str, float], None] | None = None
) -> Finding:
    """Find what the model of a rig lacks.

    Parameters
    ----------
    campaign
        Measured runs and the rig as it is believed to be.
    seed
        Of the simulated clean campaigns; the same seed gives the same answer.
    progress
        Is told of each step and the share that is done [1].

    Raises
    ------
    SettingsError
        Where the runs cannot be used.
    """
    begun = time.perf_counter()
    tell = progress or _silent
    tell("reading the runs", 0.0)
    runs, notes = readings(campaign)
    tell("fitting friction and compliance", 0.05)
    problem, errors, base = base_fit([run for run in runs if not run.held_out], campaign.rig)
    tell("mapping where they disagree", 0.15)
    places = _places(runs, campaign, base)
    tell("refitting each effect of the library", 0.25)
    tried, absent = variants(problem.stack)
    held = held_out(runs, campaign.rig, base.at)
    chosen = selected((problem, errors, base), tried, held, seed)
    tell("judging", 0.8)
    verdict = judged((problem, base), chosen, chosen.errors.names, held)
    work = Work(problem, base, chosen, held, verdict)
    tell("putting it together", 0.9)
    finding = _finding(campaign, (runs, notes), work, places, absent)
    tell("done", 1.0)
    return _timed(finding, time.perf_counter() - begun)


def _silent(step: str, share: float) -> None:
    pass


def _timed(finding: Finding, seconds: float) -> Finding:
    return replace(finding, seconds=seconds)


def _places(runs: tuple[Reading, ...], campaign: Campaign, base: Fit) -> Places:
    """Map where the base model fails, over all runs."""
    whole, _ = posed(stacked(runs), campaign.rig, base.at)
    heat, where = heat_map(whole, base.at)
    along, gains = along_routes(whole, base.at, columns(whole, base.at, whole.left(base.at)))
    routes = {run.name: run.route.name for run in runs}
    return Places(heat, pointed(where, along, routes), along, gains)


def _finding(
    campaign: Campaign,
    read: tuple[tuple[Reading, ...], tuple[str, ...]],
    work: Work,
    places: Places,
    absent: Mapping[str, str],
) -> Finding:
    runs, notes = read
    chosen, verdict = work.chosen, work.judged
    unknown = verdict.verdict == "unknown"
    fit = work.base if unknown else chosen.fit
    effects = () if unknown else found(work)
    told = traces(runs, campaign.rig, work.base.at, fit.at)
    base_words, of_base = base_ties(fit, campaign.rig)
    tied = [*ties_of(chosen), *of_base]
    base = base_estimates(fit, campaign.rig)
    named = [name_of(effect) for effect in chosen.fit.at.effects]
    rivals = [name for one in tied[:1] for name in one.tie.names if name not in named]
    return Finding(
        campaign=campaign,
        verdict=verdict.verdict,
        sentence=sentence(verdict, effects, base, rivals),
        effects=effects,
        ties=tuple(one.tie for one in tied),
        breaks_tie=experiments(work, tied),
        unobservable=unobservable(chosen.steps[0].screen, absent, named),
        where=places.where,
        heat=places.heat,
        along=places.along,
        gap=gap_of(told),
        base=base,
        nominal=nominal(campaign.rig),
        base_tie=base_words,
        ranking=ranking(work, effects),
        missing_shapes=missing_shapes(work.problem, work.base, places.along, places.gains) if unknown else (),
        rig=updated(campaign.rig, fit.at),
        traces=told,
        notes=notes,
        seconds=0.0,
    )
