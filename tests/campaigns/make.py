"""A campaign: the true rig and the nominal one, its runs, and the files."""

import json
import zlib
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path as File

import numpy as np

from tests.campaigns.causes import CHOICES, INSIDE, OUTSIDE, Change
from tests.campaigns.drives import COURSES, SLOW, timed
from tests.campaigns.files import write
from tests.campaigns.instruments import SPECIFIED, observed
from tests.campaigns.routes import Route, chain, half_and_loop, half_circle, path, positions
from tests.lumped import Distal, Drive, Physics, simulate
from tests.lumped.simulate import Run

SEEDS = {"development": 71_000_000, "test": 93_000_000}
"""Where the seeds of a split begin; each has a million. Frozen: thresholds rest on them."""
PLANS = (
    "full",
    "no_tension_out",
    "displacement_only",
    "one_route",
    "one_rate",
    "round_turns",
    "force_driven",
)
"""What is measured, and how: all; two with channels that are missing; two that cannot break a tie; all again,
with legs like half a cosine, and driven by force."""
_RATES = ("viscous_drag_Ns_per_m2", "speed_gain", "stribeck_gain", "creep_ratios", "wear_gain")


@dataclass(frozen=True, slots=True)
class Rig:
    """What holds for all runs of a campaign."""

    seed: int
    length: float
    """Of the sheath [m]."""
    believed: Physics
    friction: float
    """True coefficient [1]."""
    compliance: float
    """True strain per tension [1/N]."""
    distal: Distal
    angle_gain: float
    """Of the shape sensor [1]."""
    routes: tuple[Route, ...]
    changes: tuple[Change, ...]

    @property
    def physics(self) -> Physics:
        """What the rig really is."""
        laws = {key: value for change in self.changes for key, value in change.physics.items()}
        error = laws.pop("pretension_error_N", 0.0)
        return replace(
            self.believed,
            friction=self.friction,
            compliance_per_N=self.compliance,
            pretension_N=self.believed.pretension_N + error,
            **laws,
        )


@dataclass(frozen=True, slots=True)
class Truth:
    """What a report is held against."""

    effects: tuple[str, ...]
    """None, one or two."""
    known: bool
    """Whether the library has names for all of them."""
    parameters: dict[str, dict[str, float | str]]
    """Of each effect, in SI; the first is the amplitude."""
    friction: float
    compliance_per_N: float
    angle_gain: float
    length_m: float
    total_angles_rad: tuple[float, ...]
    """Of the routes."""
    plan: str
    split: str
    seed: int
    size: float


def make_campaign(
    folder: File,
    seed: int,
    effect: str | tuple[str, ...] | None = None,
    size: float = 1.0,
    plan: str = "full",
    split: str = "development",
) -> Truth:
    """Write a campaign into `folder` and its cause beside it, as `<folder>.truth.json`."""
    rig = _rig(seed, _names(effect), size, split)
    files = {"rig.toml": _believed(rig)}
    channels = columns(rig, plan)
    runs = []
    for day, course in enumerate(_courses(plan)):
        read = observed(_run(rig, day, plan), list(rig.changes), channels, rig.seed, day)
        held = day == len(COURSES) - 1
        runs.append((f"run_{day + 1}", f"route_{course.route + 1}.csv", held, read))
    points = {
        f"route_{k + 1}.csv": _points(rig, k) for k in sorted({course.route for course in _courses(plan)})
    }
    write(File(folder), files, runs, points)
    truth = _truth(rig, _names(effect), size, plan, split, seed)
    File(f"{folder}.truth.json").write_text(json.dumps(asdict(truth), indent=1) + "\n", encoding="utf-8")
    return truth


def signature(seed: int, effect: str, size: float = 1.0, plan: str = "full") -> dict[str, float]:
    """Return what a cause changes in each channel, rms over the runs in units of the channel's noise.

    The drive, the rig and the digits stay the same; nothing is fitted in between.
    """
    with_it, without = (_rig(seed, (effect,), s, "development") for s in (size, 0.0))
    names = ["tension_in_N", "tension_out_N", "elongation_m", "displacement_out_m"]
    missing_rows = []
    for day in range(len(COURSES)):
        a, b = (
            observed(_run(rig, day, plan), list(rig.changes), names, rig.seed, day)
            for rig in (with_it, without)
        )
        missing_rows.append([(a[name] - b[name]) / SPECIFIED[name].noise for name in names])
    return dict(zip(names, np.sqrt(np.mean(np.array(missing_rows) ** 2, axis=(0, 2))).tolist(), strict=True))


def columns(rig: Rig, plan: str) -> list[str]:
    """Channels of the data files; half of the rigs read the elongation, half the distal end."""
    distal = "elongation_m" if rig.seed % 2 else "displacement_out_m"
    gone = {"no_tension_out": ("tension_out_N",), "displacement_only": ("tension_in_N", "tension_out_N")}
    all_ = ["displacement_in_m", "tension_in_N", "tension_out_N", distal, "temperature_C"]
    return [name for name in all_ if name not in gone.get(plan, ())]


def _names(effect: str | tuple[str, ...] | None) -> tuple[str, ...]:
    return () if effect is None else (effect,) if isinstance(effect, str) else effect


def _rig(seed: int, effects: tuple[str, ...], size: float, split: str) -> Rig:
    """Sample a rig; the sample depends on the seed and the names, not on the size."""
    if not 0 <= seed < 1_000_000:
        raise ValueError(f"seed {seed}: a split has seeds from 0 to 999999")
    own = SEEDS[split] + seed
    rng = np.random.default_rng((own, zlib.crc32(" ".join(effects).encode())))
    length = round(rng.uniform(0.4, 0.7), 3)
    believed = Physics(
        friction=round(rng.uniform(0.11, 0.17), 3),
        compliance_per_N=round(rng.uniform(2.6e-4, 3.8e-4), 6),
        pretension_N=round(rng.uniform(3.5, 5.5), 1),
    )
    makers: list[Callable[[float, np.random.Generator], Route]] = [half_circle, half_and_loop, chain]
    rng.shuffle(makers)
    return Rig(
        seed=int(rng.integers(1 << 40)),
        length=length,
        believed=believed,
        friction=believed.friction * (1.0 + 0.04 * np.clip(rng.standard_normal(), -2.0, 2.0)),
        compliance=believed.compliance_per_N * (1.0 + 0.03 * np.clip(rng.standard_normal(), -2.0, 2.0)),
        distal=Distal("spring", round(rng.uniform(3000.0, 8000.0), -2)),
        angle_gain=1.0 + 0.005 * float(np.clip(rng.standard_normal(), -2.0, 2.0)),
        routes=(makers[0](length, rng), makers[1](length, rng), makers[2](length, rng)),
        changes=tuple((INSIDE | OUTSIDE | CHOICES)[name](size, rng, length) for name in effects),
    )


def _courses(plan: str) -> tuple:
    if plan == "one_route":
        return tuple(replace(course, route=0) for course in COURSES)
    if plan == "one_rate":
        return tuple(replace(course, speed=SLOW) for course in COURSES)
    if plan not in PLANS:
        raise ValueError(f"plan {plan!r}: give one of {', '.join(PLANS)}")
    return COURSES


def _run(rig: Rig, day: int, plan: str) -> Run:
    course = _courses(plan)[day]
    route = rig.routes[course.route]
    still = path(route, np.array([0.0]), 0.0)
    course = timed(course, still, rig.believed, rig.distal, plan)
    times, rng = course.times, np.random.default_rng((rig.seed, day, 5))
    warmth = np.interp(course.at, times, _warmth(times, rng))
    drive = Drive("force" if plan == "force_driven" else "displacement", course.at, course.values, warmth)
    moved = path(route, times, sum(change.sway_rad for change in rig.changes))
    curved = any(law in change.physics for change in rig.changes for law in _RATES)
    parts = 8 if plan == "round_turns" else 2 if curved else 1
    return simulate(moved, rig.physics, drive, rig.distal, times, (times[1] - times[0]) / parts)


def _warmth(times: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A room that is warmed and aired: 1.5 to 3.5 K up and down within the run [°C]."""
    span = times[-1] - times[0]
    wave = 2.0 * np.pi * times / (span * rng.uniform(0.6, 1.4)) + rng.uniform(0.0, 6.28)
    return rng.uniform(20.0, 24.0) + rng.uniform(1.5, 3.5) * np.sin(wave)


def _points(rig: Rig, k: int) -> tuple[np.ndarray, str, bool]:
    """Points of a route as sensed [n, 3 or 4], the unit of the file, and whether stations are known."""
    rng = np.random.default_rng((rig.seed, k, 9))
    stations = np.linspace(0.0, rig.length, int(rng.integers(120, 201)))
    measured_at = positions(rig.routes[k], stations, rig.angle_gain) + 2e-4 * rng.standard_normal(
        (len(stations), 3)
    )
    unit, reported = ("mm", "m")[rng.integers(2)], bool(rng.integers(2))
    table = np.column_stack([measured_at, stations]) if reported else measured_at
    return (1e3 if unit == "mm" else 1.0) * table, unit, reported


def _believed(rig: Rig) -> str:
    p = rig.believed
    head = [
        "[tendon]",
        f"compliance_per_N = {p.compliance_per_N}",
        f"pretension_N = {p.pretension_N}",
        f"\n[friction]\ncoefficient = {p.friction}",
        f"\n[load]\nstiffness_N_per_m = {rig.distal.stiffness_N_per_m}",
        "\n[shape]\nnoise_mm = 0.2\nangle_gain_sd = 0.005",
    ]
    for name, reported in SPECIFIED.items():
        head.append(f"\n[sensors.{name}]\nnoise = {reported.noise}\nresolution = {reported.resolution}")
        head.append(f"full_scale = {reported.full_scale}\nnonlinearity = {reported.nonlinearity}")
    return "\n".join(head) + "\n"


def _truth(rig: Rig, names: Iterable[str], size: float, plan: str, split: str, seed: int) -> Truth:
    effects = tuple(names)
    reported = {name: change.parameters for name, change in zip(effects, rig.changes, strict=True)}
    return Truth(
        effects=effects,
        known=all(name in INSIDE | CHOICES for name in effects),
        parameters=reported,
        friction=float(rig.friction),
        compliance_per_N=float(rig.compliance),
        angle_gain=rig.angle_gain,
        length_m=rig.length,
        total_angles_rad=tuple(float(route.angles.sum()) for route in rig.routes),
        plan=plan,
        split=split,
        seed=seed,
        size=size,
    )
