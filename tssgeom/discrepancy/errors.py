"""What the sensors may read of a clean rig: white noise of each reading, and errors that many readings share.

Source: docs/model.md (100)-(102).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.discrepancy.readings import Reading
from tssgeom.discrepancy.stack import Stack, run_channels
from tssgeom.settings import Rig, Sensor
from tssgeom.shape.arcs import Arcs
from tssgeom.tendon.effects import Library
from tssgeom.tendon.run_drive import hold, turning_points

CELLS = ("tension_in_N", "tension_out_N")
"""Channels of load cells, whose zero and drift are small beside their noise."""
_ZERO_OF_CELL = 0.5  # of its noise: what a tared cell is off in a run
_ZERO_OF_PLACE = 3.0  # of its noise: zeroed by one or a few readings
_DRIFT = 0.3  # of its noise: what a channel wanders within a run
_WAVES = (1, 2)  # half waves of that within a run
_BENDS = (0.7, 0.5, 0.3, 0.15)  # of the nonlinearity: sine waves of what a cell bends over its scale
_ARC_MODES = 4  # directions of the covariance of a route that count
_STEEP = 3.0  # noise of the drive below which two samples tell no slope
_UNSURE = 0.2  # of the change from sample to sample: what a channel is off beside a turn of the drive
_BESIDE = 3  # samples behind a turn that are off
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
    channels = [run_channels(reading, rig, effects) for reading in stack.readings]
    base = stack.flat(channels)
    drive = stack.flat([_from_drive(r, c) for r, c in zip(stack.readings, channels, strict=True)])
    sigma = np.hypot(stack.noise, drive)
    shared: dict[str, Vector] = {}
    for name, mode in _all_modes(stack, rig, effects, base):
        shared[name] = shared.get(name, 0.0) + mode
    modes = np.column_stack([mode / sigma for mode in shared.values()])
    return Errors(read_only(sigma), modes, tuple(shared))


def _from_drive(reading: Reading, channels: dict[str, Vector]) -> dict[str, Vector]:
    """Return white noise of the drive as each channel shows it; docs/model.md (100)."""
    noise, drive = reading.noise[reading.drive], reading.given[reading.drive]
    moving = np.abs(np.diff(drive))
    usual = float(np.median(moving[moving > 0.0])) if (moving > 0.0).any() else noise
    width = int(np.clip(math.ceil(_STEEP * noise / usual), 1, len(drive) // 20 + 1))
    step, near = _rise(drive, width), _near_turns(drive, noise, width)
    out = {}
    for name in reading.measured:
        rise = _rise(channels[name], width)
        white = noise * rise / np.maximum(step, _STEEP * noise) * (step > _STEEP * noise)
        out[name] = np.hypot(white, _UNSURE * near * rise)
    return out


def _rise(values: Vector, width: int) -> Vector:
    """Return how much values change over `width` samples, the mean to both sides."""
    at = np.arange(len(values))
    first, last = np.maximum(at - width, 0), np.minimum(at + width, len(values) - 1)
    return np.abs(values[last] - values[first]) * width / (last - first)


def _near_turns(drive: Vector, noise: float, width: int) -> Vector:
    """Return 1 where a sample stands beside a turn or the end of a hold there, else 0."""
    out = np.zeros(len(drive))
    for place in turning_points(drive, noise):
        start, stop = hold(drive, place, noise)
        for edge in (start, stop - 1):
            out[max(edge - width, 0) : edge + _BESIDE * width] = 1.0
    return out


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
        plateau, sd = _turn(drive, place, noise)
        yield f"turn {place} of {reading.name}", _moved(stack, k, rig, effects, sd * plateau)


def _turn(drive: Vector, place: int, noise: float) -> tuple[Vector, float]:
    """Return which samples move with a turn, [n], and the standard deviation of its level."""
    start, stop = hold(drive, place, noise)
    plateau = np.zeros(len(drive))
    plateau[start:stop] = 1.0
    sharp = 0.0
    if stop - start == 1 and 0 < place < len(drive) - 1:
        sharp = _BETWEEN * min(abs(drive[place] - drive[place - 1]), abs(drive[place + 1] - drive[place]))
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
