"""What the calibrated machine predicts of measured runs: fitted on the same rows as the peers."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.real_tool import ARM, PRELOAD, ZERO
from benchmarks.run_cases import Case
from benchmarks.run_peers import Estimate, Prediction
from tssgeom.arrays import Vector
from tssgeom.identify.machine_calibration import calibrate_machine
from tssgeom.identify.machine_estimates import MachineCalibration
from tssgeom.identify.machine_run import machine_run, predicted, route_of_rig
from tssgeom.mechanism import Drive, End
from tssgeom.rig import Friction, GivenRoute, Rig, Tendon, with_values
from tssgeom.uncertain import UNKNOWNS, Uncertain, assumed

_PULLEY = 0.005  # m; half of the arm that the set's tensions assume
_UNKNOWN = ("tendon.compliance_per_N", "tendon.pretension_N", "route.angle_rad")
_LEAST = 5  # fitted rows of a run that is fitted
_BARS = 24
_OF_TOOL = ("end.radius_m", "end.stiffness_Nm_per_rad", "drive.friction_Nm")


def predictions(case: Case) -> Mapping[str, Prediction] | None:
    """Return what the calibrated machine predicts for a case; None where its rig is no machine."""
    if case.source == "davinci_tool":
        return _of(case, tool_machine(case))
    return _of(case, segment_machine(case)) if case.source == "tdcr_tendon_tip" else None


Machine = tuple[Rig, list[Uncertain], dict[str, Vector], dict[str, tuple[str, float, float]]]
"""Rig, what is not certain of it, channels on all rows, and by response its channel, factor and zero."""


def tool_machine(case: Case) -> Machine:
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
    return rig, uncertain, columns, answers


def segment_machine(case: Case) -> Machine:
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
    return rig, uncertain, columns, {"bending_angle_rad": ("joint_angle_rad", 1.0, 0.0)}


def _of(case: Case, machine: Machine) -> Mapping[str, Prediction]:
    rig, uncertain, columns, answers = machine
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
        for name, column in predicted(whole, fitted.rig, values, _BARS).items():
            if name in out:
                out[name][rows] = column
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
