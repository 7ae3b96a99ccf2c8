"""What the sensors may read of a clean rig: white noise of each reading, and errors that many readings share.

Source: docs/model.md (100)-(102).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.effects import Library
from tssgeom.identify.drive import calmed, hold, turning_points
from tssgeom.identify.readings import Reading
from tssgeom.identify.stack import Stack, run_channels, simulated
from tssgeom.rig import Rig, Sensor
from tssgeom.route.pieces import Arcs

CELLS = ("tension_in_N", "tension_out_N")
"""Channels of load cells, whose zero and drift are small beside their noise."""
_ZERO_OF_CELL = 0.5  # of its noise: what a tared cell is off in a run
_ZERO_OF_PLACE = 3.0  # of its noise: zeroed by one or a few readings
_DRIFT = 0.3  # of its noise: what a channel wanders within a run
_WAVES = (1, 2)  # half waves of that within a run
_BENDS = (0.7, 0.5, 0.3, 0.15)  # of the nonlinearity: sine waves of what a cell bends over its scale
_ARC_MODES = 4  # directions of the covariance of a route that count
_BLURRED = 3.0  # times its median, from which an error is left out where a channel is told in one number
_DRAWS = 8  # of the noise of the drive
_SEED = 20  # of these: the same in all fits of a campaign
_UNSURE = 0.3  # of the change over the samples about a sharp turn: what a channel is off there
_SOFT = 3  # samples over which a hold may begin and end
_BETWEEN = 0.05  # of a sample's step: what a sharp turn may lie beyond where it was put
_LEVEL = 0.3  # of the noise of the drive: what the level of a hold is off for its shape


@dataclass(frozen=True, slots=True)
class Errors:
    """The error model of a stack."""

    sigma: Vector
    """[rows] Standard deviation of what is white, that of the drive included [N, m]."""
    modes: Matrix
    """[rows, k] Shared errors, each at one standard deviation, over sigma [1]."""
    names: tuple[str, ...]
    """Of the modes; the same name in two stacks is the same error."""


def errors_of(stack: Stack, rig: Rig, effects: Sequence[Library] = ()) -> Errors:
    """Return what sensors of this specification may read off the truth, about this model."""
    base = simulated(stack, rig, effects)
    drive = stack.flat([_from_drive(reading, rig, effects) for reading in stack.readings])
    sigma = np.hypot(stack.noise, drive)
    shared: dict[str, Vector] = {}
    for name, mode in _all_modes(stack, rig, effects, base):
        shared[name] = shared.get(name, 0.0) + mode
    modes = np.column_stack([mode / sigma for mode in shared.values()])
    return Errors(read_only(sigma), modes, tuple(shared))


def _from_drive(reading: Reading, rig: Rig, effects: Sequence[Library]) -> dict[str, Vector]:
    """Return what a channel is off for the noise of the drive, drawn and calmed anew; docs/model.md (100)."""
    drive, noise = reading.given[reading.drive], reading.noise[reading.drive]
    rng, holds = np.random.default_rng(_SEED), _holds(drive, noise)
    soft, blunt = _softened(drive, [hold(drive, 0, noise), *holds]) - drive, _blunted(drive, holds)
    square, jump = ({name: np.zeros(len(drive)) for name in reading.measured} for _ in range(2))
    for _ in range(_DRAWS):
        read = drive + rng.uniform() * soft
        truth = run_channels(reading, rig, effects, drive=read + rng.uniform() * blunt)
        again = calmed(read + noise * rng.standard_normal(len(drive)), noise, reading.time)
        seen = run_channels(reading, rig, effects, drive=again + (drive[0] - again[0]))
        for name in square:
            square[name] += np.square(seen[name] - truth[name]) / _DRAWS
            jump[name] = np.maximum(jump[name], _jump(truth[name]))
    beside = _beside_turns(drive, holds)
    return {
        name: np.hypot(np.sqrt(_spread(each)), _UNSURE * beside * jump[name]) for name, each in square.items()
    }


def _holds(drive: Vector, noise: float) -> list[tuple[int, int]]:
    """Return the first sample of each turn and the one behind its last; a sharp turn is one sample long."""
    return [hold(drive, place, noise) for place in turning_points(drive, noise)]


def _beside_turns(drive: Vector, holds: Sequence[tuple[int, int]]) -> Vector:
    """Return 1 at each sharp turn and its neighbours, else 0: between which samples it lies is unsure."""
    out = np.zeros(len(drive))
    for start, stop in holds:
        if stop - start == 1:
            out[max(start - 1, 0) : start + 2] = 1.0
    return out


def _jump(values: Vector) -> Vector:
    """Return how far a channel goes from two samples before to two behind."""
    around = np.lib.stride_tricks.sliding_window_view(np.pad(values, 2, "edge"), 5)
    return np.ptp(around, axis=1)


def _spread(values: Vector) -> Vector:
    """Return means over neighbouring samples: a few draws tell each of them badly."""
    return np.convolve(np.pad(values, 1, "edge"), np.full(3, 1.0 / 3.0), "valid")


def _softened(drive: Vector, holds: Sequence[tuple[int, int]]) -> Vector:
    """Return a drive whose holds begin late and end early by less than its noise would tell.

    After a turn friction answers to a motion of a tenth of a micrometre, which no reading shows.
    """
    out = drive.copy()
    means = np.convolve(np.pad(drive, _SOFT, "edge"), np.full(2 * _SOFT + 1, 1.0 / (2 * _SOFT + 1)), "valid")
    for start, stop in holds:
        if stop - start > 2 * _SOFT:
            for edge in (start, stop):
                near = slice(max(edge - _SOFT, 0), edge + _SOFT)
                out[near] = means[near]
    return out


def _blunted(drive: Vector, holds: Sequence[tuple[int, int]]) -> Vector:
    """Return how much lower each sharp turn may be: between two samples, it may be round."""
    out = np.zeros(len(drive))
    for start, stop in holds:
        if stop - start == 1:
            out[start] = 2.0 * _BETWEEN * _lesser_step(drive, start)
    return out


def _lesser_step(drive: Vector, place: int) -> float:
    """Return the smaller of the steps from a sample to its neighbours; 0 at an end of the run."""
    if not 0 < place < len(drive) - 1:
        return 0.0
    steps = drive[[place - 1, place + 1]] - drive[place]
    return float(steps[np.argmin(np.abs(steps))])


def _all_modes(
    stack: Stack, rig: Rig, effects: Sequence[Library], base: Vector
) -> Iterator[tuple[str, Vector]]:
    yield from _of_sensors(stack, rig, base)
    for k in range(len(stack.readings)):
        yield from _of_drive(stack, k, rig, effects)
    yield from _of_routes(stack, rig, effects, base)


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
        for k in _WAVES:
            wave = _DRIFT * noise * np.cos(k * math.pi * share)
            yield f"drift {k} of {label}", _put(stack, block.rows, wave)
        told = rig.sensors.get(block.channel, Sensor())
        if told.nonlinearity > 0.0 and told.full_scale > 0.0:
            part = np.clip(base[block.rows] / told.full_scale, -1.0, 1.0)
            for k, size in enumerate(_BENDS, start=1):
                bow = size * told.nonlinearity * told.full_scale * np.sin(k * math.pi * part)
                yield f"bend {k} of {block.channel}", _put(stack, block.rows, bow)


def _zero_sd(reading: Reading, channel: str) -> float:
    """Return how far off a zero may be: a position is zeroed as a run begins, or plainly was not."""
    noise = reading.noise[channel]
    if channel in CELLS:
        return _ZERO_OF_CELL * noise
    column = reading.measured[channel]
    first = abs(float(column[np.isfinite(column)][0]))
    return first if first > 6.0 * noise else _ZERO_OF_PLACE * noise


def _put(stack: Stack, rows: slice, values: Vector) -> Vector:
    out = np.zeros(stack.size)
    out[rows] = values
    return out


def _of_drive(stack: Stack, k: int, rig: Rig, effects: Sequence[Library]) -> Iterator[tuple[str, Vector]]:
    """Yield the zero of the drive, and the level of each of its turns; docs/model.md (102)."""
    reading = stack.readings[k]
    drive, noise = reading.given[reading.drive], reading.noise[reading.drive]
    yield f"zero of the drive of {reading.name}", _moved(stack, k, rig, effects, np.full(len(drive), noise))
    for place in turning_points(drive, noise):
        plateau, sd = _turn(drive, hold(drive, place, noise), noise)
        yield f"turn {place} of {reading.name}", _moved(stack, k, rig, effects, sd * plateau)


def _turn(drive: Vector, held: tuple[int, int], noise: float) -> tuple[Vector, float]:
    """Return which samples move with a turn, [n], and the standard deviation of its level."""
    start, stop = held
    plateau = np.zeros(len(drive))
    plateau[start:stop] = 1.0
    sharp = _BETWEEN * abs(_lesser_step(drive, start)) if stop - start == 1 else 0.0
    return plateau, noise * math.hypot(1.0 / math.sqrt(stop - start), _LEVEL) + sharp


def _moved(stack: Stack, k: int, rig: Rig, effects: Sequence[Library], by: Vector) -> Vector:
    """Half the difference of two runs whose drives are moved to either side."""
    reading = stack.readings[k]
    drive = reading.given[reading.drive]
    low, high = (run_channels(reading, rig, effects, drive=drive + sign * by) for sign in (-1.0, 1.0))
    return _difference(stack, k, low, high, 0.5)


def _difference(stack: Stack, k: int, low: dict, high: dict, factor: float) -> Vector:
    out = np.zeros(stack.size)
    for block in stack.blocks:
        if block.run == k:
            out[block.rows] = factor * (high[block.channel] - low[block.channel])[block.kept]
    return out


def _of_routes(
    stack: Stack, rig: Rig, effects: Sequence[Library], base: Vector
) -> Iterator[tuple[str, Vector]]:
    """Yield angles of each route, along the main directions of their covariance."""
    routes = {reading.route.name: reading.route for reading in stack.readings}
    for name, route in routes.items():
        for m, way in enumerate(_directions(route.arcs)):
            arcs = _stepped(route.arcs, way)
            out = np.zeros(stack.size)
            for k, reading in enumerate(stack.readings):
                if reading.route.name == name:
                    channels = run_channels(reading, rig, effects, arcs=arcs)
                    for block in stack.blocks:
                        if block.run == k:
                            out[block.rows] = channels[block.channel][block.kept] - base[block.rows]
            yield f"direction {m} of {name}", out


def _directions(arcs: Arcs) -> list[Vector]:
    """Return steps of one standard deviation of the angles, the widest first [rad]."""
    k = len(arcs.length)
    value, way = np.linalg.eigh(arcs.covariance[k:, k:])
    order = np.argsort(value)[::-1][:_ARC_MODES]
    return [math.sqrt(value[i]) * way[:, i] for i in order if value[i] > 1e-9]


def _stepped(arcs: Arcs, by: Vector) -> Arcs:
    return Arcs.exact(arcs.length, np.maximum(arcs.angle + by, 0.0))


def total_sigma(errors: Errors) -> Vector:
    """Return the standard deviation of all that the sensors may read off the truth [rows] [N, m]."""
    return errors.sigma * np.sqrt(1.0 + np.square(errors.modes).sum(axis=1))


def telling(sigma: Vector) -> np.ndarray:
    """Return which readings of a channel tell most of what its sensor can: not those beside a turn, (112)."""
    return sigma <= _BLURRED * np.nanmedian(sigma)
