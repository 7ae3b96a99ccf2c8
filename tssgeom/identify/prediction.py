"""What the sensors of a rig should read in a run, and how far a clean rig's readings may lie from that.

The forward model and the error model of `discover` and `calibrate`: white noise of each reading, and errors
that many readings share. Source: docs/model.md (100)-(102).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.effects import AnyEffect, Setup, together
from tssgeom.identify.drive_noise import sampled_drives
from tssgeom.identify.marches import march_once
from tssgeom.identify.readings import Reading
from tssgeom.identify.route_directions import main_directions, other_directions
from tssgeom.rig import Rig, Sensor
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.contact_grid import edges
from tssgeom.tendon.bars.model import BARS, begin, carry_on, model_of, setup_of


@dataclass(frozen=True, slots=True)
class NoiseModelSettings:
    """What sensors read off the truth where their specification is silent.

    Frozen on the development seeds of `benchmarks.discovery`.
    """

    zero_of_cell: float = 0.5
    """Of its noise: zero of a tared load cell in a run [1]; chosen."""
    zero_of_position: float = 3.0
    """Of its noise: zero of a position [1]; chosen: zeroed by one or a few readings."""
    drift: float = 0.3
    """Of its noise: s.d. of each wave of drift within a run [1]; chosen on development seeds."""
    waves: tuple[int, ...] = (1, 2)
    """Half waves of drift within a run; chosen."""
    bends: tuple[float, ...] = (0.7, 0.5, 0.3, 0.15)
    """Of the nonlinearity: sine waves of a cell over its scale [1]; chosen on development seeds."""
    arc_modes: int = 4
    """Directions of the covariance of a route that count in a fit; chosen. Intervals count all, (115)."""
    smoothed: float = 3.0
    """Over the median s.d. of a channel: a less exact reading is left out of its rms [1]; chosen."""


NOISE = NoiseModelSettings()
_UNIFORM_SD = 1.0 / math.sqrt(12.0)  # of the change about a sharp turn: it lies anywhere between two samples

FINE = 240
"""Bars of the run that shows what too few bars make wrong; its elongation is right to 1e-5."""


CELLS = ("tension_in_N", "tension_out_N")
"""Channels of load cells, whose zero and drift are small beside their noise."""


@dataclass(frozen=True, slots=True)
class Block:
    """One channel of one run within the vector."""

    run: int
    channel: str
    rows: slice
    kept: np.ndarray
    """[n] bool: samples of the run that have a reading."""


@dataclass(frozen=True, slots=True)
class Stack:
    """Runs whose readings stand one behind the other."""

    readings: tuple[Reading, ...]
    blocks: tuple[Block, ...]
    measured: Vector
    """[rows] [N, m]."""
    noise: Vector
    """[rows] Standard deviation of white noise of the sensors [N, m]."""

    @property
    def size(self) -> int:
        """Readings in all."""
        return len(self.measured)

    def flat(self, channels: Sequence[Mapping[str, Vector]]) -> Vector:
        """Return channels of every run [runs] as one vector [rows]."""
        out = np.empty(self.size)
        for block in self.blocks:
            out[block.rows] = channels[block.run][block.channel][block.kept]
        return out

    def split(self, vector: Vector) -> list[dict[str, Vector]]:
        """Return a vector [rows] by run and channel, NaN where there is no reading."""
        out: list[dict[str, Vector]] = [{} for _ in self.readings]
        for block in self.blocks:
            column = np.full(len(block.kept), np.nan)
            column[block.kept] = vector[block.rows]
            out[block.run][block.channel] = column
        return out


def stacked(readings: Sequence[Reading]) -> Stack:
    """Put the readings of some runs behind one another."""
    blocks, values, noise, start = list[Block](), list[Vector](), list[Vector](), 0
    for k, reading in enumerate(readings):
        for channel, column in reading.measured.items():
            kept = np.isfinite(column)
            count = int(kept.sum())
            blocks.append(Block(k, channel, slice(start, start + count), kept))
            values.append(column[kept])
            noise.append(np.full(count, reading.noise[channel]))
            start += count
    return Stack(tuple(readings), tuple(blocks), np.concatenate(values), np.concatenate(noise))


@dataclass(frozen=True, slots=True)
class Errors:
    """The error model of a stack."""

    sigma: Vector
    """[rows] Standard deviation of what is white, that of the drive included [N, m]."""
    modes: Matrix
    """[rows, k] Shared errors, each at one standard deviation, over sigma [1]."""
    names: tuple[str, ...]
    """Of the modes; the same name in two stacks is the same error."""
    brief: Vector
    """[rows] The part of sigma that is new in each sample [N, m]."""
    lasting: Matrix
    """[rows, draws] Samples of the rest of it, the error of the denoised drive, which lasts [N, m]."""


def errors_of(stack: Stack, rig: Rig, effects: Sequence[AnyEffect] = ()) -> Errors:
    """Return what sensors of this specification may read off the truth, about this model."""
    base = simulated(stack, rig, effects)
    of_drive = [_from_drive(reading, rig, effects) for reading in stack.readings]
    lasting = np.column_stack(
        [stack.flat(draw) for draw in zip(*(each.lasting for each in of_drive), strict=True)]
    )
    brief = np.hypot(stack.noise, stack.flat([each.brief for each in of_drive]))
    sigma = np.hypot(brief, stack.flat([each.spread for each in of_drive]))
    shared: dict[str, Vector] = {}
    for name, mode in _all_modes(stack, rig, effects, base):
        shared[name] = shared.get(name, 0.0) + mode
    modes = np.column_stack([mode / sigma for mode in shared.values()])
    return Errors(read_only(sigma), modes, tuple(shared), brief, lasting)


class _OfDrive(NamedTuple):
    """Errors of the channels of a run [n] [N, m] from that of its drive."""

    lasting: list[dict[str, Vector]]
    """[draws]"""
    spread: dict[str, Vector]
    """Root mean square of those."""
    brief: dict[str, Vector]
    """Since sharp turns lie between samples."""


def _from_drive(reading: Reading, rig: Rig, effects: Sequence[AnyEffect]) -> _OfDrive:
    """Return the errors of each channel for new noise of the drive, denoised; docs/model.md (100)."""
    drives = sampled_drives(reading.given[reading.drive], reading.noise[reading.drive], reading.time)
    jump, lasting = (
        {name: np.zeros(len(reading.time)) for name in reading.measured},
        list[dict[str, Vector]](),
    )
    for one, other in zip(drives.true, drives.denoised, strict=True):
        truth, answer = (run_channels(reading, rig, effects, drive=each) for each in (one, other))
        lasting.append({name: answer[name] - truth[name] for name in jump})
        jump = {name: np.maximum(most, _jump(truth[name])) for name, most in jump.items()}
    square = {name: np.mean([np.square(draw[name]) for draw in lasting], axis=0) for name in jump}
    spread = {name: np.sqrt(_spread(each)) for name, each in square.items()}
    brief = {name: _UNIFORM_SD * drives.beside_turns * most for name, most in jump.items()}
    return _OfDrive(lasting, spread, brief)


def _jump(values: Vector) -> Vector:
    """Return how far a channel goes from two samples before to two behind."""
    around = np.lib.stride_tricks.sliding_window_view(np.pad(values, 2, "edge"), 5)
    return np.ptp(around, axis=1)


def _spread(values: Vector) -> Vector:
    """Return means over neighbouring samples: a few draws give each of them badly."""
    return np.convolve(np.pad(values, 1, "edge"), np.full(3, 1.0 / 3.0), "valid")


def _all_modes(
    stack: Stack, rig: Rig, effects: Sequence[AnyEffect], base: Vector
) -> Iterator[tuple[str, Vector]]:
    yield from _of_sensors(stack, rig, base)
    for k in range(len(stack.readings)):
        yield from _of_drive(stack, k, rig, effects, base)
    yield from _of_routes(stack, rig, effects, base, main_directions)


def _of_sensors(stack: Stack, rig: Rig, base: Vector) -> Iterator[tuple[str, Vector]]:
    """Yield zero, drift and bend of each channel; docs/model.md (101).

    Bends lie where the model is, not where a reading is: a mode that held its noise would tilt the fit.
    """
    for block in stack.blocks:
        reading = stack.readings[block.run]
        noise = reading.noise[block.channel]
        label = f"{block.channel} of {reading.name}"
        time = reading.time[block.kept]
        share = (time - reading.time[0]) / max(float(np.ptp(reading.time)), 1e-12)
        yield (
            f"zero of {label}",
            _put(stack, block.rows, np.full(len(time), _zero_sd(reading, block.channel))),
        )
        for k in NOISE.waves:
            wave = NOISE.drift * noise * np.cos(k * math.pi * share)
            yield f"drift {k} of {label}", _put(stack, block.rows, wave)
        sensor = rig.sensors.get(block.channel, Sensor())
        if sensor.nonlinearity > 0.0 and sensor.full_scale > 0.0:
            for k, bow in enumerate(sensor_bends(base[block.rows], sensor).T, start=1):
                yield f"bend {k} of {block.channel}", _put(stack, block.rows, bow)


def sensor_bends(reading: Vector, sensor: Sensor) -> Matrix:
    """Return errors of readings [n], of one standard deviation each [n, waves], in their unit; (101)."""
    share = np.clip(reading / sensor.full_scale, -1.0, 1.0)
    turns = math.pi * np.arange(1, len(NOISE.bends) + 1)
    return np.array(NOISE.bends) * sensor.nonlinearity * sensor.full_scale * np.sin(turns * share[:, None])


def _zero_sd(reading: Reading, channel: str) -> float:
    """Return how far off a zero may be: a position is zeroed as a run begins, or plainly was not."""
    noise = reading.noise[channel]
    if channel in CELLS:
        return NOISE.zero_of_cell * noise
    column = reading.measured[channel]
    first = abs(float(column[np.isfinite(column)][0]))
    return first if first > 6.0 * noise else NOISE.zero_of_position * noise


def _put(stack: Stack, rows: slice, values: Vector) -> Vector:
    out = np.zeros(stack.size)
    out[rows] = values
    return out


def _of_drive(
    stack: Stack, k: int, rig: Rig, effects: Sequence[AnyEffect], base: Vector
) -> Iterator[tuple[str, Vector]]:
    """Yield zero of the drive, levels of its turns, and how it leaves holds; docs/model.md (102), (249)."""
    reading = stack.readings[k]
    drive, noise = reading.given[reading.drive], reading.noise[reading.drive]
    drives = sampled_drives(drive, noise, reading.time)
    yield f"zero of the drive of {reading.name}", _moved(stack, k, rig, effects, np.full(len(drive), noise))
    for sample, plateau in drives.turns:
        yield f"turn {sample} of {reading.name}", _moved(stack, k, rig, effects, plateau)
    for sample, way in drives.leaving:
        channels = run_channels(reading, rig, effects, drive=drive + way)
        yield f"leaving {sample} of {reading.name}", _beyond(stack, k, channels, base)


def _moved(stack: Stack, k: int, rig: Rig, effects: Sequence[AnyEffect], by: Vector) -> Vector:
    """Half the difference of two runs whose drives are moved to either side."""
    reading = stack.readings[k]
    drive = reading.given[reading.drive]
    low, high = (run_channels(reading, rig, effects, drive=drive + sign * by) for sign in (-1.0, 1.0))
    moved = {name: 0.5 * (high[name] - low[name]) for name in high.keys() & low.keys()}
    return _beyond(stack, k, moved, np.zeros(stack.size))


def _beyond(stack: Stack, k: int, channels: Mapping[str, Vector], base: Vector) -> Vector:
    """Return what channels of a run are beyond those of the model [rows]."""
    out = np.zeros(stack.size)
    for block in stack.blocks:
        if block.run == k:
            out[block.rows] = channels[block.channel][block.kept] - base[block.rows]
    return out


def of_other_directions(stack: Stack, rig: Rig, effects: Sequence[AnyEffect]) -> Matrix:
    """Return what angles of routes may be off beside the directions that a fit counts [rows, m]; (115)."""
    base = simulated(stack, rig, effects)
    columns = [column for _, column in _of_routes(stack, rig, effects, base, other_directions)]
    return np.column_stack([np.zeros((stack.size, 0)), *columns])


def _of_routes(
    stack: Stack,
    rig: Rig,
    effects: Sequence[AnyEffect],
    base: Vector,
    directions: Callable[[Arcs, int], list[Vector]],
) -> Iterator[tuple[str, Vector]]:
    """Yield angles of each route, along directions of their covariance."""
    routes = {reading.route.name: reading.route for reading in stack.readings}
    for name, route in routes.items():
        for m, way in enumerate(directions(route.arcs, NOISE.arc_modes)):
            arcs = _stepped(route.arcs, way)
            out = np.zeros(stack.size)
            for k, reading in enumerate(stack.readings):
                if reading.route.name == name:
                    out += _beyond(stack, k, run_channels(reading, rig, effects, arcs=arcs), base)
            yield f"direction {m} of {name}", out


def _stepped(arcs: Arcs, by: Vector) -> Arcs:
    return Arcs.exact(arcs.length, np.maximum(arcs.angle + by, 0.0))


def total_sigma(errors: Errors) -> Vector:
    """Return the standard deviation of all that the sensors may read off the truth [rows] [N, m]."""
    return errors.sigma * np.sqrt(1.0 + np.square(errors.modes).sum(axis=1))


def exact(sigma: Vector) -> np.ndarray:
    """Return which readings of a channel are about as exact as its sensor: not those beside a turn, (112)."""
    return sigma <= NOISE.smoothed * np.nanmedian(sigma)


def run_channels(
    reading: Reading,
    rig: Rig,
    effects: Iterable[AnyEffect] = (),
    *,
    bars: int = BARS,
    arcs: Arcs | None = None,
    drive: Vector | None = None,
) -> dict[str, Vector]:
    """Return what each channel of one run should have read, on its route and drive or on others."""
    given = reading.given if drive is None else {**reading.given, reading.drive: drive}
    return _channels(reading, together(setup_of(rig), effects), bars, arcs or reading.route.arcs, given)


def _channels(
    reading: Reading, setup: Setup, bars: int, arcs: Arcs, given: Mapping[str, Vector]
) -> dict[str, Vector]:
    model = model_of(setup, arcs, reading.drive, edges(arcs, bars))
    return carry_on(model, begin(model), given, march=march_once)[0].channels


def simulated(stack: Stack, rig: Rig, effects: Iterable[AnyEffect] = (), *, bars: int = BARS) -> Vector:
    """Return what all readings should have been [rows]."""
    setup = together(setup_of(rig), effects)
    return stack.flat([_channels(each, setup, bars, each.route.arcs, each.given) for each in stack.readings])
