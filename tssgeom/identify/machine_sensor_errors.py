"""What the sensors of a machine read off the truth within their specification; docs/model.md (301).

A cell that is bent by what its data sheet allows reads a share too much over a part of its scale: it is no
gain, and no law.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.identify.machine_parameters import Parameter, bends_of
from tssgeom.identify.machine_problem import Problem
from tssgeom.identify.machine_run import MachineRun
from tssgeom.identify.prediction import sensor_bends
from tssgeom.rig import Sensor


def with_sensor_errors(
    problem: Problem, u: Vector, channels: Sequence[Mapping[str, Vector]]
) -> tuple[Problem, Vector]:
    """Return a problem in which the bends of sensors are fitted too, and its numbers.

    Parameters
    ----------
    problem, u
        What is fitted so far, and where it stands.
    channels
        What it predicts there, by run.
    """
    runs, made, bent = list(problem.runs), list[Parameter](), dict[str, Matrix]()
    for name in dict.fromkeys(each for run in runs for each in run.measured):
        sensor = problem.rig.sensors.get(name, Sensor())
        if sensor.nonlinearity * sensor.full_scale == 0.0:
            continue
        those = [k for k, run in enumerate(runs) if name in run.measured]
        bows = np.concatenate([sensor_bends(channels[k][name], sensor) / runs[k].noise[name] for k in those])
        _, size, turned = np.linalg.svd(bows, full_matrices=False)
        bent[name] = turned[size > 1.0].T  # that change χ² by more than one
        for k in those:
            own = sensor_bends(channels[k][name], sensor) @ bent[name]
            runs[k] = replace(runs[k], bends={**runs[k].bends, **_named(name, own, runs[k].measured)})
        made += bends_of(_key(name, m) for m in range(bent[name].shape[1]))
    longer = replace(problem, runs=tuple(runs), parameters=(*problem.parameters, *made), sensor_bends=bent)
    return longer, np.concatenate([u, np.zeros(len(made))])


def without_sensor_errors(run: MachineRun, problem: Problem, u: Vector) -> MachineRun:
    """Return a run that is not fitted less what its sensors are bent by, as the fitted runs show it."""
    values = {each.key: x for each, x in zip(problem.parameters, u, strict=True) if each.kind == "bends"}
    measured = dict(run.measured)
    for name, turned in problem.sensor_bends.items():
        if name in measured:
            size = turned @ np.array([values[_key(name, m)] for m in range(turned.shape[1])])
            measured[name] = measured[name] - sensor_bends(measured[name], problem.rig.sensors[name]) @ size
    return replace(run, measured=measured)


def _named(name: str, own: Matrix, channels: Mapping[str, Vector]) -> dict[str, Mapping[str, Vector]]:
    return {
        _key(name, m): {each: bow if each == name else np.zeros(len(bow)) for each in channels}
        for m, bow in enumerate(own.T)
    }


def _key(name: str, error: int) -> str:
    return f"{name} {error}"
