"""What the calibrated machine, and `discover`, predict of measured runs, fitted as the peers are.

The rows that a case holds out are in no fit. `discover` holds out its own share of the fitted ones, to choose
by, and what it chose is fitted to all of these once more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from msgspec import structs

from benchmarks.real_sets import ARM, PRELOAD, ZERO
from benchmarks.run_laws import Case, Estimate, Prediction
from tssgeom.arrays import Vector
from tssgeom.errors import FitError, TssgeomError
from tssgeom.identify.fit_quality import ROBUST
from tssgeom.identify.machine_calibration import calibrate_machine
from tssgeom.identify.machine_discovery import machine_work
from tssgeom.identify.machine_estimates import MachineCalibration
from tssgeom.identify.machine_evidence import FittedModel, modelled
from tssgeom.identify.machine_finding import MachineCampaign, MachineWork
from tssgeom.identify.machine_fit import fit_round, fitted_again
from tssgeom.identify.machine_parameters import Parameter, parameters_of
from tssgeom.identify.machine_prediction import finely_predicted, predicted
from tssgeom.identify.machine_problem import fitted_rows
from tssgeom.identify.machine_run import MachineRun, machine_run
from tssgeom.mechanism import Drive, End, GivenRoute
from tssgeom.rig import Friction, Rig, Tendon, with_values
from tssgeom.tendon.machine import route_of_rig
from tssgeom.uncertain import UNKNOWNS, Uncertain, assumed

_PULLEY = 0.005  # m; half of the arm that the set's tensions assume
_UNKNOWN = ("tendon.compliance_per_N", "tendon.pretension_N", "route.angle_rad")
_LEAST = 5  # fitted rows of a run that is fitted
_COARSE = 24  # bars
_OF_TOOL = ("end.radius_m", "end.stiffness_Nm_per_rad", "drive.friction_Nm")


class Plan(NamedTuple):
    """How a case is put to a machine."""

    rig: Rig
    uncertain: list[Uncertain]
    columns: Mapping[str, Vector]
    """Channels of the machine, on all rows."""
    answers: Mapping[str, tuple[str, float, float]]
    """By response of the case: the channel that is it, and its factor and zero."""


def predictions(case: Case) -> Mapping[str, Prediction] | None:
    """Return what the calibrated machine predicts for a case; None where its rig is no machine."""
    if case.source == "davinci_tool":
        distal = _of(case, tool_by_angle(case))["tension_out_N"]
        return {**_of(case, tool_machine(case)), "tension_out_N": distal}
    return _of(case, segment_machine(case)) if case.source == "tdcr_tendon_tip" else None


def tool_machine(case: Case) -> Plan:
    """Return a cable loop with a joint: motor angle and joint torque are given, the others answer."""
    rig = Rig(
        friction=Friction(coefficient=0.1),
        drive=Drive(kind="loop", radius_m=_PULLEY),
        end=End(kind="joint", radius_m=UNKNOWNS["end.radius_m"].centre),
        route=GivenRoute(length_m=0.45, angle_rad=UNKNOWNS["route.angle_rad"].centre),
    )
    uncertain = [Uncertain(key, UNKNOWNS[key], stated=False) for key in (*_UNKNOWN, *_OF_TOOL)]
    uncertain.append(Uncertain("friction.coefficient", assumed("", 0.1, 0.03), stated=True))
    names = ("motor_angle_rad", "motor_torque_Nm", "joint_angle_rad")
    columns = {name: case.columns[name] for name in names}
    columns["joint_torque_Nm"] = -case.columns["joint_torque_Nm"]
    answers = {
        "tension_in_N": ("motor_torque_Nm", 1.0 / ARM, PRELOAD - ZERO / ARM),
        "joint_angle_rad": ("joint_angle_rad", 1.0, 0.0),
    }
    return Plan(rig, uncertain, columns, answers)


def tool_by_angle(case: Case) -> Plan:
    """Return the same loop with motor and joint angle given, whose torques at both ends answer."""
    plan = tool_machine(case)
    end = structs.replace(plan.rig.end, given="angle")
    answers = {
        "tension_in_N": plan.answers["tension_in_N"],
        "tension_out_N": ("joint_torque_Nm", 1.0 / ARM, PRELOAD),
    }
    return plan._replace(rig=structs.replace(plan.rig, end=end), answers=answers)


def segment_machine(case: Case) -> Plan:
    """Return a pair on a joint for a segment in its plane: the displacement is given, the bending answers."""
    radius = case.known["radius_m"]
    rig = Rig(
        tendon=Tendon(pretension_N=5.0),
        drive=Drive(kind="pair", radius_m=_PULLEY),
        end=End(kind="joint", radius_m=radius, stiffness_Nm_per_rad=0.1),
        route=GivenRoute(length_m=0.5, angle_rad=UNKNOWNS["route.angle_rad"].centre),
    )
    uncertain = [Uncertain(key, UNKNOWNS[key], stated=False) for key in (*_UNKNOWN, "drive.play_rad")]
    uncertain.append(Uncertain("end.radius_m", assumed("", radius, 0.3 * radius), stated=True))
    columns = {
        "motor_angle_rad": case.columns["displacement_in_m"] / _PULLEY,
        "joint_angle_rad": case.columns["bending_angle_rad"],
    }
    return Plan(rig, uncertain, columns, {"bending_angle_rad": ("joint_angle_rad", 1.0, 0.0)})


def _of(case: Case, plan: Plan) -> Mapping[str, Prediction]:
    rig, uncertain, columns, answers = plan
    channels = tuple(name for name, _, _ in answers.values())
    fitted, out = _fitted(case, rig, uncertain, channels, columns)
    made = _estimates(fitted)
    return {
        response: Prediction(zero + factor * out[name], made)
        for response, (name, factor, zero) in answers.items()
    }


def _fitted(
    case: Case,
    rig: Rig,
    uncertain: list[Uncertain],
    answers: tuple[str, ...],
    table: Mapping[str, Vector],
) -> tuple[MachineCalibration, dict[str, Vector]]:
    """Fit a machine to the fitted rows of all runs; return it, and its answers on all rows."""
    nominal = with_values(rig, {each.key: each.prior.centre for each in uncertain})
    route, runs = [route_of_rig(nominal)], list[tuple[slice, dict[str, Vector]]]()
    for rows in case.runs():
        taken = {name: values[rows] for name, values in table.items()}
        runs.append((rows, {"time_s": case.columns["time_s"][rows], **taken}))
    used = [k for k, (rows, _) in enumerate(runs) if case.fitted[rows].sum() >= _LEAST]
    made = []
    for k in used:
        rows, taken = runs[k]
        known = {name: np.where(case.fitted[rows], taken[name], np.nan) for name in answers}
        made.append(machine_run(f"run {k}", taken | known, route, nominal))
    fitted = calibrate_machine(made, nominal, uncertain)
    keys = fitted.values[0]
    mean = {key: float(np.mean([values.get(key, 0.0) for values in fitted.values])) for key in keys}
    out = {name: np.full(len(case.run), np.nan) for name in answers}
    for k, (rows, taken) in enumerate(runs):
        values = fitted.values[used.index(k)] if k in used else mean
        whole = machine_run(f"run {k}", taken, route, nominal, most=len(taken["time_s"]))
        for name, column in predicted(whole, fitted.rig, values, _COARSE).items():
            if name in out:
                out[name][rows] = whole.at_readings(column)
    return fitted, out


def _estimates(fitted: MachineCalibration) -> tuple[Estimate, ...]:
    kept = [
        each
        for each in (*fitted.estimates, fitted.friction_angle)
        if each.identified and (each.key or each.name == "μΦ")
    ]
    return tuple(
        Estimate(each.key or "μΦ", "number", each.value, 0.5 * (each.high - each.low)) for each in kept
    )


_ROUND = 4.4  # μΦ of the band; its set's README has 4.1 to 4.7 as ln of the end forces
_LEVER = 1.9  # friction force over the difference of the end forces; the same, 0.0019 to 0.0020 kip/lb


@dataclass(frozen=True, slots=True)
class Discovered:
    """What was chosen, and what it predicts."""

    verdict: str
    parts: tuple[str, ...]
    predictions: Mapping[str, Prediction]
    base: Mapping[str, Prediction]
    """What the machine without parts predicts, fitted to the same rows."""


def plan_of(case: Case) -> Plan | None:
    """Return the machine of a case; None where there is none."""
    return {
        "davinci_tool": tool_machine,
        "tdcr_tendon_tip": segment_machine,
        "band_friction": _band,
        "tendon_stretch": _stretch,
    }[case.source](case)


def discovered(case: Case) -> Discovered | None:
    """Return what `discover` makes of a case; None where its runs are too short for it."""
    plan = plan_of(case)
    if plan is None:
        return None
    try:
        return _discovered(case, plan)
    except TssgeomError as error:
        print(f"{case.name}: discover: {error}", flush=True)
        return None


def _discovered(case: Case, plan: Plan) -> Discovered:
    rig = with_values(plan.rig, {each.key: each.prior.centre for each in plan.uncertain})
    channels = [name for name, _, _ in plan.answers.values()]
    whole, known = list[tuple[slice, MachineRun]](), list[MachineRun]()
    for k, rows in enumerate(case.runs()):
        taken = {"time_s": case.columns["time_s"][rows]}
        taken |= {name: values[rows] for name, values in plan.columns.items()}
        made = machine_run(f"run {k}", taken, [route_of_rig(rig)], rig, most=len(taken["time_s"]))
        whole.append((rows, made))
        if case.fitted[rows].sum() >= _LEAST:
            last = int(np.flatnonzero(case.fitted[rows])[-1]) + 1  # of a run, what comes later is not used
            used = {
                name: np.where(case.fitted[rows], values, np.nan)[:last]
                if name in channels
                else values[:last]
                for name, values in taken.items()
            }
            known.append(machine_run(f"run {k}", used, [route_of_rig(rig)], rig))
    work, _ = machine_work(MachineCampaign(case.name, rig, tuple(plan.uncertain), tuple(known)))
    model = fitted_to_all(work)
    plain = fitted_to_all(replace(work, chosen=replace(work.chosen, model=work.chosen.base)))
    parts = tuple(part.label for part in model.parts)
    names = [run.name for run in (*work.fitted, *work.kept)]
    return Discovered(
        work.finding(()).verdict,
        parts,
        _predictions(case, plan, model, whole, names),
        _predictions(case, plan, plain, whole, names),
    )


def fitted_to_all(work: MachineWork) -> FittedModel:
    """Fit what was chosen once more, to everything that was held out too."""
    model = work.chosen.model
    runs = (*work.fitted, *work.kept)
    runs = tuple(replace(run, held_out=np.zeros_like(run.held_out)) for run in runs)
    every = parameters_of(runs, work.campaign.rig, work.campaign.uncertain)
    own = [each for each in every if each.kind != "rig"]
    of_gain = [each for each in every if each.key == "route.angle_gain"]  # not of one route any more
    fitted = [each for each in model.problem.parameters if each.kind in ("rig", "law")]
    shared = [each for each in fitted if each.key != "route.angle_gain"] + of_gain

    def named(each: Parameter) -> tuple[str, str, int]:
        name = each.name if each.kind == "law" else each.key
        return (each.kind, name, -1 if each.kind == "route" else each.run)

    at = {named(each): u for each, u in zip(model.problem.parameters, model.state.u, strict=True)}
    parameters = (*shared, *own)
    start = np.array([at.get(named(each), 0.0) for each in parameters])
    rows = fitted_rows(runs, held_out=None)
    problem = replace(model.problem, runs=runs, parameters=parameters, rows=rows, too_few_bars=())
    channels = problem.model(start)
    if channels is None:
        raise FitError("the machine has no equilibrium at the numbers of its fit")
    state = fit_round(problem, start, *problem.weights(problem.left(channels)))
    for _ in range(ROBUST.rounds):
        problem, state = fitted_again(problem, state)
    return modelled(problem, state, model.parts, ())


def _predictions(
    case: Case, plan: Plan, model: FittedModel, whole: list[tuple[slice, MachineRun]], names: list[str]
) -> dict[str, Prediction]:
    """Return the responses on all rows; a run that was not fitted has the mean zeros and start of those."""
    of_runs = [model.problem.of_run(model.state.u, k) for k in range(len(names))]
    mean = {key: float(np.mean([each[key] for each in of_runs])) for key in of_runs[0]}
    out = {name: np.full(len(case.run), np.nan) for name, _, _ in plan.answers.values()}
    for rows, run in whole:
        values = of_runs[names.index(run.name)] if run.name in names else mean
        zeroed = run.name not in names and case.responses[0].zeroed and len(case.responses) == 1
        if zeroed:  # both count from the first row
            values = {key: 0.0 if "zero" in key[0] else value for key, value in mean.items()}
        bars = (model.problem.fine, model.problem.bars)
        for name, samples in finely_predicted(run, model.rig, values, *bars).items():
            column = run.at_readings(samples)
            out[name][rows] = column - column[0] if zeroed else column
    made = tuple(
        Estimate(each.name, "number", each.value(u), np.nan)
        for each, u in zip(model.problem.parameters, model.state.u, strict=True)
        if ": " in each.name
    )
    return {
        response: Prediction(zero + factor * out[name], made)
        for response, (name, factor, zero) in plan.answers.items()
    }


def _band(case: Case) -> Plan:
    """Return a band whose ends one frame carries round a drum; wrap and lever are not known."""
    rig = Rig(
        tendon=Tendon(pretension_N=300.0, compliance_per_N=1e-5),
        friction=Friction(coefficient=0.3),
        drive=Drive(radius_m=1.0),
        end=End(kind="carried"),
        route=GivenRoute(length_m=1.0, angle_rad=_ROUND / 0.3),
    )
    uncertain = [
        Uncertain("tendon.pretension_N", assumed("", 300.0, 300.0), stated=True),
        Uncertain("tendon.compliance_per_N", assumed("", 1e-5, 1e-5), stated=True),
        Uncertain("route.angle_rad", assumed("", _ROUND / 0.3, 0.5 * _ROUND / 0.3), stated=True),
        Uncertain("sensors.motor_torque_Nm.gain", assumed("", _LEVER, 0.5), stated=True),
    ]
    columns = {
        "motor_angle_rad": -case.columns["displacement_in_m"],
        "tension_in_N": case.columns["force_1_N"],
        "tension_out_N": case.columns["force_2_N"],
        "motor_torque_Nm": -case.columns["friction_force_N"],
    }
    answers = {
        "friction_force_N": ("motor_torque_Nm", -1.0, 0.0),
        "force_1_N": ("tension_in_N", 1.0, 0.0),
        "force_2_N": ("tension_out_N", 1.0, 0.0),
    }
    return Plan(rig, uncertain, columns, answers)


def _stretch(case: Case) -> Plan:
    """Return a tendon between two clamps, without a sheath that rubs."""
    length = case.columns["length_m"]
    first = float(length[0])
    rig = Rig(
        tendon=Tendon(pretension_N=1.0, compliance_per_N=0.01),
        friction=Friction(coefficient=0.0),
        end=End(kind="blocked"),
        route=GivenRoute(length_m=first, angle_rad=0.0),
    )
    uncertain = [
        Uncertain("tendon.pretension_N", assumed("", 2.0, 4.0), stated=True),
        Uncertain("tendon.compliance_per_N", assumed("", 0.01, 0.03), stated=True),
    ]
    columns = {"displacement_in_m": length - first, "tension_in_N": case.columns["force_N"]}
    return Plan(rig, uncertain, columns, {"force_N": ("tension_in_N", 1.0, 0.0)})
