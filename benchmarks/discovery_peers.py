"""Peers of `discover`: what the base model leaves of a campaign, and what others make of it.

Sparse regression on a library of columns (SINDy) is by pysindy, the Gaussian process, which names nothing, by
scikit-learn; both as far as they are installed (extra `baselines`).
"""

from __future__ import annotations

import sys
import tomllib
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from scipy.optimize import isotonic_regression, least_squares

from benchmarks.discovery_scores import Baseline, gap
from tests.tendon.steps import pretensioned_bars, step
from tssgeom.errors import ShapeError
from tssgeom.io.formats.files import open_recording
from tssgeom.rig import Friction, Rig, Tendon, read_rig
from tssgeom.route.geometry import measure
from tssgeom.route.observations import clean
from tssgeom.route.pieces import Arcs
from tssgeom.stream import Rejected

_BARS = 30
_TURN = 8.0  # times the noise of the drive: what a turn is
_CHANNELS = ("tension_in_N", "tension_out_N", "elongation_m", "displacement_out_m")

Columns = Mapping[str, np.ndarray]


@dataclass(frozen=True, slots=True)
class Residual:
    """One run beside the base model."""

    held_out: bool
    measured: Columns
    model: Columns
    """[m] What each channel should read by the base model."""
    left: Columns
    """[m] Measured less model, in units of the channel's noise [1]."""


def residuals(folder: Path) -> list[Residual]:
    """Fit friction and compliance to the runs that are not held out, and return what is left of all."""
    listed = tomllib.loads((folder / "campaign.toml").read_text(encoding="utf-8"))
    rig = read_rig(folder / listed["rig"])
    noise = rig.sensors["displacement_in_m"].noise
    runs = [(one, _quiet(_columns(folder / one["data"]), noise)) for one in listed["run"]]
    routes = {name: _pieces(folder / name, rig) for name in {one["shape"] for one in listed["run"]}}
    fitted = [(routes[one["shape"]], columns) for one, columns in runs if not one["held_out"]]
    rig = _refitted(rig, fitted)
    return [_residual(rig, routes[one["shape"]], columns, one) for one, columns in runs]


def held_out_ratio(runs: Sequence[Residual], corrections: Sequence[Columns]) -> float:
    """Return the misfit of the held-out runs after the corrections [1, in noise] over that before."""
    one = dict.fromkeys(runs[0].left, 1.0)
    before, after = {}, {}
    held = [(run, each) for run, each in zip(runs, corrections, strict=True) if run.held_out]
    for name in one:
        before[name] = _rms([run.left[name] for run, _ in held])
        after[name] = _rms([run.left[name] - each[name] for run, each in held])
    start = gap(before, one)
    return gap(after, one) / start if start > 0.0 else float("nan")


def _rms(parts: Sequence[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def _columns(file: Path) -> dict[str, np.ndarray]:
    table = np.genfromtxt(file, delimiter=",", names=True)
    return {name: table[name] for name in table.dtype.names or ()}


def _quiet(columns: dict[str, np.ndarray], noise: float) -> dict[str, np.ndarray]:
    return columns | {"displacement_in_m": without_flicker(columns["displacement_in_m"], _TURN * noise)}


def without_flicker(position: np.ndarray, turn: float) -> np.ndarray:
    """Return positions [m] that rise and fall without reversals below `turn` [m].

    A micrometre of noise in a dwell is a reversal to a model with friction, worth tenths of a newton: the
    first bit of tendon to slide back is short, and stiff. Between turns the course is the monotone one that
    is nearest.
    """
    quiet = _level(position, turn)
    ends = [0, *_turns(quiet, turn), len(position) - 1]
    for first, last in pairwise(ends):
        leg = slice(first, last + 1)
        quiet[leg] = isotonic_regression(quiet[leg], increasing=bool(quiet[last] >= quiet[first])).x
    return np.round(quiet, 9)  # a reversal of one rounding would count as a turn


def _level(position: np.ndarray, turn: float) -> np.ndarray:
    """Return positions with dwells of four samples and more at their mean."""
    level = position.copy()
    cuts = np.flatnonzero(np.abs(np.diff(position)) > 0.7 * turn) + 1
    for part in np.split(np.arange(len(position)), cuts):
        if len(part) >= 4:
            level[part] = position[part].mean()
    return level


def _turns(position: np.ndarray, turn: float) -> list[int]:
    """Return where the course turns back by more than `turn`."""
    turns, sign, peak = list[int](), 0, 0
    for i, value in enumerate(position):
        gone = value - position[peak]
        if sign == 0 and abs(gone) > turn:
            sign, peak = int(np.sign(gone)), i
        elif sign * gone > 0.0:
            peak = i
        elif sign and -sign * gone > turn:
            turns.append(peak)
            sign, peak = -sign, i
    return turns


def _pieces(file: Path, rig: Rig) -> Arcs:
    frame = next(iter(open_recording(file).frames))
    if isinstance(frame, Rejected):
        raise ShapeError(f"{file}: {frame.reason}")
    return measure(clean(frame.points, frame.stations), rig.shape.noise).arcs


def _predicted(rig: Rig, arcs: Arcs, positions: np.ndarray) -> dict[str, np.ndarray]:
    """Return what every channel should read; only here the model runs."""
    state, rows = pretensioned_bars(rig, arcs, _BARS), []
    for position in positions:
        state = step(state, arcs, rig, displacement_in=float(position))
        rows.append((state.tension_in, state.tension_out, state.elongation, state.displacement_out))
    return dict(zip(_CHANNELS, np.array(rows).T, strict=True))


def _with(rig: Rig, friction: float, compliance: float) -> Rig:
    tendon = Tendon(compliance_per_N=compliance, pretension_N=rig.tendon.pretension_N)
    return msgspec.structs.replace(rig, friction=Friction(coefficient=friction), tendon=tendon)


def _refitted(rig: Rig, runs: Sequence[tuple[Arcs, Columns]]) -> Rig:
    def left(scales: np.ndarray) -> np.ndarray:
        tried = _with(rig, rig.friction.coefficient * scales[0], rig.tendon.compliance_per_N * scales[1])
        return np.concatenate(
            [_flat(_left(tried, _predicted(tried, a, c["displacement_in_m"]), c)) for a, c in runs]
        )

    scales = least_squares(left, np.ones(2), diff_step=1e-3, xtol=1e-4, bounds=(0.3, 3.0)).x
    return _with(rig, rig.friction.coefficient * scales[0], rig.tendon.compliance_per_N * scales[1])


def _flat(left: Columns) -> np.ndarray:
    return np.concatenate(list(left.values()))


def _left(rig: Rig, model: Columns, measured: Columns) -> dict[str, np.ndarray]:
    return {
        name: (measured[name] - model[name]) / rig.sensors[name].noise
        for name in _CHANNELS
        if name in measured
    }


def _residual(rig: Rig, arcs: Arcs, measured: Columns, listed: Mapping[str, Any]) -> Residual:
    model = _predicted(rig, arcs, measured["displacement_in_m"])
    return Residual(bool(listed["held_out"]), measured, model, _left(rig, model, measured))


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
        columns = [_library(run, channel) for run in runs]
        fitted_columns = [each for each, run in zip(columns, runs, strict=True) if not run.held_out]
        stacked = {name: np.concatenate([each[name] for each in fitted_columns]) for name in columns[0]}
        scale = {name: float(np.std(each)) or 1.0 for name, each in stacked.items()}
        table = np.column_stack([each / scale[name] for name, each in stacked.items()])
        target = np.concatenate([run.left[channel] for run in fitted])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that nothing is left of a channel is an answer
            solver = pysindy.STLSQ(threshold=_THRESHOLD, alpha=_RIDGE).fit(table, target[:, None])
        coefficients = dict(zip(stacked, np.ravel(solver.coef_), strict=True))
        weights[channel] = {name: value / scale[name] for name, value in coefficients.items()}
        name = max(coefficients, key=lambda key: abs(coefficients[key]))
        if abs(coefficients[name]) > best[1]:
            best = _BY_CHANNEL.get((name, channel), _ELSEWHERE[name]), abs(coefficients[name])
    predicted = [{c: _sum(_library(run, c), weights[c]) for c in run.left} for run in runs]
    return Baseline(best[0], held_out_ratio(runs, predicted))


def _sum(columns: dict[str, np.ndarray], weights: dict[str, float]) -> np.ndarray:
    return np.sum([weights[name] * each for name, each in columns.items()], axis=0)


def _library(run: Residual, channel: str) -> dict[str, np.ndarray]:
    time, position = run.measured["time_s"], run.measured["displacement_in_m"]
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
        "direction × travel": direction * np.cumsum(np.abs(np.diff(position, prepend=position[0]))),
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


_POINTS = 300  # of the fitted runs; the work grows with the cube


def by_gaussian_process(runs: Sequence[Residual]) -> Baseline:
    """Learn the residual of each channel over the drive, the model's tensions and the speed."""
    fitted = [run for run in runs if not run.held_out]
    table = np.concatenate([_features(run) for run in fitted])
    centre, spread = table.mean(axis=0), table.std(axis=0)
    scale = np.where(spread > 0.0, spread, 1.0)  # a tension may stay at zero
    some = np.linspace(0, len(table) - 1, _POINTS).astype(int)
    predicted: list[dict[str, np.ndarray]] = [{} for _ in runs]
    for channel in runs[0].left:
        target = np.concatenate([run.left[channel] for run in fitted])
        process = _fitted(((table - centre) / scale)[some], target[some])
        for run, corrections in zip(runs, predicted, strict=True):
            corrections[channel] = process.predict((_features(run) - centre) / scale)
    return Baseline("", held_out_ratio(runs, predicted))


def _fitted(table: np.ndarray, target: np.ndarray) -> Any:
    processes, kernels = (import_module(f"sklearn.gaussian_process{part}") for part in ("", ".kernels"))
    kernel = kernels.ConstantKernel(10.0) * kernels.RBF(np.ones(table.shape[1])) + kernels.WhiteKernel(1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # lengths without bearing run to their bounds
        return processes.GaussianProcessRegressor(kernel, random_state=0).fit(table, target)


def _features(run: Residual) -> np.ndarray:
    time, position = run.measured["time_s"], run.measured["displacement_in_m"]
    speed = np.gradient(position, time)
    smooth = np.convolve(speed, np.full(5, 0.2), mode="same")
    return np.column_stack([position, run.model["tension_in_N"], run.model["tension_out_N"], smooth])


_PEERS = {
    "sparse regression (pysindy)": ("pysindy", by_sparse_regression),
    "Gaussian process (scikit-learn)": ("sklearn", by_gaussian_process),
}


def baselines(folder: Path) -> dict[str, Baseline]:
    """Return the result of each installed peer on a campaign; one that fails is printed, and left out."""
    installed = {name: work for name, (package, work) in _PEERS.items() if find_spec(package)}
    runs = residuals(folder) if installed else []
    predicted = dict[str, Baseline]()
    for name, work in installed.items():
        try:
            predicted[name] = work(runs)
        except (ValueError, ArithmeticError) as error:
            print(f"{name} fails on a campaign: {error}", file=sys.stderr)
    return predicted
