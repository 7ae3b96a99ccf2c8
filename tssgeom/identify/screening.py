"""The library held against a fitted model by score tests: trial sizes, gains, threshold and detection limits.

The threshold is what the best of a library reaches on clean campaigns of the same sensors, a parametric
bootstrap: clean residuals are sampled from the sensor specification, with bends of load cells of other forms
than the error model has, and tested with the same straight lines. Source: docs/model.md (107), (110), (111).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from msgspec.structs import replace as changed

from tssgeom.arrays import Matrix, Vector
from tssgeom.effects import KINDS, Library, with_size
from tssgeom.effects.ends import Backlash, ChannelLag
from tssgeom.effects.kinds import DISTAL
from tssgeom.errors import FitError, SettingsError
from tssgeom.identify.fit import Fit, Free, Point, Problem, columns, freed, refined
from tssgeom.identify.prediction import CELLS, Errors, Stack
from tssgeom.plausibility.limits import LIMITS
from tssgeom.rig import Rig, Sensor
from tssgeom.statistics import EVIDENCE_SCALE


@dataclass(frozen=True, slots=True)
class DetectionLimits:
    """What an effect has to exceed.

    Frozen on the development seeds of `benchmarks.discovery`.
    """

    trial: float = 0.5
    """Of the typical size: size at which an effect is first tried [1]; chosen."""


DETECTION = DetectionLimits()

_SCALES: Mapping[str, tuple[float, ...]] = {
    "scale_N": (0.7, 2.0, 5.0),
    "time_s": (3.0, 15.0, 60.0),
    "travel_m": (0.01, 0.03, 0.1),
}
"""Starts of scales [N, s, m]."""
_PLAYS = ("backlash", "load_play")
_POSITIONS = (np.arange(9) + 0.5) / 9.0  # of a hidden bend, over the length


@dataclass(frozen=True, slots=True)
class Variant:
    """An effect at a trial size."""

    name: str
    effect: Library
    amplitude: str
    """The parameter that switches it on."""
    free: tuple[str, ...]
    """What is fitted of it."""

    @property
    def positive(self) -> bool:
        """Whether its amplitude cannot be negative."""
        return self.effect.parameters[self.amplitude].lower == 0.0

    @property
    def law(self) -> str:
        """One of several laws of the effect, as of a lag a late recorder; empty where it has one."""
        late = isinstance(self.effect, ChannelLag) and self.effect.channel == "distal"
        return "distal" if late else getattr(self.effect, "law", "")

    def sized(self, amplitude: float) -> Library:
        """Return the effect at another amplitude, within its bounds."""
        parameter = self.effect.parameters[self.amplitude]
        return changed(self.effect, **{self.amplitude: min(max(amplitude, parameter.lower), parameter.upper)})


def variants(stack: Stack) -> tuple[tuple[Variant, ...], dict[str, str]]:
    """Return all that can be tried on these readings, and why the rest cannot."""
    out, absent = list[Variant](), dict[str, str]()
    channels = {name for reading in stack.readings for name in reading.measured}
    drive = stack.readings[0].drive
    given = set.intersection(*(set(reading.given) for reading in stack.readings)) | channels
    for name, kind in KINDS.items():
        touched = kind.by_position if drive == "displacement_in_m" else kind.by_force
        lacking = [column for column in kind.needs if column not in given]
        if lacking:
            absent[name] = f"{', '.join(lacking)} was not measured"
        elif not channels & set(touched):
            absent[name] = f"it shows in {', '.join(touched)}, of which none was measured"
        else:
            out += list(_of(name, stack, channels))
    return tuple(out), absent


def _of(name: str, stack: Stack, channels: set[str]) -> Iterator[Variant]:
    effect: Any = with_size(KINDS[name], DETECTION.trial)
    if name.startswith("end_fitting"):
        for key in effect.parameters:
            alone = {other: 0.0 for other in effect.parameters if other != key}
            yield Variant(name, changed(effect, **alone), key, (key,))
        return
    if name in _PLAYS:  # a run starts engaged, or somewhere inside
        yield Variant(name, effect, "width_m", ("width_m",))
        inside = changed(effect, open_m=0.5 * effect.width_m)
        yield Variant(name, inside, "width_m", ("width_m", "open_m"))
        return
    amplitude = next(key for key, parameter in effect.parameters.items() if parameter.switch)
    free = tuple(key for key, parameter in effect.parameters.items() if parameter.fitted)
    for start in _started(name, effect, stack, channels):
        yield Variant(name, start, amplitude, free)


def _started(name: str, effect: Library, stack: Stack, channels: set[str]) -> Iterator[Library]:
    if name == "hidden_bend":
        length = max(reading.route.arcs.total_length for reading in stack.readings)
        yield from (changed(effect, at_m=float(share * length)) for share in _POSITIONS)
    elif name == "channel_lag":
        answers = sorted(channel for channel in channels if channel != stack.readings[0].drive)
        several = len(channels & set(DISTAL)) > 1
        late = (*answers, "distal") if several else answers
        yield from (changed(effect, channel=channel) for channel in late)
    elif name == "presliding":
        yield from (changed(effect, law=law) for law in ("prandtl", "dahl"))
    elif name == "slack_take_up":
        for end in ("proximal", "distal"):
            yield from (changed(effect, scale_N=scale, end=end) for scale in _SCALES["scale_N"])
    else:
        scale = next((key for key in effect.parameters if key in _SCALES), None)
        yield from [effect] if scale is None else (changed(effect, **{scale: v}) for v in _SCALES[scale])


@dataclass(frozen=True, slots=True)
class ScoreTest:
    """The score test of one variant: what a straight line through the model promises."""

    variant: Variant
    column: Vector
    """[rows + k] Whitened change for one unit of amplitude, friction and compliance projected off."""
    amplitude: float
    """Fitted to the readings, in the parameter's unit."""
    gain: float
    """How much χ² would fall [1]."""
    size: float
    """Length of the whitened change at typical size, off what friction and compliance take up [1]."""
    raw: float
    """The same with it."""


@dataclass(frozen=True, slots=True)
class Screening:
    """The score tests of a library."""

    tests: tuple[ScoreTest, ...]
    base: Matrix
    """[rows + k, 2 + free] Columns of the model so far."""
    residual: Vector
    """[rows + k] Of the model so far, off those columns."""


def screening(problem: Problem, fit: Fit, tried: Sequence[Variant]) -> Screening:
    """Test every variant on top of a fitted model; docs/model.md (107)."""
    base = columns(problem, fit.at, fit.left)
    frame, _ = np.linalg.qr(base)
    residual = fit.residual - frame @ (frame.T @ fit.residual)
    tests = []
    for variant in tried:
        result = _score_test(problem, fit, variant, frame, residual)
        if result is not None:
            tests.append(result)
    return Screening(tuple(tests), base, residual)


def _score_test(
    problem: Problem, fit: Fit, variant: Variant, frame: Matrix, residual: Vector
) -> ScoreTest | None:
    amplitude = getattr(variant.effect, variant.amplitude)
    try:
        left = problem.left(replace(fit.at, effects=(*fit.at.effects, variant.effect)))
    except (FitError, SettingsError):  # the effect at this size and that model do not go together
        return None
    whole = problem.whitening.whitened((fit.left - left) / amplitude)
    column = whole - frame @ (frame.T @ whole)
    square = float(column @ column)
    wanted = float(column @ residual) / square if square > 0.0 else 0.0
    if variant.positive and wanted < 0.0:
        wanted = 0.0
    typical = abs(variant.effect.parameters[variant.amplitude].typical)
    sizes = typical * math.sqrt(square), typical * float(np.linalg.norm(whole))
    return ScoreTest(variant, column, wanted, wanted**2 * square, *sizes)


def refit(problem: Problem, fit: Fit, test: ScoreTest, base: Matrix, passes: int = 6) -> Fit | None:
    """Refit the model with one more effect from where the straight line points; None where that fails."""
    parameter = test.variant.effect.parameters[test.variant.amplitude]
    limit = 3.0 * abs(parameter.typical)
    amplitude = float(np.clip(test.amplitude, -limit, limit)) or 0.1 * parameter.typical
    which = len(fit.at.effects)
    length = max(reading.route.arcs.total_length for reading in problem.stack.readings)
    effect = test.variant.sized(amplitude)
    free: tuple[Free, ...] = (*fit.at.free, *freed(effect, which, length, test.variant.free))
    start = replace(fit.at, effects=(*fit.at.effects, effect), free=free)
    try:
        return refined(problem, start, base, passes)
    except (FitError, SettingsError):
        return None


def threshold(problem: Problem, errors: Errors, screening: Screening, seed: int) -> float:
    """Return what ΔBIC has to pass, family-wise over the library; docs/model.md (110)."""
    rng = np.random.default_rng(seed)
    plotted = problem.whitening.whitened(_clean(problem, errors, rng))
    frame, _ = np.linalg.qr(screening.base)
    plotted -= frame @ (frame.T @ plotted)
    best = np.full(EVIDENCE_SCALE.draws, -np.inf)
    for test in screening.tests:
        length = float(np.linalg.norm(test.column))
        if length > 0.0:
            score = test.column @ plotted / length
            gain = np.square(np.maximum(score, 0.0) if test.variant.positive else score)
            best = np.maximum(best, gain - len(test.variant.free) * math.log(problem.stack.size))
    return max(float(np.quantile(best, 1.0 - EVIDENCE_SCALE.false_alarms)), EVIDENCE_SCALE.very_strong)


def _clean(problem: Problem, errors: Errors, rng: np.random.Generator) -> Matrix:
    """Residuals of clean campaigns [rows, draws] [N, m]; what the drive's noise adds to them lasts, (248)."""
    size = problem.stack.size
    plotted = np.array([0.0 if name.startswith("bend ") else 1.0 for name in errors.names])
    weight = plotted[:, None] * rng.standard_normal((len(plotted), EVIDENCE_SCALE.draws))
    out = errors.sigma[:, None] * (errors.modes @ weight)
    out += errors.brief[:, None] * rng.standard_normal((size, EVIDENCE_SCALE.draws))
    samples = errors.lasting.shape[1]
    for run in range(len(problem.stack.readings)):
        rows = np.concatenate([np.r_[block.rows] for block in problem.stack.blocks if block.run == run])
        weight = rng.standard_normal((samples, EVIDENCE_SCALE.draws)) / math.sqrt(samples)
        out[rows] += errors.lasting[rows] @ weight
    for name in dict.fromkeys(block.channel for block in problem.stack.blocks):
        out += _bends(problem, name, rng)
    return out


def _bends(problem: Problem, channel: str, rng: np.random.Generator) -> Matrix:
    """Bends of one cell in each draw: a wave of any length and phase over the scale, as deep as specified."""
    sensor = problem.rig.sensors.get(channel, Sensor())
    out = np.zeros((problem.stack.size, EVIDENCE_SCALE.draws))
    depth = sensor.nonlinearity * sensor.full_scale
    if depth == 0.0:
        return out
    waves, phase = (
        rng.uniform(0.5, 3.0, EVIDENCE_SCALE.draws),
        rng.uniform(0.0, 2.0 * math.pi, EVIDENCE_SCALE.draws),
    )
    grid = np.linspace(0.0, 1.0, 101)[:, None]
    most = np.abs(_wave(grid, waves, phase)).max(axis=0)
    sized = depth * rng.uniform(0.3, 1.0, EVIDENCE_SCALE.draws) / most
    for block in problem.stack.blocks:
        if block.channel == channel:
            part = np.clip(problem.stack.measured[block.rows] / sensor.full_scale, 0.0, 1.0)
            out[block.rows] = _wave(part[:, None], waves, phase) * sized
    return out


def _wave(part: Matrix, waves: Matrix, phase: Matrix) -> Matrix:
    """Waves less the straight line through both ends of the scale."""
    start, end = np.sin(phase), np.sin(math.pi * waves + phase)
    return np.sin(math.pi * waves * part + phase) - start - (end - start) * part


def stated_error(sensor: Sensor, noise: float) -> float:
    """Return how far off a reading with this noise may be by the specification of its sensor; (111)."""
    return sensor.nonlinearity * sensor.full_scale + sensor.resolution + noise


def detection_limits(stack: Stack, rig: Rig) -> dict[str, float]:
    """Return what each channel may be off by its specification [N, m]; docs/model.md (111).

    A position answers to what the load cells may be off, through the compliance of the tendon.
    """
    own: dict[str, float] = {}
    for block in stack.blocks:
        sensor = rig.sensors.get(block.channel, Sensor())
        noise = stack.readings[block.run].noise[block.channel]
        own[block.channel] = stated_error(sensor, noise)
    cell = max((own[name] for name in CELLS if name in own), default=LIMITS.weakest_N)
    length = max(reading.route.arcs.total_length for reading in stack.readings)
    give = rig.tendon.compliance_per_N * length * cell
    return {name: value if name in CELLS else value + give for name, value in own.items()}


def size_over_limit(stack: Stack, change: Vector, limits: Mapping[str, float]) -> float:
    """Return the largest change of any channel over its detection limit [1]; `change` [rows] [N, m]."""
    level = 1.0 - EVIDENCE_SCALE.false_alarms
    sizes = [
        float(np.quantile(np.abs(change[block.rows]), level)) / limits[block.channel]
        for block in stack.blocks
    ]
    return max(sizes)


def detected_size(problem: Problem, change: Vector, at: Point, limits: Mapping[str, float]) -> float:
    """Return the largest change over its detection limit [1], but no more than a play over that of the drive.

    A play narrower than the noise of the position that drives turns with that noise; docs/model.md (111).
    """
    size = size_over_limit(problem.stack, change, limits)
    plays = [effect.width_m for effect in at.effects if isinstance(effect, Backlash)]
    moved = [each for each in problem.stack.readings if each.drive == "displacement_in_m"]
    noise = max((each.noise[each.drive] for each in moved), default=0.0)
    return min([size, *(width / noise for width in plays if noise)])


def leftover(problem: Problem, left: Vector) -> float:
    """Return what is left beyond white noise of the worst channel, rms over its detection limit [1]; (113).

    `left` is measured less simulated [rows] [N, m].
    """
    stack, limits, most = problem.stack, detection_limits(problem.stack, problem.rig), 0.0
    square = np.square(problem.whitening.whitened(left)[: stack.size])
    for name in dict.fromkeys(block.channel for block in stack.blocks):
        rows = np.concatenate([np.r_[block.rows] for block in stack.blocks if block.channel == name])
        beyond = max(float(square[rows].mean()) - 1.0, 0.0)
        sigma = float(np.sqrt(np.mean(np.square(problem.whitening.sigma[rows]))))
        most = max(most, math.sqrt(beyond) * sigma / limits[name])
    return most
