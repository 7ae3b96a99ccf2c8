"""The workflow on machines: base fit, parts, zeros of channels, and the finding.

Source: docs/machines.md, "What a machine lacks"; docs/model.md (196)-(198).
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.channel_names import unit_of
from tssgeom.errors import SettingsError
from tssgeom.identify.finding import Evidence, Finding
from tssgeom.identify.machine_design import proposed_of_machine
from tssgeom.identify.machine_evidence import (
    FittedModel,
    changes,
    contradicted,
    delta_bic,
    held_out_ratio,
    held_out_rises,
    modelled,
    own_numbers,
)
from tssgeom.identify.machine_finding import MachineCampaign, MachineWork, NamedZero
from tssgeom.identify.machine_fit import fit_from, start_of
from tssgeom.identify.machine_parameters import has_unknown_bends, parameters_of, route_numbers
from tssgeom.identify.machine_parts import parts_of
from tssgeom.identify.machine_problem import FIT, FitState, Problem, fitted_rows
from tssgeom.identify.machine_refit import without_zeros
from tssgeom.identify.machine_route_errors import with_own_route_errors, with_route_errors
from tssgeom.identify.machine_run import (
    MachineRun,
    straight_between_readings,
    thinned,
    turns_of,
)
from tssgeom.identify.machine_selection import PartSelection, selected_parts
from tssgeom.identify.machine_sensor_errors import with_sensor_errors
from tssgeom.identify.machine_straight import STRAIGHT, likelier, straight_fit
from tssgeom.identify.proposal import Asked
from tssgeom.identify.screening import stated_error
from tssgeom.rig import Sensor
from tssgeom.statistics import EVIDENCE_SCALE, NORMAL_95
from tssgeom.tendon.machine_simulation import drive_channels
from tssgeom.threads import single_threaded

_OWN = "only its zeros, its start, and the errors of a route that no other run has,"
_EVEN = (
    "The sheath is taken to bend evenly, since neither a shape nor route.bends says where it does; errors of "
    "friction and compliance do not count that. `tssgeom calibrate` fits the bends."
)
_SPLIT = 2
"""Pairs of pieces into which a run without two cycles is cut; chosen: quarters."""


def discover_machine(
    campaign: MachineCampaign,
    *,
    progress: Callable[[str, float], object] = lambda step, share: None,
    propose: Asked | None = None,
    seed: int = 0,
) -> Finding:
    """Find what the model of a machine lacks.

    Parameters
    ----------
    campaign
        Measured runs on their routes, and the nominal rig.
    progress
        Is called with each step and the share that is done [1].
    propose
        How many experiments to design, and within which limits; left out, none.
    seed
        Of these; the same seed gives the same experiments.

    Raises
    ------
    FitError
        Where the machine has no equilibrium at what is assumed of it.
    SettingsError
        Where every run is held out, or limits forbid every experiment.

    Notes
    -----
    Source: docs/model.md (196) to (198).
    """
    begun = time.perf_counter()
    with single_threaded():  # matrices are small
        work, notes = machine_work(campaign, progress)
        progress("putting it together", 0.9)
        finding = work.finding(notes)
        if propose is not None:
            progress("designing the next runs", 0.95)
            finding = replace(finding, proposal=proposed_of_machine(work, propose, seed))
    progress("done", 1.0)
    return replace(finding, seconds=time.perf_counter() - begun)


def machine_work(
    campaign: MachineCampaign, progress: Callable[[str, float], object] = lambda step, share: None
) -> tuple[MachineWork, tuple[str, ...]]:
    """Return what the steps of the workflow leave, and notes; arguments and errors of `discover_machine`."""
    progress("fitting what is not certain", 0.02)
    fitted, kept, said = parted_runs(campaign)
    if has_unknown_bends(fitted, campaign.rig):
        said = (*said, _EVEN)
    parameters = tuple(parameters_of(fitted, campaign.rig, campaign.uncertain))
    problem = Problem(fitted, campaign.rig, parameters, fitted_rows(fitted, held_out=False), FIT.bars)
    problem, state = fit_from(
        problem, start_of(problem), lambda share: progress("fitting", 0.15 * share), _with_errors
    )
    straight = straight_fit(problem, state, campaign.uncertain, _with_errors)
    if straight is not None:
        problem, state = straight
        fitted, kept = (tuple(map(straight_between_readings, runs)) for runs in (fitted, kept))
        said = (*said, STRAIGHT)
    kept = tuple(_with_own_errors(likelier(run, problem, state), problem, state) for run in kept)
    base = modelled(problem, state, (), kept)
    free = [each.key for each in parameters if each.kind == "rig"]
    parts = parts_of(campaign.rig, free, fitted)
    progress("refitting what may act", 0.2)
    chosen = selected_parts(
        base, parts, kept, lambda share: progress("refitting what may act", 0.2 + 0.6 * share)
    )
    progress("zeros of channels", 0.8)
    base, zeros = _zeros(chosen, kept)
    work = MachineWork(campaign, fitted, kept, base, chosen, zeros)
    return work, (*said, *(note for run in fitted for note in run.notes))


def _with_errors(problem: Problem, state: FitState) -> tuple[Problem, Vector]:
    """Return a problem with errors of routes and of sensors, as fine as its readings ask for, and its u."""
    problem, u = with_route_errors(problem.refined(state.u), state)
    return with_sensor_errors(problem, u, state.channels)


def _with_own_errors(run: MachineRun, problem: Problem, state: FitState) -> MachineRun:
    """Return a run that is held out with what the errors of routes do that no fitted run has; (286)."""
    model = FittedModel(problem, state, (), {}, {}, {})
    *of_fitted, numbers = route_numbers((*problem.runs, run))
    fitted = set(itertools.chain.from_iterable(of_fitted))
    known = [which for which, number in enumerate(numbers) if number in fitted]
    alone = problem.runs[0].routes[:1] if len(fitted) == 1 else ()  # whose error is that of all angles there
    shared = sum((each.total_angle_se / max(each.total_angle, 1e-12)) ** 2 for each in alone)
    there = model.on_known_routes(run)
    own, state = own_numbers(there, model.rig, fine=problem.fine)
    made = with_own_route_errors(there, model.rig, own.of_run(state.u, 0), known, shared)
    return replace(run, bends=made.bends)


def parted_runs(
    campaign: MachineCampaign,
) -> tuple[tuple[MachineRun, ...], tuple[MachineRun, ...], tuple[str, ...]]:
    """Return the runs that are fitted, those that are held out, and how that was decided, in a sentence.

    Raises
    ------
    SettingsError
        Where every run is held out.
    """
    each = max(FIT.least_of_each, FIT.most_of_all // len(campaign.runs))
    runs = [replace(thinned(run, each), held_out=np.zeros(0, dtype=bool)) for run in campaign.runs]
    runs = [replace(run, held_out=np.zeros(len(run.given["time_s"]), dtype=bool)) for run in runs]
    if len(runs) == 1 and campaign.held_out:
        raise SettingsError(f"{runs[0].name} is the only run and held out: leave at least one to fit")
    in_cycles = campaign.in_cycles or (runs[0].name if len(runs) == 1 else "")
    if in_cycles and not campaign.held_out:
        k = next(k for k, run in enumerate(runs) if run.name == in_cycles)
        mask, how = _every_other(runs[k])
        runs[k] = replace(runs[k], held_out=mask)
        return tuple(runs), (), (f"Held out: {how} of {in_cycles}.",)
    names = campaign.held_out or (runs[-1].name,)
    why = "as the campaign says" if campaign.held_out else "the last, since the campaign marks none"
    fitted = tuple(run for run in runs if run.name not in names)
    kept = tuple(run for run in runs if run.name in names)
    if not fitted:
        raise SettingsError("every run is held out: leave at least one to fit")
    return (
        fitted,
        kept,
        (f"Held out: {', '.join(names)}, {why}; {_OWN} are fitted to it.",),
    )


def _every_other(run: MachineRun) -> tuple[np.ndarray, str]:
    """Return which samples of one run are held out, and what they are in words."""
    motion = run.given[drive_channels(run.drive, run.tendons)[0]]
    edges = turns_of(motion)
    out = np.zeros(len(motion), dtype=bool)
    if len(edges) >= 5:
        for first in range(2, len(edges) - 1, 4):
            out[edges[first] + 1 : edges[min(first + 2, len(edges) - 1)] + 1] = True
        return out, f"every other one of {(len(edges) - 1) // 2} cycles"
    pieces = np.array_split(np.arange(len(motion)), 2 * _SPLIT)
    for piece in pieces[1::2]:
        out[piece] = True
    return out, "the second and the last quarter, since there are no two cycles,"


def _is_zero_clear(model: FittedModel, channel: str) -> bool:
    """Whether the zero of a channel, a mean over runs, is beyond its specification and its own error."""
    problem, u = model.problem, model.state.u
    which = [j for j, each in enumerate(problem.parameters) if (each.kind, each.key) == ("zero", channel)]
    values = np.array([(each.value(0.0), each.value(1.0)) for each in (problem.parameters[j] for j in which)])
    share = np.zeros(len(u))
    share[which] = np.diff(values, axis=1)[:, 0] / len(which)
    mean, slope = values[:, 0].mean() + share @ u, model.state.slope(problem)
    variance = share @ np.linalg.solve(slope.T @ slope + np.eye(len(u)), share)
    sensor = model.rig.sensors.get(channel, Sensor())
    return bool(abs(mean) > max(stated_error(sensor, sensor.noise), NORMAL_95 * math.sqrt(variance)))


def _zeros(chosen: PartSelection, kept: Sequence[MachineRun]) -> tuple[FittedModel, tuple[NamedZero, ...]]:
    """Return the base without the zeros that are named, and those: of forces and torques that answer."""
    model, named = chosen.model, list[NamedZero]()
    channels = [name for name in model.fitted if unit_of(name) in ("N", "Nm")]
    for channel in channels:
        both = without_zeros(model, [channel], kept)
        if both is None:
            continue
        gain, size = delta_bic(*both), max(changes(*both).values())
        ratio, rises = held_out_ratio(*both), held_out_rises(*both)
        evidence = Evidence(gain, EVIDENCE_SCALE.very_strong, size, ratio, -sum(rises.values()))
        if min(gain, evidence.total) <= evidence.threshold or size <= 1.0 or contradicted(rises):
            continue
        if _is_zero_clear(model, channel):
            named.append(NamedZero(channel, evidence))
    if not named:
        return chosen.base, ()
    before = without_zeros(chosen.base, [one.channel for one in named], kept)
    return (chosen.base if before is None else before[0]), tuple(named)
