"""The workflow: base fit, error model, where, what, decision, ties, next experiment, updated rig.

Steps and constants: docs/discovery.md, "How it decides"; equations: docs/model.md (100)-(118).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from tssgeom.identify.assembly import (
    Places,
    Work,
    base_estimates,
    experiments,
    found,
    nominal,
    ranking,
    updated,
)
from tssgeom.identify.attribution import along_routes, heat_map, pointed
from tssgeom.identify.base_fit import base_fit, posed
from tssgeom.identify.campaign import Campaign
from tssgeom.identify.finding import Finding
from tssgeom.identify.held_out import held_out
from tssgeom.identify.missing_shapes import missing_shapes
from tssgeom.identify.noise_model import Errors
from tssgeom.identify.outcome import gap_of, traces
from tssgeom.identify.problem import Fit, Problem, columns
from tssgeom.identify.readings import Reading, readings
from tssgeom.identify.selection import name_of, selected
from tssgeom.identify.stack import stacked
from tssgeom.identify.ties import base_ties, ties_of, unobservable
from tssgeom.identify.variants import variants
from tssgeom.identify.verdict import judged
from tssgeom.identify.wording import sentence
from tssgeom.tendon.bars.model import Drive

_SUSPECT = 1.3  # χ² for each reading from which another drive is tried
_EXPLAINED = 1.2  # χ² for each reading of a model that leaves nothing to be found


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
    started = _started(campaign, None)
    tell("fitting friction and compliance", 0.05)
    tell("refitting each effect of the library", 0.25)
    work = _worked(campaign, started, seed)
    if work.judged.verdict == "unknown" and not work.judged.bent:
        tell("trying the tension as drive", 0.6)
        other = _by_tension(campaign, started)
        told = None if other is None else _worked(campaign, other, seed)
        if other is not None and told is not None and _explains(told):
            started, work = other, told
    tell("mapping where they disagree", 0.8)
    places = _places(started.runs, campaign, started.base)
    tell("putting it together", 0.9)
    finding = _finding(campaign, started, work, places)
    tell("done", 1.0)
    return _timed(finding, time.perf_counter() - begun)


def _explains(work: Work) -> bool:
    return work.judged.verdict != "unknown" and work.misfit < _EXPLAINED


@dataclass(frozen=True, slots=True)
class _Started:
    """Runs read with one drive, and the base fit to them."""

    runs: tuple[Reading, ...]
    notes: tuple[str, ...]
    problem: Problem
    errors: Errors
    base: Fit

    @property
    def misfit(self) -> float:
        """χ² for each reading [1]."""
        return self.base.chi2 / self.problem.stack.size


def _started(campaign: Campaign, drive: Drive | None) -> _Started:
    runs, notes = readings(campaign, drive)
    problem, errors, base = base_fit([run for run in runs if not run.held_out], campaign.rig)
    return _Started(runs, notes, problem, errors, base)


def _by_tension(campaign: Campaign, started: _Started) -> _Started | None:
    """Start from the tension as drive where the position leaves more than the sensors explain."""
    runs = started.runs
    if started.misfit < _SUSPECT or runs[0].drive == "tension_in_N":
        return None
    if any("tension_in_N" not in run.measured or len(run.measured) < 2 for run in runs):
        return None
    told = _started(campaign, "tension_in_N")
    note = "The proximal tension drives the model: with the position as drive, no name explains the readings."
    return replace(told, notes=(*told.notes, note))


def _worked(campaign: Campaign, started: _Started, seed: int) -> Work:
    tried, absent = variants(started.problem.stack)
    held = held_out(started.runs, campaign.rig, started.base.at)
    first = (started.problem, started.errors, started.base)
    chosen = selected(first, tried, held, seed)
    verdict = judged((started.problem, started.base), chosen, chosen.errors.names, held)
    return Work(started.problem, started.base, chosen, held, verdict, absent)


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


def _finding(campaign: Campaign, started: _Started, work: Work, places: Places) -> Finding:
    runs, notes = started.runs, started.notes
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
        unobservable=unobservable(chosen.steps[0].screen, work.absent, named),
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
