"""The workflow: base fit, error model, where, what, decision, ties, next experiment, updated rig.

Steps and constants: docs/discovery.md, "How it decides"; equations: docs/model.md (100)-(118).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from tssgeom.errors import FitError
from tssgeom.identify.assembly import (
    Attribution,
    Work,
    base_estimates,
    chosen_effects,
    experiments,
    nominal,
    ranking,
    refused,
    updated,
)
from tssgeom.identify.assumptions import assumed
from tssgeom.identify.attribution import along_routes, heat_map, missing_shapes, pointed
from tssgeom.identify.campaign import Campaign
from tssgeom.identify.experiment_design import proposed
from tssgeom.identify.finding import Finding
from tssgeom.identify.fit import Fit, Problem, base_fit, columns, explained, posed
from tssgeom.identify.law_finding import law_candidates, law_ranking
from tssgeom.identify.law_fit import LawFit, fitted
from tssgeom.identify.law_search import as_fit, law_promises_more, needed, searched
from tssgeom.identify.misfit import UNINFORMATIVE, held_out, held_out_change, misfits, traces
from tssgeom.identify.prediction import Errors, of_other_directions, stacked
from tssgeom.identify.proposal import Asked
from tssgeom.identify.readings import Reading, readings
from tssgeom.identify.rig_errors import of_fit
from tssgeom.identify.screening import detection_limits, variants
from tssgeom.identify.selection import name_of, selected
from tssgeom.identify.ties import base_ties, ties_of, unobservable
from tssgeom.identify.verdict import judged, judged_laws, remainder, sentence
from tssgeom.tendon.bars.model import Drive
from tssgeom.threads import single_threaded


def discover(
    campaign: Campaign,
    *,
    seed: int = 0,
    progress: Callable[[str, float], None] | None = None,
    propose: Asked | None = None,
) -> Finding:
    """Find what the model of a rig lacks.

    Parameters
    ----------
    campaign
        Measured runs and the nominal rig.
    seed
        Of the simulated clean campaigns; the same seed gives the same answer.
    progress
        Is called with each step and the share that is done [1].
    propose
        How many experiments to design, and within which limits; left out, none.

    Raises
    ------
    SettingsError
        Where the runs cannot be used, or limits forbid every experiment.

    Notes
    -----
    Source: docs/discovery.md; docs/model.md (100) to (118).
    """
    begun = time.perf_counter()
    with single_threaded():  # matrices are small
        finding = _discovered(campaign, seed, progress or _silent, propose)
    return replace(finding, seconds=time.perf_counter() - begun)


def _discovered(
    campaign: Campaign, seed: int, report: Callable[[str, float], None], propose: Asked | None
) -> Finding:
    report("reading the runs", 0.0)
    started = _started(campaign, None)
    report("fitting friction and compliance", 0.05)
    report("refitting each effect of the library", 0.25)
    work = _worked(campaign, started, seed)
    if _wants_laws(work):
        report("trying laws of their own", _LAWS_AT)
        bent = work.judged.bent
        work = _with_laws(campaign, started.runs, work, lambda step: report(step, _LAWS_AT))
        other = None if bent else _by_tension(campaign, started, work, report)
        again = None if other is None else _worked(campaign, other, seed)
        if other is not None and again is not None:
            if not _explains(again) or _wants_laws(again):
                again = _with_laws(campaign, other.runs, again, lambda step: report(step, _BY_TENSION_AT))
            if _explains(again) and (not _is_named(work) or _needs_nothing(again) or _position_errs(again)):
                started, work = other, again
    report("mapping where they disagree", 0.8)
    attribution = _attribution(started.runs, campaign, started.base)
    report("putting it together", 0.9)
    finding = _finding(campaign, started, work, attribution)
    if propose is not None:
        report("designing experiments", 0.92)
        finding = replace(finding, proposal=proposed(work, started.runs, campaign.rig, propose, seed))
    report("done", 1.0)
    return finding


def _explains(work: Work) -> bool:
    return work.judged.verdict != "unknown" and explained(work.chi2, work.chosen.problem.stack.size)


def _is_named(work: Work) -> bool:
    return work.judged.verdict != "unknown" and not work.judged.reason


def _needs_nothing(work: Work) -> bool:
    return explained(work.base.chi2, work.problem.stack.size)


def _position_errs(work: Work) -> bool:
    """Whether a law says what the position of the drive reads wrong."""
    terms = () if work.laws is None else work.laws.fit.terms
    return any(one.mechanism.name == "sensor_drift:displacement_in_m" for one in terms)


def _wants_laws(work: Work) -> bool:
    """Whether laws are to be tried: nothing is named, or too little by what was; docs/model.md (320)."""
    if work.judged.verdict == "unknown" or _leaves_something(work):
        return True
    return _may_be_wrong(work)


def _may_be_wrong(work: Work) -> bool:
    """Whether a law without a formula promises more than the names, or a number of them is at its bound."""
    names = work.chosen.fit.at
    return names.at_bound or law_promises_more(work.problem, work.base, names)


@dataclass(frozen=True, slots=True)
class _Started:
    """Runs read with one drive, and the base fit to them."""

    runs: tuple[Reading, ...]
    notes: tuple[str, ...]
    problem: Problem
    errors: Errors
    base: Fit


def _started(campaign: Campaign, drive: Drive | None) -> _Started:
    runs, notes = readings(campaign, drive)
    problem, errors, base = base_fit([run for run in runs if not run.held_out], campaign.rig)
    return _Started(runs, notes, problem, errors, base)


def _by_tension(
    campaign: Campaign, started: _Started, work: Work, report: Callable[[str, float], None]
) -> _Started | None:
    """Start from the tension as drive where the position leaves more than the sensors explain, or errs.

    Where a part was named with the position, the tension is taken only if it needs none, or shows what the
    position itself reads wrong; docs/model.md (320).
    """
    runs, rows = started.runs, started.problem.stack.size
    if (
        runs[0].drive == "tension_in_N"
        or explained(started.base.chi2, rows)
        or (_is_named(work) and explained(work.chi2, rows) and not _position_errs(work))
    ):
        return None
    if any("tension_in_N" not in run.measured or len(run.measured) < 2 for run in runs):
        return None
    report("trying the tension as drive", _BY_TENSION_AT)
    result = _started(campaign, "tension_in_N")
    note = "The proximal tension drives the model: with the position as drive, no name explains the readings."
    return replace(result, notes=(*result.notes, note))


def _worked(campaign: Campaign, started: _Started, seed: int) -> Work:
    tried, absent = variants(started.problem.stack)
    held = held_out(started.runs, campaign.rig, started.base.at)
    first = (started.problem, started.errors, started.base)
    chosen = selected(first, tried, held, seed)
    verdict = judged((started.problem, started.base), chosen, chosen.errors.names, held)
    return Work(started.problem, started.base, chosen, held, verdict, absent)


def _leaves_something(work: Work) -> bool:
    """Whether a name leaves more than the sensors explain, so that a law of the same may leave less."""
    at = work.chosen.fit.at
    if not at.effects:
        return False
    held = work.held is not None and work.held.misfit(at) > UNINFORMATIVE
    return held or not explained(work.chosen.fit.chi2, work.chosen.problem.stack.size)


def _with_laws(
    campaign: Campaign, runs: tuple[Reading, ...], work: Work, report: Callable[[str], None]
) -> Work:
    """Return the work with laws and formulae together, where they help on what was not fitted; (191)."""
    tried, _ = variants(work.problem.stack)
    limits = detection_limits(work.problem.stack, campaign.rig)
    search = searched(work.problem, work.base, tried, work.held, limits, report)
    if not search.taken:
        return work
    judgement = judged_laws(search.problem, work.base, search.fit, work.held)
    named = work.judged.verdict != "unknown"
    if judgement.verdict == "unknown" or (named and not _better(work, search.fit)):
        return work
    try:
        posed(stacked(runs), campaign.rig, search.fit.point)
    except FitError:  # a little noise of the drive, and it finds no equilibrium
        return work
    return replace(work, laws=search, judged=judgement)


def _better(work: Work, laws: LawFit) -> bool:
    """Whether laws leave less than the names that were chosen, clearly so on held-out runs.

    Where the names may be wrong, all runs decide; docs/model.md (320).
    """
    names, held = work.chosen.fit, work.held
    fall = 0.0 if held is None else held.chi2(names.at) - held.chi2(laws.point)
    if _may_be_wrong(work):
        named = fitted(work.problem, names.at, ())
        return named is None or 2.0 * (laws.log_evidence - named.log_evidence) + fall > needed(laws)
    return fall > needed(laws) and laws.chi2 < names.chi2


_LAWS_AT, _BY_TENSION_AT = 0.6, 0.75  # shares of the work done then; chosen


def _silent(step: str, share: float) -> None:
    pass


def _attribution(runs: tuple[Reading, ...], campaign: Campaign, base: Fit) -> Attribution:
    """Map where the base model fails, over all runs."""
    whole, _ = posed(stacked(runs), campaign.rig, base.at)
    heat, where = heat_map(whole, base.at)
    along, gains = along_routes(whole, base.at, columns(whole, base.at, whole.left(base.at)))
    routes = {run.name: run.route.name for run in runs}
    return Attribution(heat, pointed(where, along, routes), along, gains)


def _finding(campaign: Campaign, started: _Started, work: Work, attribution: Attribution) -> Finding:
    runs, notes = started.runs, started.notes
    chosen, verdict = work.chosen, work.judged
    unknown = verdict.verdict == "unknown"
    whole = work.base if unknown else chosen.fit if work.laws is None else work.laws.fit
    fit = as_fit(whole) if isinstance(whole, LawFit) else whole
    effects = () if unknown else chosen_effects(work)
    if work.laws is not None:
        effects = law_candidates(work.laws, work.held)
    all_traces = traces(runs, campaign.rig, work.base.at, fit.at)
    base_words, of_base = base_ties(fit, campaign.rig)
    tied = [*(ties_of(chosen) if work.laws is None else ()), *of_base]
    problem = work.problem if unknown else chosen.problem if work.laws is None else work.laws.problem
    others = of_other_directions(problem.stack, fit.at.rig(problem.rig), fit.at.effects)
    base = base_estimates(problem, fit, others)
    named = [name_of(effect) for effect in chosen.fit.at.effects]
    along, gains = attribution.along, attribution.gains
    shapes = missing_shapes(work.problem, work.base, along, gains) if unknown else ()
    misfit = misfits(all_traces)
    close = [name for one in tied[:1] for name in one.tie.names if name not in named]
    close = close if work.laws is None else []
    text = sentence(verdict, effects, base, close, misfit)
    if verdict.verdict == "partial" and not verdict.reason:  # most of what held-out runs show
        text = f"{text} {remainder(held_out_change(misfit)[1])}"
    text = f"{text} {assumed(effects, runs)}".rstrip()
    return Finding(
        campaign=campaign,
        verdict=verdict.verdict,
        sentence=text,
        effects=effects,
        ties=tuple(one.tie for one in tied),
        breaks_tie=experiments(work, tied),
        unobservable=unobservable(chosen.steps[0].screening, work.absent, named),
        where=attribution.where,
        heat=attribution.heat,
        along=attribution.along,
        misfit=misfit,
        base=base,
        nominal=nominal(campaign.rig),
        base_tie=base_words,
        ranking=ranking(work, effects) if work.laws is None else law_ranking(work.laws, effects),
        missing_shapes=shapes,
        rig=updated(campaign.rig, fit.at),
        errors=of_fit(problem, whole, others),
        traces=all_traces,
        notes=(*notes, *refused(work)),
        seconds=0.0,
    )
