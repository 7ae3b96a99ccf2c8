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
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from benchmarks import ABSENT, machine, number, options_parser, table
from benchmarks.real_sets import (
    BAND,
    RADIUS,
    ROBOTS,
    STRETCH,
    band_cases,
    read_robot,
    robot_cases,
    servo_lag,
    stretch_cases,
)
from benchmarks.real_shapes import show_shapes
from benchmarks.real_tool import TOOL, tool_cases
from benchmarks.run_laws import LAWS, Case, Mask, Response, mean_cycle_error
from benchmarks.run_machines import Discovered, discovered
from benchmarks.run_machines import predictions as ours
from benchmarks.run_peers import Estimate, Prediction, fit
from tssgeom.arrays import Vector

_UNITS = {"rad": ("°", 180.0 / math.pi), "m": ("mm", 1e3), "N": ("N", 1.0)}
_KIP, _INCH = 4448.2216, 0.0254  # N, m
_SOURCES = (
    ("a cable-driven instrument (davinci_tool)", TOOL, tool_cases),
    ("segments of two continuum robots (tdcr_tendon_tip)", ROBOTS, robot_cases),
    ("stretched tendons (tendon_stretch)", STRETCH, stretch_cases),
    ("a band round a drum (band_friction)", BAND, band_cases),
)
_PLAY_FITS = {  # of the set's README: g, w [mm], rms [degrees] of fitted and held-out rows
    "v4 segment 1": (0.93, 0.065, 0.56, 1.39),
    "v4 segment 2": (1.01, 0.11, 1.20, 2.35),
    "v4 segment 3": (1.18, 0.18, 2.2, 3.1),
    "v6 segment 1": (0.97, 0.02, 2.4, 0.8),
    "v6 segment 2": (1.15, 0.0, 1.2, 0.9),
    "v6 segment 3": (1.5, math.nan, math.nan, 27.0),
}
_STOP_FITS = {  # of the set's README: stiffness [kip/in], force and held-out rms [kip]
    "0.5Hz22lb": (10.3, 1.40, 0.22),
    "0.5Hz35lb": (14.0, 2.04, 0.33),
    "0.5Hz80lb": (17.9, 2.78, 0.37),
    "1Hz35lb": (14.6, 2.16, 0.46),
}

Fits = Mapping[tuple[str, str], Mapping[str, Prediction]]


def show_runs(*, quick: bool, markdown: bool) -> None:
    """Print held-out errors and parameters of every set, and its own figures beside its README's."""
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
        if folder == ROBOTS:
            parts += [_play_fits(cases, fits, markdown=markdown), _lags(cases)]
        if folder == BAND:
            parts.append(_stop_fits(cases, fits, markdown=markdown))
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
    return _UNITS[column.rpartition("_")[2]]


def _errors(cases: Sequence[Case], fits: Fits, *, markdown: bool) -> str:
    methods = [name for name in ("tssgeom", *LAWS) if any(name in each for each in fits.values())]
    rows = []
    for case in cases:
        for response in case.responses:
            column = response.column
            unit, scale = _unit_of(column)
            own = fits[case.name, column]
            signal = float(np.std(case.columns[column][case.held_out]))
            row = [case.name, f"{_title(column)} [{unit}]", number(scale * signal)]
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
            row = [case.name, f"{_title(column)} [{unit}]"]
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


def _title(column: str) -> str:
    return column.rpartition("_")[0].replace("_", " ")


def _parameters(cases: Sequence[Case], fits: Fits, *, markdown: bool) -> str:
    rows = []
    for case in cases:
        for response in case.responses:
            for name, one in fits[case.name, response.column].items():
                _, scale = _unit_of(response.column)
                fitted = number(scale * rms(case, response.column, one, case.fitted))
                texts = ", ".join(_written(each, response) for each in one.parameters if each.value != 0.0)
                rows.append([case.name, _title(response.column), name, fitted, texts])
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


def play_fit(case: Case, play: Prediction) -> tuple[float, float, float, float]:
    """Return gain over that of ideal geometry, play [mm], and rms [degrees] of fitted and held-out rows."""
    values = {each.name: each.value for each in play.parameters}
    errors = [
        math.degrees(rms(case, "bending_angle_rad", play, rows)) for rows in (case.fitted, case.held_out)
    ]
    return values["gain"] * RADIUS, 1e3 * values["w"], errors[0], errors[1]


def stop_fit(case: Case, stop: Prediction) -> tuple[float, float, float]:
    """Return stiffness [kip/in], force [kip] and rms of held-out rows [kip]."""
    values = {each.name: each.value for each in stop.parameters}
    error = rms(case, "friction_force_N", stop, case.held_out)
    return values["stiffness"] * _INCH / _KIP, values["force"] / _KIP, error / _KIP


def _play_fits(cases: Sequence[Case], fits: Fits, *, markdown: bool) -> str:
    rows = _beside(cases, fits, "bending_angle_rad", "play", play_fit, _PLAY_FITS)
    header = ["play, in brackets the set's README", "g", "w [mm]", "rms fitted [°]", "held out [°]"]
    return table(header, rows, text_columns=1, markdown=markdown)


def _stop_fits(cases: Sequence[Case], fits: Fits, *, markdown: bool) -> str:
    rows = _beside(cases, fits, "friction_force_N", "stop", stop_fit, _STOP_FITS)
    header = ["stop, in brackets the set's README", "stiffness [kip/in]", "force [kip]", "held out [kip]"]
    return table(header, rows, text_columns=1, markdown=markdown)


def _beside(
    cases: Sequence[Case],
    fits: Fits,
    column: str,
    method: str,
    figures: Callable[[Case, Prediction], Sequence[float]],
    known: Mapping[str, Sequence[float]],
) -> list[list[str]]:
    rows = []
    for case in cases:
        values = figures(case, fits[case.name, column][method])
        pairs = zip(values, known[case.name], strict=True)
        rows.append([case.name, *(f"{number(here)} ({number(there)})" for here, there in pairs)])
    return rows


def _lags(cases: Sequence[Case]) -> str:
    """Say at which lag of the servos the pulls of single tendons scatter least."""
    lags = np.arange(-0.3, 0.301, 0.01)
    lines = list[str]()
    for robot in dict.fromkeys(case.name.split()[0] for case in cases):
        left = 1e3 * servo_lag(read_robot(robot), lags)
        best = int(np.argmin(left))
        lines.append(
            f"{robot}, single pulls: rms of the tip {_at(lags, left, 0.0):.2f} mm,"
            f" {left[best]:.2f} mm with the servos read {lags[best]:+.2f} s later"
        )
    return "\n".join(lines)


def _at(x: Vector, y: Vector, where: float) -> float:
    return float(np.interp(where, x, y))


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
