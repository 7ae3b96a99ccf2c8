"""Development cases of the sensitivity benchmark: the numbers that a tuned constant may move.

Every draw has a fixed seed, so the same code gives the same numbers. A case hands over each number as soon as
it has it, so that a run can stop at the first that moved, and returns their summary.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import mkdtemp

import msgspec
import numpy as np

from benchmarks import adaptive
from benchmarks.calibration import MACHINES, machine_trial, trial
from tests.campaigns import make_campaign
from tests.known_routes import Cell, Draw, draw, truth
from tests.live_process import points_mm
from tests.twins import DRIFTS, FAULTS, Scenario
from tests.twins.mechanisms import SCENARIOS
from tssgeom import Frame, FrameResult, Rejected, Rig, discover, process
from tssgeom.arrays import Vector
from tssgeom.rig import Friction, Load, ShapeSensor
from tssgeom.statistics import NORMAL_95

Numbers = dict[str, float]
Take = Callable[..., None]
"""Takes numbers of a case one by one."""

CELLS = (
    *(Cell("sensitivity", route, 200, 5e-4) for route in ("line", "half circle", "6 pieces", "7 pieces")),
    Cell("sensitivity", "7 pieces", 200, 5e-4, "jitter", noise_known=False),
    Cell("sensitivity", "6 pieces", 30, 1e-4, "random"),
    Cell("sensitivity", "setup A", 60, 5e-4, "jitter", outliers=0.05),
    Cell("sensitivity", "7 pieces", 200, 1e-4, noise_known=False, gap=0.2),
    Cell("sensitivity", "half circle", 8, 1e-4, "even", noise_known=False),
    Cell("sensitivity", "helix", 200, 1e-4),
    Cell("sensitivity", "clothoid", 60, 5e-4, "jitter"),
    Cell("sensitivity", "colon", 60, 5e-4),
    Cell("sensitivity", "colon", 200, 1e-4, "jitter", noise_known=False),
    Cell("sensitivity", "harmonics", 200, 5e-4),
    Cell("sensitivity", "harmonics", 30, 1e-4, "random", noise_known=False),
)
CLOCK = "processor time [s]"
"""End of the names of numbers that differ from run to run."""

_TRIALS, _QUICK_TRIALS = 2, 1  # of each cell
_FRAMES, _QUICK_FRAMES = 60, 24  # of each stream
_GRATINGS = 40
_FIBRE_NOISE = 0.3  # of a curvature component [1/m]
_POINT_NOISE = 1e-4  # of a coordinate in the streams of the tendon [m]
_DIRECTION_NOISE = math.radians(0.5)
_CAMPAIGNS = ((None, 1), ("hidden_bend", 0))
_KINDS = ("white", "no T_out", "by position")
_MACHINES = ("force loop", "angles alone")
_FOLLOWED = ("drifting_friction_sinusoid", "drifting_zeros", "growing_play")
_SPOILT = tuple(one for one in FAULTS if one != "unplugged_tension_out_N")  # T_out is not measured
_FOLLOWED_HOURS = 0.03
_EVERY = 8  # samples of a followed run, of which one counts
_FOLLOWED_MACHINE_S = 20.0
_UNUSED = ("seconds", "exact")  # differs from run to run; of the true numbers, which nothing follows
_BROKEN_MACHINES = (("pair", "frayed_tendon"), ("joint", "unplugged"), ("segment", "wet_sheath"))
_EFFECTS = (
    {"name": "load_dependent_friction", "exponent": 0.2},
    {"name": "velocity_dependent_friction", "gain": 0.1},
    {"name": "viscous_drag", "coefficient_Ns_per_m2": 50.0},
    {"name": "creep", "ratio": 0.1, "time_s": 5.0},
    {"name": "backlash", "width_m": 2e-4},
    {"name": "slack_take_up", "slack_m": 1e-3, "end": "proximal"},
)


def route(take: Take, *, quick: bool) -> Numbers:
    """Return errors and coverage of Φ over single frames, streams, directions and fibres."""
    errors: dict[str, list[tuple[float, float]]] = {}
    counts = list[bool]()
    for cell in CELLS:
        for number in range(_QUICK_TRIALS if quick else _TRIALS):
            one = draw(cell, number)
            pieces = len(one.truth.course.length) if one.truth.course else 0
            for name, result in _single_frames(cell, one, number):
                if isinstance(result, Rejected):
                    take(math.nan)
                    errors.setdefault("rejected frames", []).append((1.0, math.nan))
                    continue
                take(result.arcs.total_angle, result.arcs.total_angle_se, len(result.arcs.length))
                unit = one.truth.total_angle or 1.0
                error = (result.arcs.total_angle - one.truth.total_angle) / unit
                kind = "pieces" if pieces else "smooth"
                errors.setdefault(name or kind, []).append((error, result.arcs.total_angle_se / unit))
                if pieces and not name:
                    counts.append(len(result.arcs.length) == pieces)
    for name, stream in (("stream", _swaying(quick)), ("moving stream", _growing(quick))):
        errors[name] = list(stream)
        take(*(value for pair in errors[name] for value in pair))
    numbers = {f"rms Φ, {name} [%]": 100.0 * _rms([e for e, _ in rows]) for name, rows in errors.items()}
    pooled = [abs(e) <= NORMAL_95 * se for rows in errors.values() for e, se in rows if math.isfinite(se)]
    return numbers | {"coverage [%]": 100.0 * _share(pooled), "right count [%]": 100.0 * _share(counts)}


def _single_frames(cell: Cell, one: Draw, number: int) -> Iterator[tuple[str, FrameResult | Rejected]]:
    """Measure a draw from its points; and for one draw of a cell, from directions beside them and a fibre."""
    stations = one.station if cell.stations == "known" else None
    noise_mm = 1e3 * cell.noise if cell.noise_known else None
    yield "", _first(Frame(one.points, stations=stations), Rig(shape=ShapeSensor(noise_mm=noise_mm)))
    if number or cell.outliers or cell.gap:
        return
    rng = np.random.default_rng(number)
    step = 1e-6 * one.truth.length
    tangents = (one.truth.position(one.station + step) - one.truth.position(one.station - step)) / (2 * step)
    sensed = tangents + _DIRECTION_NOISE * rng.standard_normal(tangents.shape)
    sensed /= np.linalg.norm(sensed, axis=1)[:, None]
    sensor = ShapeSensor(noise_mm=noise_mm, direction_noise_deg=math.degrees(_DIRECTION_NOISE))
    yield "directions", _first(Frame(one.points, stations=stations, directions=sensed), Rig(shape=sensor))
    if (course := one.truth.course) is not None:
        at = np.linspace(0.0, course.length.sum(), _GRATINGS)
        last = len(course.length) - 1
        piece = np.minimum(np.searchsorted(np.cumsum(course.length), at, side="right"), last)
        components = course.bend[piece] + _FIBRE_NOISE * rng.standard_normal((_GRATINGS, 2))
        blank = np.full((_GRATINGS, 3), np.nan)
        yield "fibre", _first(Frame(blank, stations=at, curvatures=components), Rig())


def _first(frame: Frame, rig: Rig) -> FrameResult | Rejected:
    return next(iter(process([frame], rig, tension_in=15.0)))


def _swaying(quick: bool) -> Iterator[tuple[float, float]]:
    """Yield error and standard error of Φ in a stream of seven pieces that sway about their shape."""
    times = np.arange(_QUICK_FRAMES if quick else _FRAMES) / 50.0
    frames = [Frame(1e-3 * points_mm(200, time, i), time) for i, time in enumerate(times)]
    angle = truth("7 pieces", np.random.default_rng(0)).total_angle
    for frame, result in zip(frames, process(frames, Rig(), tension_in=15.0), strict=True):
        sway = 1.0 + 0.02 * math.sin(2.0 * math.pi * frame.time / 2.0)  # as points_mm has it
        if isinstance(result, FrameResult):
            error = result.arcs.total_angle / (sway * angle) - 1.0
            yield error, result.arcs.total_angle_se / angle


def _growing(quick: bool) -> Iterator[tuple[float, float]]:
    """Yield the same for half a metre whose one bend becomes two of opposite sense, and back."""
    count = _QUICK_FRAMES if quick else _FRAMES
    frames, angles, rng = list[Frame](), list[float](), np.random.default_rng(3)
    for i in range(count):
        second = 2.0 * math.sin(2.0 * math.pi * i / count)
        frames.append(Frame(_two_bends(2.0, second) + 3e-4 * rng.standard_normal((80, 3)), i / 50.0))
        angles.append(2.0 + abs(second))
    rig = Rig(shape=ShapeSensor(noise_mm=0.3))
    for angle, result in zip(angles, process(frames, rig, tension_in=15.0), strict=True):
        if isinstance(result, FrameResult):
            yield result.arcs.total_angle / angle - 1.0, result.arcs.total_angle_se / angle


def _two_bends(first: float, second: float, points: int = 80) -> np.ndarray:
    s = np.linspace(0.0, 0.5, 20 * points)
    heading = np.concatenate(([0.0], np.cumsum(np.where(s[1:] < 0.25, first, second) / 0.25 * np.diff(s))))
    steps = np.diff(s)[:, None] * np.column_stack((np.cos(heading), np.sin(heading), 0 * heading))[1:]
    whole = np.concatenate((np.zeros((1, 3)), np.cumsum(steps, axis=0)))
    return whole[np.linspace(0, len(whole) - 1, points).round().astype(int)]


def tendon(take: Take, *, quick: bool) -> Numbers:
    """Return tensions and elongations on standing and moving routes, without and with effects."""
    count = _QUICK_FRAMES if quick else _FRAMES
    time = [i / 20.0 for i in range(count)]
    pull = [8.0 + 6.0 * math.sin(2.0 * math.pi * t / 3.0) for t in time]
    moved = [2e-3 + 1.5e-3 * math.sin(2.0 * math.pi * t / 3.0) for t in time]
    half = [0.5 * x for x in moved]
    base = Rig(friction=Friction(coefficient=0.145), load=Load(stiffness_N_per_m=1000.0))
    rigs = {"base": base, "effects": _with_effects(base)}
    numbers: Numbers = {}
    for name, rig in rigs.items():
        for moving in (False, True):
            rng = np.random.default_rng(5)
            bends = [
                _two_bends(2.0, 1.5 + 0.5 * moving * math.sin(t))
                + _POINT_NOISE * rng.standard_normal((80, 3))
                for t in time
            ]
            given = {"tension_in": pull, "displacement_in": moved, "displacement_target": half}
            for drive, values in given.items():
                plain = map(Frame, bends, time)
                frames = [replace(one, **{drive: x}) for one, x in zip(plain, values, strict=True)]
                label = f"{name}, {'moving' if moving else 'standing'}, {drive}"
                ends = _transmitted(label, list(process(frames, rig, tension_in=5.0)))
                numbers |= ends
                take(*ends.values())
    return numbers


def _with_effects(rig: Rig) -> Rig:
    return msgspec.convert(msgspec.to_builtins(rig) | {"effects": list(_EFFECTS)}, Rig)


def _transmitted(label: str, results: Sequence[FrameResult | Rejected]) -> Numbers:
    used = [one for one in results if isinstance(one, FrameResult)]
    moves = [one.transmission for one in used]
    return {
        f"T_out, {label} [N]": _rms([one.tension_out for one in moves]),
        f"δ, {label} [mm]": 1e3 * _rms([one.elongation for one in moves]),
        f"se δ, {label} [mm]": 1e3 * _rms([one.elongation_se for one in moves]),
        f"rejected, {label}": float(len(results) - len(used)),
    }


def identify(take: Take, *, quick: bool) -> Numbers:
    """Return names, evidence and false alarms of `discover`, and errors and coverage of `calibrate`."""
    numbers = _calibrated(take, _KINDS[:1] if quick else _KINDS) | {"right names": 0.0, "false alarms": 0.0}
    for name in () if quick else _MACHINES:
        for each in machine_trial(MACHINES[name], 0)[0].estimates:
            take(each.value, each.low, each.high)
            numbers[f"{each.key}, {name}"] = each.value
            numbers[f"95 %, {each.key}, {name}"] = each.high - each.low
    for effect, seed in _CAMPAIGNS[:1] if quick else _CAMPAIGNS:
        folder = _ROOM[0] / f"{effect or 'clean'}_{seed}"
        finding = discover(folder)
        named = [name for one in finding.effects for name in one.names]
        deltas = [one.evidence.delta_bic for one in finding.ranking]
        take(finding.base["friction"].value, len(named), *deltas)
        numbers["right names"] += float(named[:1] == [effect])
        numbers["false alarms"] += float(effect is None and finding.verdict != "none")
        numbers[f"ΔBIC, {folder.name}"] = max(deltas, default=math.nan)
        numbers[f"friction, {folder.name}"] = finding.base["friction"].value
    return numbers


def _calibrated(take: Take, kinds: Sequence[str]) -> Numbers:
    held, errors, widths = list[bool](), list[float](), list[float]()
    for kind in kinds:
        for seed in range(2):
            result, true = trial(kind, seed)
            for name in ("friction", "compliance"):
                one = result.estimates[name]
                take(one.value, one.low, one.high)
                if one.observable:
                    held.append(one.low <= true[name] <= one.high)
                    errors.append(one.value / true[name] - 1.0)
                    widths.append((one.high - one.low) / true[name])
    return {
        "calibration, rms error [%]": 100.0 * _rms(errors),
        "calibration, width [%]": 100.0 * float(np.mean(widths)),
        "calibration, coverage [%]": 100.0 * _share(held),
        "calibration, identifiable": float(len(held)),
    }


def adapt(take: Take, *, quick: bool) -> Numbers:
    """Return how far rigs that are followed are off, and after what time faults are detected and named."""
    numbers: Numbers = {}
    for name in _FOLLOWED[:1] if quick else _FOLLOWED:
        one = adaptive.sound(_SCENARIOS[name], _EVERY, tension_out=False)._asdict()
        _put(take, numbers, name, {key: one[key] for key in one if key not in _UNUSED})
    for name in _SPOILT[:1] if quick else _SPOILT:
        one = adaptive.fault(_SCENARIOS[name], _EVERY, tension_out=False)
        _put(take, numbers, name, {"delay": one.delay, "named": one.named, "false": one.false_alarms})
    for kind, fault in () if quick else _BROKEN_MACHINES:
        one = adaptive.sound_machine(SCENARIOS[kind](1, _FOLLOWED_MACHINE_S))._asdict()
        _put(take, numbers, kind, {key: one[key] for key in one if key not in _UNUSED})
        one = adaptive.machine_fault(kind, 1, fault)
        _put(take, numbers, f"{kind}, {fault}", {"delay": one.delay, "named": one.named})
    return numbers


def _put(take: Take, numbers: Numbers, label: str, values: Mapping[str, float]) -> None:
    """Hand numbers over; -1 is the delay of an alarm that does not come."""
    given = {key: float(np.nan_to_num(value, nan=-1.0)) for key, value in values.items()}
    take(*given.values())
    numbers |= {f"{key}, {label.replace('_', ' ')}": value for key, value in given.items()}


def _rms(values: Sequence[float] | Vector) -> float:
    return float(np.sqrt(np.mean(np.square(np.asarray(values, dtype=float)))))


def _share(values: Sequence[bool]) -> float:
    return float(np.mean(values)) if values else math.nan


CASES: Mapping[str, Callable[..., Numbers]] = {one.__name__: one for one in (route, tendon, identify, adapt)}
_ROOM = list[Path]()
_SCENARIOS = dict[str, Scenario]()


def prepare() -> None:
    """Write the campaigns and run the independent simulator, which no constant moves: once for all runs."""
    _ROOM[:] = [Path(mkdtemp(prefix="campaigns-"))]
    for effect, seed in _CAMPAIGNS:
        make_campaign(_ROOM[0] / f"{effect or 'clean'}_{seed}", seed, effect)
    for name in (*_FOLLOWED, *_SPOILT):
        _SCENARIOS[name] = (DRIFTS | FAULTS)[name](1, _FOLLOWED_HOURS)
