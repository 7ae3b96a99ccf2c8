"""Sound runs of two rigs, and what laboratories do to such runs by mistake."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.lumped import Distal, Drive, Physics, Sensor, from_pieces, measure, simulate
from tssgeom.io.formats.runs import IN_SI, read_run
from tssgeom.rig import Friction, Load, Rig, Tendon, read_rig

SAMPLES = Path(__file__).parents[2] / "sample_shapes"
Columns = dict[str, np.ndarray]


@dataclass(frozen=True)
class Bench:
    """A run, and what is known beside it."""

    columns: Columns
    rig: Rig
    length: float = 0.5
    angle: float = float(np.pi)


def by_position() -> Bench:
    """A sample of the package: driven by position, all channels, one pull and release after the other."""
    folder = SAMPLES / "campaign_clean"
    run = read_run(folder / "half_slow.csv")
    columns = {
        name: np.array(getattr(run, field))
        for field, name in IN_SI.items()
        if getattr(run, field) is not None
    }
    return Bench({"time_s": np.array(run.time), **columns}, read_rig(folder / "rig.toml"))


def by_tension() -> Bench:
    """A run of the lumped simulator: driven by tension through sharp turns, 900 rows."""
    times = np.linspace(0.0, 45.0, 901)
    drive = Drive(
        "force", np.array([0.0, 1.0, 11.0, 21.0, 31.0, 45.0]), np.array([1.0, 1.0, 15.0, 2.0, 13.0, 1.0])
    )
    path = from_pieces([0.1, 0.3, 0.1], [0.0, np.pi, 0.0], cells=48)
    run = simulate(path, Physics(pretension_N=1.0), drive, Distal("spring", 3000.0), times, 0.05)
    cell, ruler = Sensor(noise=0.02, resolution=0.005), Sensor(noise=3e-6, resolution=1e-6)
    sensors = {
        "tension_in_N": cell,
        "tension_out_N": cell,
        "displacement_in_m": ruler,
        "displacement_out_m": ruler,
    }
    columns = measure(run, sensors | {"elongation_m": ruler, "temperature_C": Sensor(noise=0.05)}, seed=3)
    rig = Rig(
        tendon=Tendon(pretension_N=1.0),
        friction=Friction(coefficient=0.145),
        load=Load(stiffness_N_per_m=3000.0),
    )
    return Bench(columns, rig)


def scaled(name: str, factor: float) -> Callable[[Columns], Columns]:
    return lambda run: run | {name: factor * run[name]}


def added(name: str, value: float) -> Callable[[Columns], Columns]:
    return lambda run: run | {name: run[name] + value}


def limited(name: str, share: float) -> Callable[[Columns], Columns]:
    """End the range of a channel below its greatest reading."""
    return lambda run: run | {name: np.minimum(run[name], share * run[name].max())}


def rounded(name: str, levels: int) -> Callable[[Columns], Columns]:
    def change(run: Columns) -> Columns:
        step = np.ptp(run[name]) / levels
        return run | {name: step * np.round(run[name] / step)}

    return change


def held(name: str, share: float) -> Callable[[Columns], Columns]:
    """Let a channel repeat its value from a share of the run on."""

    def change(run: Columns) -> Columns:
        values, first = run[name].copy(), int(share * len(run[name]))
        values[first:] = values[first]
        return run | {name: values}

    return change


def delayed(name: str, share: float, drift: float = 0.0) -> Callable[[Columns], Columns]:
    """Delay a channel by a share of the run; `drift` makes its clock run slow."""

    def change(run: Columns) -> Columns:
        time = run["time_s"]
        when = time - share * np.ptp(time) - drift * (time - time[0])
        return run | {name: np.interp(when, time, run[name])}

    return change


def exchanged(one: str, other: str) -> Callable[[Columns], Columns]:
    return lambda run: run | {one: run[other], other: run[one]}


def copied(one: str, other: str) -> Callable[[Columns], Columns]:
    return lambda run: run | {other: run[one].copy()}


def noise_only(name: str) -> Callable[[Columns], Columns]:
    def change(run: Columns) -> Columns:
        return run | {name: 0.02 * np.random.default_rng(5).standard_normal(len(run[name]))}

    return change


def first_pull_only(run: Columns) -> Columns:
    tension = run["tension_in_N"]
    last = int(np.argmax(tension < np.maximum.accumulate(tension) - 1.0)) - 8
    return {name: values[:last] for name, values in run.items()}


def written_twice(run: Columns) -> Columns:
    rows = len(run["time_s"])
    order = np.r_[: rows // 2, rows // 2 - 30 : rows]
    return {name: values[order] for name, values in run.items()} | {
        "time_s": np.linspace(run["time_s"][0], run["time_s"][-1], len(order))
    }


def interrupted(run: Columns) -> Columns:
    late = np.arange(len(run["time_s"])) > len(run["time_s"]) // 2
    return run | {"time_s": run["time_s"] + 600.0 * late}


def in_milliseconds_later(run: Columns) -> Columns:
    steps = np.diff(run["time_s"])
    steps[len(steps) // 2 :] *= 1000.0
    return run | {"time_s": np.concatenate(([0.0], np.cumsum(steps)))}


def of_two_recorders(run: Columns) -> Columns:
    time = np.concatenate((run["time_s"], run["time_s"] + 1e-7))
    order = np.argsort(time, kind="stable")
    return {name: np.concatenate((values, values))[order] for name, values in run.items()} | {
        "time_s": time[order]
    }


def loose(name: str) -> Callable[[Columns], Columns]:
    def change(run: Columns) -> Columns:
        values = run[name].copy()
        values[np.argsort(values)[-40::15]] = 0.0
        return run | {name: values}

    return change


def backwards(run: Columns) -> Columns:
    time = run["time_s"].copy()
    time[100:] -= 5.0
    return run | {"time_s": time}


def with_column(name: str, value: float) -> Callable[[Columns], Columns]:
    def change(run: Columns) -> Columns:
        return run | {name: value + 0.05 * np.random.default_rng(2).standard_normal(len(run["time_s"]))}

    return change


Spoiling = tuple[Callable[[Columns], Columns], set[str]]
ON_ANY: dict[str, Spoiling] = {
    "T_in of an inverted cell": (scaled("tension_in_N", -1.0), {"inverted_cell"}),
    "T_out of an inverted cell": (scaled("tension_out_N", -1.0), {"inverted_cell"}),
    "T_in with a zero of -4 N": (added("tension_in_N", -4.0), {"negative_tension"}),
    "T_out with a zero of +6 N at rest": (added("tension_out_N", 6.0), {"zero_at_rest"}),
    "channels exchanged": (exchanged("tension_in_N", "tension_out_N"), {"channels_exchanged"}),
    "gain of T_out twice too large": (scaled("tension_out_N", 1.9), {"tension_excess"}),
    "T_in in mN": (scaled("tension_in_N", 1000.0), {"strain", "full_scale"}),
    "T_out in mN": (scaled("tension_out_N", 1000.0), {"strain", "full_scale"}),
    "T_in in kgf": (scaled("tension_in_N", 1 / 9.80665), {"tension_ratio"}),
    "T_out in kgf": (scaled("tension_out_N", 1 / 9.80665), {"apparent_friction"}),
    "T_out in kN": (scaled("tension_out_N", 1e-3), {"tension_unit"}),
    "T_in clipped": (limited("tension_in_N", 0.8), {"clipped"}),
    "T_out clipped": (limited("tension_out_N", 0.7), {"clipped"}),
    "T_out in eight steps": (rounded("tension_out_N", 8), {"quantised"}),
    "T_in in twelve steps": (rounded("tension_in_N", 12), {"quantised"}),
    "T_out frozen": (held("tension_out_N", 0.3), {"frozen"}),
    "elongation frozen": (held("elongation_m", 0.25), {"frozen"}),
    "T_out not connected": (noise_only("tension_out_N"), {"unresponsive"}),
    "drive that never turns": (first_pull_only, {"drive_never_turns"}),
    "displacement with the wrong sign": (scaled("displacement_in_m", -1.0), {"sign"}),
    "elongation with the wrong sign": (scaled("elongation_m", -1.0), {"sign"}),
    "elongation in mm": (scaled("elongation_m", 1000.0), {"stretch_unit"}),
    "displacement in mm": (scaled("displacement_in_m", 1000.0), {"stroke"}),
    "T_out late by 4 % of the run": (delayed("tension_out_N", 0.04), {"lag"}),
    "T_out early by 4 % of the run": (delayed("tension_out_N", -0.04), {"lag"}),
    "elongation late by 3 % of the run": (delayed("elongation_m", 0.03), {"lag"}),
    "T_out on a clock 8 % slow": (delayed("tension_out_N", 0.0, 0.08), {"two_clocks", "lag"}),
    "a block of rows twice": (written_twice, {"repeated_block"}),
    "ten minutes missing": (interrupted, {"time_jump"}),
    "time in ms from the middle on": (in_milliseconds_later, {"time_jump"}),
    "rows of two recorders": (of_two_recorders, {"two_recorders"}),
    "time running back": (backwards, {"time_order"}),
    "a loose cable": (loose("tension_out_N"), {"spike"}),
    "one column under two names": (copied("tension_in_N", "tension_out_N"), {"copied_channel"}),
    "temperature in kelvin": (with_column("temperature_C", 295.0), {"temperature"}),
    "temperature in Fahrenheit": (with_column("temperature_C", 72.0), {"warm"}),
}
"""Change of the columns, and the rules one of which has to name it."""
