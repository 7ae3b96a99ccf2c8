"""What the base model leaves of a campaign: the ground on which the peers stand."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from scipy.optimize import isotonic_regression, least_squares

from benchmarks.discovery_scores import gap
from tssgeom.errors import ShapeError
from tssgeom.io.formats.files import open_recording
from tssgeom.rig import Friction, Rig, Tendon, read_rig
from tssgeom.route.geometry import measure
from tssgeom.route.observations import clean
from tssgeom.route.pieces import Arcs
from tssgeom.stream import Rejected
from tssgeom.tendon.bars.bar_state import pretensioned_bars
from tssgeom.tendon.bars.base import step

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
    """Return the gap of the held-out runs after the corrections [1, in noise] over that before."""
    one = dict.fromkeys(runs[0].left, 1.0)
    before, after = {}, {}
    held = [(run, told) for run, told in zip(runs, corrections, strict=True) if run.held_out]
    for name in one:
        before[name] = _rms([run.left[name] for run, _ in held])
        after[name] = _rms([run.left[name] - told[name] for run, told in held])
    start = gap(before, one)
    return gap(after, one) / start if start > 0.0 else float("nan")


def _rms(parts: Sequence[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def _columns(file: Path) -> dict[str, np.ndarray]:
    table = np.genfromtxt(file, delimiter=",", names=True)
    return {name: table[name] for name in table.dtype.names or ()}


def _quiet(columns: dict[str, np.ndarray], noise: float) -> dict[str, np.ndarray]:
    return columns | {"displacement_in_m": without_flicker(columns["displacement_in_m"], _TURN * noise)}


def without_flicker(place: np.ndarray, turn: float) -> np.ndarray:
    """Return positions [m] that rise and fall without reversals below `turn` [m].

    A micrometre of noise in a dwell is a reversal to a model with friction, worth tenths of a newton: the
    first bit of tendon to slide back is short, and stiff. Between turns the course is the monotone one that
    is nearest.
    """
    quiet = _level(place, turn)
    ends = [0, *_turns(quiet, turn), len(place) - 1]
    for first, last in pairwise(ends):
        leg = slice(first, last + 1)
        quiet[leg] = isotonic_regression(quiet[leg], increasing=bool(quiet[last] >= quiet[first])).x
    return np.round(quiet, 9)  # a reversal of one rounding would count as a turn


def _level(place: np.ndarray, turn: float) -> np.ndarray:
    """Return positions with dwells of four samples and more at their mean."""
    level = place.copy()
    cuts = np.flatnonzero(np.abs(np.diff(place)) > 0.7 * turn) + 1
    for part in np.split(np.arange(len(place)), cuts):
        if len(part) >= 4:
            level[part] = place[part].mean()
    return level


def _turns(place: np.ndarray, turn: float) -> list[int]:
    """Return where the course turns back by more than `turn`."""
    found, sign, peak = list[int](), 0, 0
    for i, value in enumerate(place):
        gone = value - place[peak]
        if sign == 0 and abs(gone) > turn:
            sign, peak = int(np.sign(gone)), i
        elif sign * gone > 0.0:
            peak = i
        elif sign and -sign * gone > turn:
            found.append(peak)
            sign, peak = -sign, i
    return found


def _pieces(file: Path, rig: Rig) -> Arcs:
    frame = next(iter(open_recording(file).frames))
    if isinstance(frame, Rejected):
        raise ShapeError(f"{file}: {frame.reason}")
    return measure(clean(frame.points, frame.stations), rig.shape.noise).arcs


def _predicted(rig: Rig, arcs: Arcs, positions: np.ndarray) -> dict[str, np.ndarray]:
    """Return what every channel should read; the one place that runs the model."""
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


def _residual(rig: Rig, arcs: Arcs, measured: Columns, told: Mapping[str, Any]) -> Residual:
    model = _predicted(rig, arcs, measured["displacement_in_m"])
    return Residual(bool(told["held_out"]), measured, model, _left(rig, model, measured))
