"""Real measurements that nobody here made, beside what a user would do instead.

    python -m benchmarks.real [shapes | runs] [--quick] [--markdown]

The sets are read from ../shared/data, where each states its source and licence; one that is absent has
a line that states it. Without a part both are measured: `shapes` compares shapes, `runs` the error of
motor torques, joint angles and forces on cycles that were not fitted. `--quick` takes every tenth shape, and
fewer rows and runs.

Every method is fitted to the same rows of runs and judged on the same held-out ones. `signal` is the standard
deviation of the held-out response, and `cycle` the error of repeating the mean of the fitted cycles, where
the drive repeats: a law of the drive alone hardly does better.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from scipy.optimize import least_squares, nnls

from benchmarks import ABSENT, machine, number, options_parser, table
from benchmarks.real_sets import (
    BAND,
    ROBOTS,
    STRETCH,
    TOOL,
    band_cases,
    robot_cases,
    stretch_cases,
    tool_cases,
)
from benchmarks.real_shapes import show_shapes
from benchmarks.run_laws import (
    LAWS,
    Case,
    Data,
    Estimate,
    Law,
    Mask,
    Prediction,
    Response,
    mean_cycle_error,
)
from benchmarks.run_machines import Discovered, discovered
from benchmarks.run_machines import predictions as ours
from tssgeom.arrays import Matrix, Vector
from tssgeom.channel_names import unit_of, words_of
from tssgeom.statistics import NORMAL_95

_UNITS = {"rad": ("°", 180.0 / math.pi), "m": ("mm", 1e3), "N": ("N", 1.0)}
_SOURCES = (
    ("a cable-driven instrument (davinci_tool)", TOOL, tool_cases),
    ("segments of two continuum robots (tdcr_tendon_tip)", ROBOTS, robot_cases),
    ("stretched tendons (tendon_stretch)", STRETCH, stretch_cases),
    ("a band round a drum (band_friction)", BAND, band_cases),
)
_STARTS = 3  # best of the starting values, that are refined
_CORRELATION = 0.98  # at most; a higher one cannot be estimated from one run
_DIFFERENCE = 1e-3  # of a nonlinear parameter; the kinks of a play hide a smaller one
_EVALUATIONS = 40  # of the residual, of each start

Fits = Mapping[tuple[str, str], Mapping[str, Prediction]]


def show_runs(*, quick: bool, markdown: bool) -> None:
    """Print held-out errors and parameters of every set."""
    for name, folder, cases_of in _SOURCES:
        if not folder.exists():
            print(f"\n{name}: left out, {folder.name} is not beside the project")
            continue
        cases = cases_of(quick=quick)
        fits, made = dict[tuple[str, str], dict[str, Prediction]](), dict[str, Discovered]()
        for case in cases:
            model = ours(case) or {}
            fits |= {(case.name, each.column): fits_of(case, each, model) for each in case.responses}
            one = discovered(case)
            if one is not None:
                made[case.name] = one
        parts = [_errors(cases, fits, markdown=markdown), _discoveries(cases, fits, made, markdown=markdown)]
        parts.append(_parameters(cases, fits, markdown=markdown))
        print("\n" + "\n\n".join([name, *parts]), flush=True)


def fits_of(case: Case, response: Response, model: Mapping[str, Prediction]) -> dict[str, Prediction]:
    """Return what every method that applies predicts; `model` is what the calibrated machine does."""
    fits = {"tssgeom": model[response.column]} if response.column in model else {}
    laws = {name: fit(law, case, response) for name, law in LAWS.items()}
    return fits | {name: one for name, one in laws.items() if one is not None}


def rms(case: Case, column: str, prediction: Prediction, rows: Mask) -> float:
    """Return the error of a prediction over `rows` [SI]."""
    return float(np.sqrt(np.mean(np.square(prediction.values - case.columns[column])[rows])))


def _unit_of(column: str) -> tuple[str, float]:
    return _UNITS[unit_of(column)]


def _errors(cases: Sequence[Case], fits: Fits, *, markdown: bool) -> str:
    methods = [name for name in ("tssgeom", *LAWS) if any(name in each for each in fits.values())]
    rows = []
    for case in cases:
        for response in case.responses:
            column = response.column
            unit, scale = _unit_of(column)
            own = fits[case.name, column]
            signal = float(np.std(case.columns[column][case.held_out]))
            row = [case.name, f"{words_of(column)} [{unit}]", number(scale * signal)]
            row.append(number(scale * mean_cycle_error(case, column)))
            for name in methods:
                known = name in own
                row.append(number(scale * rms(case, column, own[name], case.held_out)) if known else ABSENT)
            rows.append(row)
    header = ["held-out rms", "response", "signal", "cycle", *methods]
    return table(header, rows, text_columns=2, markdown=markdown)


def _discoveries(cases: Sequence[Case], fits: Fits, made: Mapping[str, Discovered], *, markdown: bool) -> str:
    """Return held-out errors without and with what `discover` chose, beside the best peer."""
    rows = []
    for case in cases:
        one = made.get(case.name)
        for response in case.responses:
            column = response.column
            unit, scale = _unit_of(column)
            row = [case.name, f"{words_of(column)} [{unit}]"]
            peers = {
                name: rms(case, column, fits[case.name, column][name], case.held_out)
                for name in LAWS
                if name in fits[case.name, column]
            }
            best = min(peers, key=lambda name: peers[name])
            if one is None or column not in one.predictions:
                rows.append(
                    [*row, ABSENT, ABSENT, number(scale * peers[best]), ABSENT, f"{best}; no machine"]
                )
                continue
            before, after = (
                rms(case, column, each[column], case.held_out) for each in (one.base, one.predictions)
            )
            figures = [number(scale * each) for each in (before, after, peers[best])]
            chosen = ", ".join(one.parts) or "nothing"
            rows.append([*row, *figures, number(after / peers[best], 2), f"{best}; {one.verdict}: {chosen}"])
    header = ["discover, held-out rms", "response", "before", "after", "best peer", "ratio", "peer; verdict"]
    return table(header, rows, text_columns=2, markdown=markdown)


def _parameters(cases: Sequence[Case], fits: Fits, *, markdown: bool) -> str:
    rows = []
    for case in cases:
        for response in case.responses:
            for name, one in fits[case.name, response.column].items():
                _, scale = _unit_of(response.column)
                fitted = number(scale * rms(case, response.column, one, case.fitted))
                texts = ", ".join(_written(each, response) for each in one.parameters if each.value != 0.0)
                rows.append([case.name, words_of(response.column), name, fitted, texts])
    header = ["parameters ± half of 95 %", "response", "method", "rms fitted", ""]
    return table(header, rows, text_columns=5, markdown=markdown)


def _written(estimate: Estimate, response: Response) -> str:
    moved, moved_scale = _unit_of(response.drive)
    unit, scale = _unit_of(response.column)
    text, factor = {
        "drive": (f" {moved}", moved_scale),
        "response": (f" {unit}", scale),
        "gain": ("" if unit == moved else f" {unit}/{moved}", scale / moved_scale),
        "time": (" s", 1.0),
        "number": ("", 1.0),
    }[estimate.kind]
    value = f"{estimate.name} {number(factor * estimate.value)}"
    if math.isnan(estimate.half_width):
        return f"{value}{text} (at its bound)"
    return f"{value} ± {number(factor * estimate.half_width, 2)}{text}"


def fit(law: Law, case: Case, response: Response) -> Prediction | None:
    """Fit a law to the fitted rows; None where it does not apply or has more parameters than rows."""
    if not law.needs(response):
        return None
    data, half_range = _data_of(case, response)
    target = case.columns[response.column]
    starts = [np.array(start) for start in law.starts]
    try:
        costs = [float(np.square(_Solved(law, data, target, start).residual).sum()) for start in starts]
    except _TooFewRowsError:
        return None
    best = [starts[i] for i in np.argsort(costs)[: _STARTS if law.nonlinear else 1]]
    fits = [_Solved(law, data, target, _refined(law, data, target, start)) for start in best]
    solved = min(fits, key=lambda one: float(np.square(one.residual).sum()))
    return Prediction(solved.values, _estimates(law, solved, data, half_range))


class _TooFewRowsError(ValueError):
    pass


class _Solved:
    """The linear parameters at given nonlinear ones."""

    def __init__(self, law: Law, data: Data, target: Vector, theta: Vector) -> None:
        columns = np.column_stack(law.columns(data, theta))
        fitted = columns[data.fitted]
        if len(fitted) <= fitted.shape[1] + len(theta):
            raise _TooFewRowsError
        scale = np.maximum(np.sqrt(np.mean(np.square(fitted), axis=0)), 1e-12)
        solve = partial(_one_sign, count=len(law.gains)) if law.one_sign else _free
        self.theta = theta
        self.factors: Vector = solve(fitted / scale, target[data.fitted]) / scale
        self.columns = columns
        self.values: Vector = columns @ self.factors
        self.residual: Vector = self.values[data.fitted] - target[data.fitted]


def _free(columns: Matrix, target: Vector) -> Vector:
    return np.asarray(np.linalg.lstsq(columns, target, rcond=1e-9)[0], dtype=np.float64)


def _one_sign(columns: Matrix, target: Vector, count: int) -> Vector:
    """Solve with the first factors all positive, or all negative where that fits better."""
    gains, free = columns[:, :count], columns[:, count:]
    basis = np.linalg.qr(free)[0]
    rest, left = gains - basis @ (basis.T @ gains), target - basis @ (basis.T @ target)
    tried = [(nnls(sign * rest, left), sign) for sign in (1.0, -1.0)]
    (factors, _), sign = min(tried, key=lambda one: one[0][1])
    others = _free(free, target - gains @ (sign * factors)) if free.shape[1] else np.zeros(0)
    return np.concatenate([sign * factors, others])


def _refined(law: Law, data: Data, target: Vector, start: Vector) -> Vector:
    if not law.nonlinear:
        return start
    low, high = _bounds(law)
    return least_squares(
        lambda theta: _Solved(law, data, target, theta).residual,
        np.clip(start, low + 1e-9, high - 1e-9),
        bounds=(low, high),
        x_scale=np.maximum(np.abs(start), 0.02),
        diff_step=_DIFFERENCE,
        max_nfev=_EVALUATIONS,
    ).x


def _bounds(law: Law) -> tuple[Vector, Vector]:
    return np.array([each.low for each in law.nonlinear]), np.array([each.high for each in law.nonlinear])


def _data_of(case: Case, response: Response) -> tuple[Data, float]:
    """Return the case in units of the drive's half range, and that range [SI]."""
    drive = case.columns[response.drive]
    low, high = drive[case.fitted].min(), drive[case.fitted].max()
    half_range = 0.5 * float(high - low)
    centre = 0.0 if response.zeroed else 0.5 * (low + high)
    others = [_from_its_middle(case.columns[name], case.fitted) for name in response.others]
    varying = [values for values in others if values is not None]
    given = np.column_stack(varying) if varying else np.zeros((len(drive), 0))
    time, runs = case.columns["time_s"], tuple(case.runs())
    scaled = (drive - centre) / half_range
    return Data(scaled, time, runs, given, case.fitted, response.resists, response.zeroed), half_range


def _from_its_middle(values: Vector, fitted: Mask) -> Vector | None:
    low, high = values[fitted].min(), values[fitted].max()
    return None if high == low else (2.0 * values - low - high) / (high - low)


def _estimates(law: Law, solved: _Solved, data: Data, half_range: float) -> tuple[Estimate, ...]:
    """Return the parameters that have a meaning, with intervals by the delta method."""
    low, high = _bounds(law)
    inside = (solved.theta > low + 1e-6) & (solved.theta < high - 1e-6)
    gains = solved.factors[: len(law.gains)]
    used = np.concatenate([inside, solved.factors != 0.0])
    covariance = _covariance(law, data, solved, used)
    error = NORMAL_95 * np.sqrt(np.where(used, np.diag(covariance), np.nan))
    estimates = list[Estimate]()
    for k, each in enumerate(law.nonlinear):
        scale = half_range if each.kind == "drive" else 1.0
        estimates.append(Estimate(each.name, each.kind, scale * solved.theta[k], scale * error[k]))
    count = len(law.nonlinear)
    for k, name in enumerate(law.gains):
        estimates.append(Estimate(name, "gain", gains[k] / half_range, error[count + k] / half_range))
    if law.slides:
        slope = np.zeros(len(used))
        slope[[0, count]] = gains[0], solved.theta[0]
        width = NORMAL_95 * math.sqrt(slope @ covariance @ slope)
        estimates.append(Estimate("force", "response", gains[0] * solved.theta[0], width))
    return tuple(estimates)


def _covariance(law: Law, data: Data, solved: _Solved, used: Mask) -> Matrix:
    """Return the covariance of nonlinear parameters and factors; zero for what is not `used`."""
    slopes = list[Vector]()
    for k, value in enumerate(solved.theta):
        step = _DIFFERENCE * max(abs(float(value)), 0.02)
        moved = solved.theta.copy()
        moved[k] += step if value + step < law.nonlinear[k].high else -step
        columns = np.column_stack(law.columns(data, moved))
        slopes.append((columns - solved.columns) @ solved.factors / (moved[k] - value))
    jacobian = np.column_stack([*slopes, solved.columns])[data.fitted][:, used]
    residual = solved.residual
    degrees = len(residual) - jacobian.shape[1]
    own = float(residual @ residual)
    shared = float(residual[1:] @ residual[:-1]) / own if own > 0.0 else 0.0
    correlation = min(max(shared, 0.0), _CORRELATION)
    variance = own / degrees * (1.0 + correlation) / (1.0 - correlation)
    size = np.linalg.norm(jacobian, axis=0)
    scale = np.where(size > 0.0, size, 1.0)
    unit = jacobian / scale
    inverse = np.linalg.pinv(unit.T @ unit, hermitian=True) / np.outer(scale, scale)
    covariance = np.zeros((len(used), len(used)))
    covariance[np.ix_(used, used)] = variance * inverse
    return covariance


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark and return the exit code."""
    options = _options(arguments)
    print(machine())
    broken = 0
    if options.part != "runs":
        broken = show_shapes(quick=options.quick, markdown=options.markdown)
    if options.part != "shapes":
        show_runs(quick=options.quick, markdown=options.markdown)
    return 1 if broken else 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = options_parser(__doc__, "fewer shapes, runs and rows")
    parser.add_argument("part", nargs="?", choices=["shapes", "runs"], help="what is measured; both without")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
