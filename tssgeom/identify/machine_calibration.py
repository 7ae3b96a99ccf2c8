"""Calibration of any machine from any runs: the fit, a check of the clocks, and what is held out.

Source: docs/model.md (179)-(183), (322).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from tssgeom.errors import FitError
from tssgeom.identify.machine_bends import followed
from tssgeom.identify.machine_estimates import MachineCalibration, MachineEstimate, calibration_of
from tssgeom.identify.machine_evidence import modelled
from tssgeom.identify.machine_fit import fit_from, fit_round, fitted_again, start_of
from tssgeom.identify.machine_held_out import cycles_held_out, runs_held_out
from tssgeom.identify.machine_parameters import parameters_of, with_unknown_bends
from tssgeom.identify.machine_parts import DRIVE_LAG, Part, drive_lag, presliding
from tssgeom.identify.machine_prediction import predicted
from tssgeom.identify.machine_problem import FIT, FitState, Problem, fit_bars, fitted_rows
from tssgeom.identify.machine_run import MachineRun, load_remarks, thinned, with_drive_known
from tssgeom.identify.machine_selection import part_step
from tssgeom.identify.machine_steps import TriedPart
from tssgeom.identify.machine_straight import STRAIGHT, straight_fit
from tssgeom.rig import Rig
from tssgeom.threads import single_threaded
from tssgeom.uncertain import Uncertain


def calibrate_machine(
    runs: Sequence[MachineRun],
    rig: Rig,
    uncertain: Sequence[Uncertain] = (),
    *,
    progress: Callable[[str, float], object] = lambda step, share: None,
) -> MachineCalibration:
    """Fit what is not certain of a machine to runs of it.

    Parameters
    ----------
    runs
        Runs of the same machine, each on its routes.
    rig
        The machine, with the centre of what is assumed where a number is not certain.
    uncertain
        What is not certain of the rig; friction and compliance never are.
    progress
        Called with each step and the share of the work that is done [1].

    Raises
    ------
    FitError
        Where the model has no equilibrium at what is assumed.
    """
    with single_threaded():
        return _calibrated(runs, rig, uncertain, progress)


def _calibrated(
    runs: Sequence[MachineRun],
    rig: Rig,
    uncertain: Sequence[Uncertain],
    progress: Callable[[str, float], object],
) -> MachineCalibration:
    each = max(FIT.least_of_each, FIT.most_of_all // len(runs))
    runs = [thinned(run, each) for run in runs]
    rig, uncertain = with_unknown_bends(runs, rig, uncertain)
    parameters = tuple(parameters_of(runs, rig, uncertain))
    problem = Problem(tuple(runs), rig, parameters, fitted_rows(runs, held_out=False), fit_bars(rig))
    progress("start", 0.0)
    with suppress(FitError):  # what is wrong with the rig itself is said here
        for run in runs:
            predicted(run, rig, {}, FIT.bars)
    start = start_of(problem)
    problem, state = fit_from(
        problem, start, lambda share: progress("fit without the last cycles", 0.1 + 0.5 * share)
    )
    straight = straight_fit(problem, state, uncertain)
    problem, state = straight or (problem, state)
    progress("clock of the drive", 0.6)
    problem, state, notes = _with_drive_lag(problem, state)
    progress("contacts before they slide", 0.65)
    problem, state, more = _with_presliding(problem, state)
    if any(run.held_out.any() for run in runs):
        held = cycles_held_out(problem, state)
        progress("fit of all cycles", 0.7)
        problem, state = fitted_again(replace(problem, rows=fitted_rows(problem.runs, held_out=None)), state)
    else:
        progress("each run without the others", 0.7)
        held = runs_held_out(problem, state)
    progress("intervals", 0.9)
    problem, state, valley = followed(problem, state)
    remarks = (each.text for each in load_remarks(runs, rig))
    said = (STRAIGHT,) if straight else ()
    made = calibration_of(problem, state, held, (*said, *notes, *more, *remarks), valley=valley)
    return replace(made, warnings=(*made.warnings, *bend_remarks(problem, state, made.estimates)))


def _with_drive_lag(problem: Problem, state: FitState) -> tuple[Problem, FitState, tuple[str, ...]]:
    """Fit the lag of the drive too where evidence and held-out cycles ask for it, and say so."""
    chosen = _asked_for(problem, state, drive_lag)
    if chosen is None:
        return problem, state, ()
    made, ratio = chosen.model, chosen.held_ratio
    lag = made.rig.drive.lag_s
    note = (
        f"the drive is recorded {abs(lag):.3g} s {'later' if lag > 0.0 else 'earlier'} than what answers, "
        f"fitted as {DRIVE_LAG}: ΔBIC {chosen.delta_bic:.0f}"
    )
    note += "" if math.isnan(ratio) else f", {ratio:.2g} of the rms on held-out cycles"
    runs = tuple(with_drive_known(run, lag) for run in made.problem.runs)
    again = replace(made.problem, runs=runs, rows=fitted_rows(runs, held_out=False))
    return *fitted_again(again, made.state), (f"{note}; a {DRIVE_LAG} in the rig fixes it",)


def _with_presliding(problem: Problem, state: FitState) -> tuple[Problem, FitState, tuple[str, ...]]:
    """Fit what contacts give before they slide too, where it would be taken for pretension, and say so.

    Two tendons that pull against each other feel T_0 μΦ wherever all slides. T_0 and μ show apart only in how
    tension builds up after a turn, and so do contacts that give way.
    """
    chosen = _asked_for(problem, state, presliding)
    if chosen is None:
        return problem, state, ()
    note = f"contacts give way before they slide, fitted as presliding: ΔBIC {chosen.delta_bic:.0f}"
    note += "; pretension and friction hang on it: measure one of them"
    return *fitted_again(chosen.model.problem, chosen.model.state), (note,)


def _asked_for(
    problem: Problem,
    state: FitState,
    parts_of: Callable[[Rig, Sequence[str], Sequence[MachineRun]], Iterable[Part]],
) -> TriedPart | None:
    """Return the part that evidence and held-out cycles ask for, if any, with its fit."""
    parts = tuple(parts_of(problem.rig, [each.key for each in problem.parameters], problem.runs))
    if not parts:
        return None
    base = modelled(problem, state, (), ())
    return part_step(base, base, parts, ()).chosen


def bend_remarks(problem: Problem, state: FitState, estimates: Sequence[MachineEstimate]) -> tuple[str, ...]:
    """Say which numbers an even bend puts outside of their intervals, and how much worse it fits; (322).

    Parameters
    ----------
    problem, state
        The fit, in which the shares of the angle may be fitted too.
    estimates
        What it gives.

    Returns
    -------
    One sentence, or none.
    """
    kept = np.array([each.kind != "share" for each in problem.parameters])
    even = _even(problem, state, kept) if not kept.all() else None
    if even is None:
        return ()
    made, fitted = even
    values = {
        each.key: each.value(u)
        for each, u in zip(made.parameters, fitted.u, strict=True)
        if each.kind == "rig"
    }
    moved = [
        f"{each.name} {values[each.key]:.4g}"
        for each in estimates
        if each.key in values and each.identified and not each.low <= values[each.key] <= each.high
    ]
    if not moved:
        return ()
    above = 2.0 * (fitted.objective - state.objective)
    return (
        "route.bends is not known, and numbers hang on it: with an even bend, whose χ² is "
        f"{above:.3g} above, {', '.join(moved)}; the intervals are those of the "
        "shares that are fitted alone and may miss the truth: state route.bends, or sense the shape",
    )


def _even(problem: Problem, state: FitState, kept: np.ndarray) -> tuple[Problem, FitState] | None:
    """Return the fit with an even bend, with the same weights; None without an equilibrium."""
    own = [each for each, there in zip(problem.parameters, kept, strict=True) if there]
    made = replace(problem, parameters=tuple(own), too_few_bars=())
    try:
        near = fit_round(made, state.u[kept], state.weight, state.inflation)
        made = made.corrected(near.u, near.channels)  # bars miss more or less than where the bends were
        return made, fit_round(made, near.u, state.weight, state.inflation)
    except FitError:
        return None
