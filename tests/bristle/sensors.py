"""Sensors: what they make of true courses, and the files of a campaign, as several loggers spell them."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

Array = np.ndarray


class Specified(NamedTuple):
    """Specification of a channel in a data sheet, in its unit in SI."""

    noise: float
    resolution: float
    full_scale: float
    nonlinearity: float


class Shares(NamedTuple):
    """How much of the nonlinearity that is specified each fault has at most (chosen; 1 in all)."""

    bow: float = 0.5
    zero: float = 0.2
    drift: float = 0.3


CELL = Specified(0.02, 0.005, 40.0, 0.0006)
"""Load cell (chosen: 24 mN of 40 N; good cells of this range have 0.05 %)."""
ENCODER = Specified(2e-6, 0.5e-6, 0.05, 5e-5)
"""Linear encoder (chosen: 2.5 µm in 50 mm)."""
ANGLE = Specified(2e-4, 1e-4, 6.3, 0.0)
"""Encoder of a joint [rad] (chosen)."""
MOTOR = Specified(2e-5, 1e-5, 100.0, 0.0)
"""Encoder of a motor behind its gear, at the pulley [rad] (chosen: 0.2 µm of tendon)."""
TORQUE = Specified(2e-4, 5e-5, 1.0, 0.0)
"""Torque of a motor [N m] (chosen)."""
SHARES = Shares()


class Sensor:
    """One sensor of a campaign: its bow stays, its zero and its drift are those of a run."""

    def __init__(self, specified: Specified, rng: np.random.Generator) -> None:
        self.specified = specified
        most = specified.nonlinearity * specified.full_scale
        self._most = most
        self._bow = SHARES.bow * most * rng.uniform(-1.0, 1.0)
        self._half = rng.uniform(0.35, 0.6)

    def read(self, value: Array, rng: np.random.Generator) -> Array:
        """Return readings [n] of true values [n]."""
        spec, x = self.specified, np.linspace(0.0, 1.0, len(value))
        q = value / (self._half * spec.full_scale)
        zero = SHARES.zero * self._most * rng.uniform(-1.0, 1.0)
        drift = SHARES.drift * self._most * rng.uniform(-1.0, 1.0) * np.sin(0.5 * np.pi * x) ** 2
        bow = self._bow * np.clip(4.0 * q * (1.0 - q), -1.0, 1.0)
        read = value + bow + zero + drift + spec.noise * rng.normal(size=len(value))
        return np.round(read / spec.resolution) * spec.resolution


SPELLINGS: tuple[dict[str, tuple[str, float]], ...] = (
    {
        "time": ("time_s", 1.0),
        "tension_in": ("tension_in_N", 1.0),
        "tension_out": ("tension_out_N", 1.0),
        "displacement_in": ("displacement_in_m", 1.0),
        "displacement_out": ("displacement_out_m", 1.0),
        "elongation": ("elongation_mm", 1e3),
    },
    {
        "time": ("t [ms]", 1e3),
        "tension_in": ("Force (proximal) [N]", 1.0),
        "tension_out": ("Force (distal) [N]", 1.0),
        "displacement_in": ("displacement_in [mm]", 1e3),
        "displacement_out": ("displacement_out [mm]", 1e3),
        "elongation": ("stretch_mm", 1e3),
    },
    {
        "time": ("Time [s]", 1.0),
        "tension_in": ("T_in [mN]", 1e3),
        "tension_out": ("T_out [mN]", 1e3),
        "displacement_in": ("displacement_in [µm]", 1e6),
        "displacement_out": ("displacement_out [µm]", 1e6),
        "elongation": ("elongation [µm]", 1e6),
    },
)
"""Columns of three loggers, and how much of their unit makes one in SI."""


def write_run(path: Path, columns: dict[str, Array], spelling: int) -> None:
    """Write readings in SI as one of the loggers does; the second separates by semicolons."""
    spelled = SPELLINGS[spelling]
    names = [spelled[name][0] for name in columns]
    rows = np.stack([spelled[name][1] * row for name, row in columns.items()], axis=1)
    _write(path, names, rows, ";" if spelling == 1 else ",")


def write_shape(path: Path, stations: Array | None, points: Array, *, millimetres: bool) -> None:
    """Write sensed points [n,3] in m, with stations [n] in m where they are known."""
    unit, per_m = ("mm", 1e3) if millimetres else ("m", 1.0)
    names, rows = [f"{axis}_{unit}" for axis in "xyz"], points
    if stations is not None:
        names, rows = [f"s_{unit}", *names], np.column_stack([stations, points])
    _write(path, names, per_m * rows, ",")


def _write(path: Path, names: list[str], rows: Array, separator: str) -> None:
    lines = [separator.join(names), *(separator.join(f"{value:.9g}" for value in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def toml(tables: dict[str, dict[str, float | str]]) -> str:
    """Return tables as TOML."""
    lines = list[str]()
    for name, table in tables.items():
        lines.append(f"[{name}]")
        lines += [
            f'{key} = "{value}"' if isinstance(value, str) else f"{key} = {value:.6g}"
            for key, value in table.items()
        ]
        lines.append("")
    return "\n".join(lines)


def listing(runs: list[tuple[str, str, bool]]) -> str:
    """Return `campaign.toml` of runs: data, shape, and whether it is held out."""
    lines = ['rig = "rig.toml"', ""]
    for data, shape, held in runs:
        lines += ["[[run]]", f'data = "{data}"', f'shape = "{shape}"']
        lines += ["held_out = true"] if held else []
        lines.append("")
    return "\n".join(lines)
