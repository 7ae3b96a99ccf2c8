"""Write a campaign of measured runs whose cause is known, and hidden from its files.

    from tests.bristle import make_campaign
    truth = make_campaign(Path("here"), seed=3, cause="stribeck")

The truth stands beside the folder, in `<folder>.truth.json`.
"""

from __future__ import annotations

import json
import zlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tests.bristle import sensors
from tests.bristle.causes import CAUSES, FULL, Case, Cause
from tests.bristle.laws import Acts, Law
from tests.bristle.machine import PAIR_CAUSES, PAIR_PLANS, PAIR_SLOWEST, random_pair, write_pair
from tests.bristle.rig import Rig, run
from tests.bristle.sheath import random_sheath, sensed
from tests.bristle.waves import KINDS, course

Array = np.ndarray

SEEDS = {"development": 407_000_000, "test": 811_000_000}
"""First seed of each split; a million each."""
PLANS: dict[str, tuple[str, ...]] = {
    "full": ("displacement_in", "tension_in", "tension_out", "displacement_out"),
    "elongation": ("displacement_in", "tension_in", "tension_out", "elongation"),
    "no_load_cell": ("displacement_in", "tension_in", "displacement_out"),
    "drive_end": ("displacement_in", "tension_in"),
    "force": ("tension_in", "tension_out", "displacement_in"),
}
"""Channels of a plan; in the last one the force drives."""
MECHANISMS = tuple(dict.fromkeys(cause.mechanism for cause in CAUSES.values()))


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


@dataclass(frozen=True)
class Truth:
    """What a report is held against.

    `law` holds `over`, `x`, `value` and `unit` over what the runs reach; a law of friction is a factor
    relative to the coefficient at the reference of the law, others are what is added [the unit].
    """

    effects: tuple[str, ...]
    """The name of the library, or that of the cause where it has none; none of a clean campaign."""
    cause: str
    mechanism: str
    formula: str | None
    known: bool
    """Whether the library has the formula."""
    law: dict[str, Any] | None
    parameters: dict[str, dict[str, float]]
    friction: float
    compliance_per_N: float
    pretension_N: float
    angle_gain: float
    length_m: float
    total_angles_rad: tuple[float, ...]
    plan: str
    split: str
    seed: int
    size: float


def generator(seed: int, split: str, cause: str) -> np.random.Generator:
    """Return the random numbers of a seed: each cause has rigs of its own, the same at each size.

    Raises
    ------
    ValueError
        Where the seed is not in its split.
    """
    if not 0 <= seed < 1_000_000:
        raise ValueError(f"seed {seed}: 0 to 999999")
    return np.random.default_rng([SEEDS[split] + seed, zlib.crc32(cause.encode())])


def make_campaign(
    folder: Path,
    seed: int,
    cause: str = "",
    size: float = 1.0,
    plan: str = "",
    split: str = "development",
) -> Truth:
    """Write a campaign into `folder` and its truth beside it, as `<folder>.truth.json`.

    Parameters
    ----------
    folder
        Made where it is not there.
    seed
        0 to 999999.
    cause
        A name of `CAUSES`, or "" for a clean campaign.
    size
        1 is what rigs show, 0.5 half of it.
    plan
        A name of `PLANS`; "" takes one in which the cause shows, by the seed.
    split
        "development" or "test".

    Raises
    ------
    ValueError
        Where a name is not known, or the cause does not show in the plan.
    """
    if cause and cause not in {**CAUSES, **PAIR_CAUSES}:
        raise ValueError(f"no such cause: {cause}")
    rng = generator(seed, split, cause)
    if cause in PAIR_CAUSES or plan in PAIR_PLANS:
        truth = _of_pair(Path(folder), rng, (cause, size, plan, split, seed))
    else:
        truth = _of_one(Path(folder), rng, (cause, size, plan, split, seed))
    text = json.dumps(asdict(truth), indent=1)
    Path(f"{folder}.truth.json").write_text(text + "\n", encoding="utf-8")
    return truth


def _of_one(folder: Path, rng: np.random.Generator, asked: tuple[str, float, str, str, int]) -> Truth:
    """Write a campaign of one tendon."""
    cause, size, plan, split, seed = asked
    chosen = CAUSES[cause] if cause else Cause("", lambda case: None)
    plan = plan or str(rng.choice(chosen.plans))
    if plan not in (chosen.plans if cause else FULL):
        raise ValueError(f"{cause} does not show in the plan {plan!r}")
    rig = _rig(rng, "force" if plan == "force" else "position")
    runs = int(rng.integers(RANGES.runs[0], RANGES.runs[1] + 1))
    rates = [
        chosen.rates[k % len(chosen.rates)] for k in rng.permutation(max(runs, len(chosen.rates)))[:runs]
    ]
    samples = [int(rng.integers(*RANGES.samples)) for _ in range(runs)]
    seconds = max(n / rate for n, rate in zip(samples, rates, strict=True))
    case = Case(rig, rng, size, float(rng.uniform(*RANGES.peak_out_N)), seconds)
    believed = {
        "friction": rig.friction * (1.0 + RANGES.friction_error * rng.uniform(-1.0, 1.0)),
        "compliance": rig.compliance * (1.0 + RANGES.compliance_error * rng.uniform(-1.0, 1.0)),
        "pretension": rig.pretension,
        "stiffness": rig.stiffness,
    }
    chosen.build(case)
    believed |= case.believed
    kept = _Campaign(folder, case, plan, believed)
    reach = kept.write(samples, rates)
    return Truth(
        effects=(chosen.formula or cause,) if cause else (),
        cause=cause,
        mechanism=chosen.mechanism,
        formula=chosen.formula,
        known=chosen.formula is not None,
        law=_law(case.law, reach),
        parameters={(chosen.formula or cause): case.parameters} if case.parameters else {},
        friction=rig.friction,
        compliance_per_N=rig.compliance,
        pretension_N=rig.pretension,
        angle_gain=kept.angle_gain,
        length_m=rig.sheaths[0].length,
        total_angles_rad=tuple(sheath.total_angle for sheath in rig.sheaths),
        plan=plan,
        split=split,
        seed=seed,
        size=size,
    )


def _of_pair(folder: Path, rng: np.random.Generator, asked: tuple[str, float, str, str, int]) -> Truth:
    """Write a campaign of two tendons and a joint."""
    cause, size, plan, split, seed = asked
    plan = plan or str(rng.choice(list(PAIR_PLANS)))
    if plan not in PAIR_PLANS or (cause and cause not in PAIR_CAUSES):
        raise ValueError(f"{cause} does not show in the plan {plan!r}")
    pair = random_pair(rng)
    mechanism, build = PAIR_CAUSES.get(cause, ("", lambda *_: None))
    build(pair, size, RANGES.samples[1] / PAIR_SLOWEST)
    errors = RANGES.friction_error * rng.uniform(-1.0, 1.0), RANGES.compliance_error * rng.uniform(-1.0, 1.0)
    gain = 1.0 + RANGES.angle_gain_sd * rng.normal()
    reach = write_pair(folder, pair, rng, plan, errors, gain)
    return Truth(
        effects=(cause,) if cause else (),
        cause=cause,
        mechanism=mechanism,
        formula=None,
        known=False,
        law=_law(pair.law, reach),
        parameters={cause: pair.parameters} if pair.parameters else {},
        friction=pair.friction,
        compliance_per_N=pair.compliance,
        pretension_N=pair.pretension,
        angle_gain=gain,
        length_m=pair.sheaths[0].length,
        total_angles_rad=tuple(sheath.total_angle for sheath in pair.sheaths),
        plan=plan,
        split=split,
        seed=seed,
        size=size,
    )


def _rig(rng: np.random.Generator, drive: str) -> Rig:
    length = rng.uniform(*RANGES.length_m)
    kinds = rng.permutation(3)[: int(rng.integers(2, 4))]
    return Rig(
        friction=rng.uniform(*RANGES.friction),
        compliance=rng.uniform(*RANGES.compliance_per_N),
        pretension=round(rng.uniform(*RANGES.pretension_N), 2),
        stiffness=round(rng.uniform(*RANGES.stiffness_N_per_m), -1),
        sheaths=[random_sheath(rng, length, rng.uniform(*RANGES.total_angle_rad), int(k)) for k in kinds],
        drive=drive,
    )


class _Campaign:
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


LAW_POINTS = 60


def _law(law: tuple[str, str, Law] | None, reach: dict[str, tuple[float, float]]) -> dict[str, Any] | None:
    """Return the true law where the runs have been."""
    if law is None:
        return None
    over, unit, value_at = law
    x = np.linspace(*reach[over], 2 if over == "direction" else LAW_POINTS)
    value = np.broadcast_to(value_at(x), x.shape)
    return {"over": over, "x": x.tolist(), "value": value.tolist(), "unit": unit}
