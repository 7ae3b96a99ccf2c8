"""Sparse regression of what the base model leaves on a library of columns (SINDy), by pysindy."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from importlib import import_module

import numpy as np

from benchmarks.discovery_residuals import Residual, held_out_ratio
from benchmarks.discovery_scores import Baseline

_THRESHOLD, _RIDGE = 0.3, 1e-3  # in units of noise, for columns of unit variance
_BY_CHANNEL = {
    ("one", "tension_in_N"): "tension_in_offset",
    ("one", "tension_out_N"): "tension_out_offset",
    ("tension", "tension_in_N"): "tension_in_gain",
    ("tension", "tension_out_N"): "tension_out_gain",
    ("other tension", "tension_out_N"): "load_cell_crosstalk",
    ("rate", "tension_out_N"): "channel_lag",
    ("rate", "tension_in_N"): "channel_lag",
}
_ELSEWHERE = {
    "one": "pretension_error",
    "tension": "series_compliance_proximal",
    "other tension": "series_compliance_distal",
    "rate": "channel_lag",
    "direction": "end_fitting_friction_proximal",
    "direction × tension": "hidden_bend",
    "direction × tension²": "load_dependent_friction",
    "direction × log speed": "velocity_dependent_friction",
    "speed": "viscous_drag",
    "loss": "asymmetric_friction",
    "direction × travel": "friction_drift",
    "late tension": "creep",
    "soft tension": "slack_take_up",
    "warming": "thermal_drift",
    "direction held": "backlash",
}


def by_sparse_regression(runs: Sequence[Residual]) -> Baseline:
    """Name the column with the largest weight, and carry all weights to the held-out runs."""
    pysindy = import_module("pysindy")
    fitted = [run for run in runs if not run.held_out]
    best, weights = ("", 0.0), {}
    for channel in runs[0].left:
        columns = [_columns(run, channel) for run in runs]
        seen = [told for told, run in zip(columns, runs, strict=True) if not run.held_out]
        stacked = {name: np.concatenate([told[name] for told in seen]) for name in columns[0]}
        scale = {name: float(np.std(told)) or 1.0 for name, told in stacked.items()}
        table = np.column_stack([told / scale[name] for name, told in stacked.items()])
        target = np.concatenate([run.left[channel] for run in fitted])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that nothing is left of a channel is an answer
            solver = pysindy.STLSQ(threshold=_THRESHOLD, alpha=_RIDGE).fit(table, target[:, None])
        found = dict(zip(stacked, np.ravel(solver.coef_), strict=True))
        weights[channel] = {name: value / scale[name] for name, value in found.items()}
        name = max(found, key=lambda key: abs(found[key]))
        if abs(found[name]) > best[1]:
            best = _BY_CHANNEL.get((name, channel), _ELSEWHERE[name]), abs(found[name])
    told = [{c: _sum(_columns(run, c), weights[c]) for c in run.left} for run in runs]
    return Baseline(best[0], held_out_ratio(runs, told))


def _sum(columns: dict[str, np.ndarray], weights: dict[str, float]) -> np.ndarray:
    return np.sum([weights[name] * told for name, told in columns.items()], axis=0)


def _columns(run: Residual, channel: str) -> dict[str, np.ndarray]:
    time, place = run.measured["time_s"], run.measured["displacement_in_m"]
    inner, outer = run.model["tension_in_N"], run.model["tension_out_N"]
    speed = np.gradient(run.model["elongation_m"] + run.model["displacement_out_m"], time)
    direction, moving = _direction(speed), np.abs(speed) > 1e-5
    own, other = (outer, inner) if channel == "tension_out_N" else (inner, outer)
    warm = run.measured.get("temperature_C", np.zeros_like(time))
    return {
        "one": np.ones_like(time),
        "tension": own,
        "other tension": other,
        "rate": np.gradient(own, time),
        "direction": direction * moving,
        "direction × tension": direction * own,
        "direction × tension²": direction * own**2,
        "direction × log speed": direction * np.log1p(np.abs(speed) / 1e-3),
        "speed": speed,
        "loss": np.abs(inner - outer),
        "direction × travel": direction * np.cumsum(np.abs(np.diff(place, prepend=place[0]))),
        "late tension": _late(time, own),
        "soft tension": np.exp(-own / 2.0),
        "warming": warm - warm[0],
        "direction held": direction,
    }


def _direction(speed: np.ndarray) -> np.ndarray:
    """Sign of the motion, held while the drive rests."""
    sign = np.sign(speed) * (np.abs(speed) > 1e-5)
    last = np.maximum.accumulate(np.where(sign != 0.0, np.arange(len(sign)), 0))
    return sign[last]


def _late(time: np.ndarray, value: np.ndarray, lag: float = 20.0) -> np.ndarray:
    late = value.copy()
    for i in range(1, len(value)):
        late[i] = value[i] + (late[i - 1] - value[i]) * np.exp(-(time[i] - time[i - 1]) / lag)
    return late - value
