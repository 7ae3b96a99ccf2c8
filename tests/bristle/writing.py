"""The folder of a campaign of one tendon: its rig file, shapes, and runs."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.bristle import sensors
from tests.bristle.causes import Case
from tests.bristle.laws import Acts
from tests.bristle.rig import run
from tests.bristle.sheath import sensed
from tests.bristle.waves import KINDS, course

Array = np.ndarray

PLANS: dict[str, tuple[str, ...]] = {
    "full": ("displacement_in", "tension_in", "tension_out", "displacement_out"),
    "elongation": ("displacement_in", "tension_in", "tension_out", "elongation"),
    "no_load_cell": ("displacement_in", "tension_in", "displacement_out"),
    "drive_end": ("displacement_in", "tension_in"),
    "force": ("tension_in", "tension_out", "displacement_in"),
}
"""Channels of a plan; in the last one the force drives."""


class Ranges(NamedTuple):
    """What rigs are like (chosen, after the rigs of the paper and of instruments)."""

    friction: tuple[float, float] = (0.09, 0.19)
    compliance_per_N: tuple[float, float] = (2.2e-4, 4.5e-4)
    pretension_N: tuple[float, float] = (2.5, 4.5)
    stiffness_N_per_m: tuple[float, float] = (500.0, 1600.0)
    length_m: tuple[float, float] = (0.4, 0.75)
    total_angle_rad: tuple[float, float] = (1.8, 4.6)
    peak_out_N: tuple[float, float] = (7.0, 10.0)
    rest_in_N: tuple[float, float] = (1.5, 2.0)
    """Lowest tension of a released tendon at its drive: never slack."""
    friction_error: float = 0.05
    compliance_error: float = 0.04
    """Most that the rig file is wrong, relative."""
    angle_gain_sd: float = 0.004
    shape_noise_mm: tuple[float, float] = (0.1, 0.25)
    points: tuple[int, int] = (90, 180)
    samples: tuple[int, int] = (280, 330)
    runs: tuple[int, int] = (3, 6)
    rest_share: float = 0.06
    """Of the samples before the drive moves to its lowest point, and as many on the way there."""


RANGES = Ranges()


class Writing:
    """A campaign while it is written."""

    def __init__(self, folder: Path, case: Case, plan: str, believed: dict[str, float]) -> None:
        self.folder, self.case, self.plan = folder, case, plan
        folder.mkdir(parents=True, exist_ok=True)
        rng = self.rng = case.rng
        self.spelling = int(rng.integers(len(sensors.SPELLINGS)))
        specified = {
            name: sensors.CELL if name.startswith("tension") else sensors.ENCODER for name in PLANS[plan]
        }
        self.sensors = {name: sensors.Sensor(spec, rng) for name, spec in specified.items()}
        self.angle_gain = 1.0 + RANGES.angle_gain_sd * rng.normal()
        self._write_rig(believed, specified)
        self._write_shapes()

    def _write_rig(self, believed: dict[str, float], specified: dict[str, sensors.Specified]) -> None:
        self.noise_mm = self.rng.uniform(*RANGES.shape_noise_mm)
        tables: dict[str, dict[str, float | str]] = {
            "tendon": {
                "compliance_per_N": believed["compliance"],
                "pretension_N": believed["pretension"],
            },
            "friction": {"coefficient": believed["friction"]},
            "load": {"stiffness_N_per_m": believed["stiffness"]},
            "shape": {"noise_mm": self.noise_mm, "angle_gain_sd": RANGES.angle_gain_sd},
        }
        for name, spec in specified.items():
            unit = "N" if name.startswith("tension") else "m"
            tables[f"sensors.{name}_{unit}"] = dict(spec._asdict())
        (self.folder / "rig.toml").write_text(sensors.toml(tables), encoding="utf-8")

    def _write_shapes(self) -> None:
        known, millimetres = self.rng.random() < 0.6, bool(self.rng.random() < 0.7)
        for k, sheath in enumerate(self.case.rig.sheaths):
            count = int(self.rng.integers(*RANGES.points))
            stations, points = sensed(sheath, self.rng, count, 1e-3 * self.noise_mm, self.angle_gain)
            file = self.folder / f"shape_{k + 1}.csv"
            sensors.write_shape(file, stations if known else None, points, millimetres=millimetres)

    def write(self, samples: list[int], rates: list[float]) -> dict[str, tuple[float, float]]:
        """Write the runs; return the least and the greatest value of what laws are over."""
        case, listed, courses = self.case, [], list[dict[str, Array]]()
        last = len(samples) - 1
        for k, (count, rate) in enumerate(zip(samples, rates, strict=True)):
            route = len(case.rig.sheaths) - 1 if k == last else k % max(len(case.rig.sheaths) - 1, 1)
            sheath = case.rig.sheaths[route]
            time = np.arange(1, count + 1) / rate
            true = run(case.rig, sheath, time, self._drive(route, k, count), Acts(**case.acts))
            courses.append(true)
            read = {"time": time}
            for name, sensor in self.sensors.items():
                value = true[name]
                for reading in case.readings.get(name, []):
                    value = reading(value, time)
                read[name] = sensor.read(value, self.rng)
            sensors.write_run(self.folder / f"run_{k + 1}.csv", read, self.spelling)
            listed.append((f"run_{k + 1}.csv", f"shape_{route + 1}.csv", k == last))
        (self.folder / "campaign.toml").write_text(sensors.listing(listed), encoding="utf-8")
        return self._reach(courses, samples, rates)

    def _drive(self, route: int, k: int, count: int) -> Array:
        """Return the drive of a run: a rest, a way to the lowest point, and a course from there."""
        rig, rng = self.case.rig, self.rng
        sheath = rig.sheaths[route]
        lowest = rng.uniform(*RANGES.rest_in_N) * np.exp(rig.friction * sheath.total_angle)
        low = rig.reach(sheath, lowest, pulled=False)
        high = rig.reach(sheath, self.case.peak * rng.uniform(0.85, 1.0), pulled=True)
        start = rig.pretension if rig.drive == "force" else 0.0
        rest = round(RANGES.rest_share * count)
        wave = low + (high - low) * course(KINDS[(k + route) % len(KINDS)], rng, count - 2 * rest)
        return np.concatenate([np.full(rest, start), np.linspace(start, low, rest + 1)[1:], wave])

    def _reach(
        self, courses: list[dict[str, Array]], samples: list[int], rates: list[float]
    ) -> dict[str, tuple[float, float]]:
        def over(name: str, low: float = 0.0) -> tuple[float, float]:
            return low, max(float(np.max(true[name])) for true in courses)

        sheaths = self.case.rig.sheaths
        bends = np.concatenate([sheath.bend(sheath.s) for sheath in sheaths])
        least = min(float(np.min(true["tension_low"])) for true in courses)
        reach = {
            "speed": over("slide_speed"),
            "travel": over("slide_travel"),
            "tension": over("tension_high", least),
            "bend": (float(np.min(bends)), float(np.max(bends))),
            "s": (0.0, sheaths[0].length),
            "time": (0.0, max(n / rate for n, rate in zip(samples, rates, strict=True))),
            "direction": (-1.0, 1.0),
            "slip": (0.0, 5.0 * self.case.parameters.get("breakaway_m", 0.0)),
        }
        for name in ("tension_in", "tension_out", "displacement_out"):
            reach[name] = over(name, min(float(np.min(true[name])) for true in courses))
        return reach
