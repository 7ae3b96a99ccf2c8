"""All readings of some runs as one vector, and what the model says of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from tssgeom.arrays import Vector
from tssgeom.effects import Library
from tssgeom.identify.readings import Reading
from tssgeom.rig import Friction, Rig
from tssgeom.route.pieces import Arcs
from tssgeom.tendon.bars.model import BARS, begin, carry_on, prepare

FINE = 240
"""Bars of the run that tells what too few bars make wrong."""


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


def with_base(rig: Rig, friction: float, compliance: float) -> Rig:
    """Return the rig with another coefficient of friction [1] and compliance [1/N]."""
    tendon = msgspec.structs.replace(rig.tendon, compliance_per_N=compliance)
    return msgspec.structs.replace(rig, friction=Friction(coefficient=friction), tendon=tendon)


def run_channels(
    reading: Reading,
    rig: Rig,
    effects: Iterable[Library] = (),
    *,
    bars: int = BARS,
    arcs: Arcs | None = None,
    drive: Vector | None = None,
) -> dict[str, Vector]:
    """Return what each channel of one run should have read, on its route and drive or on others."""
    given = reading.given if drive is None else {**reading.given, reading.drive: drive}
    laid = reading.route.arcs if arcs is None else arcs
    model = prepare(given, laid, rig, effects, drive=reading.drive, bars=bars)
    return carry_on(model, begin(model), given)[0].channels


def simulated(stack: Stack, rig: Rig, effects: Iterable[Library] = (), *, bars: int = BARS) -> Vector:
    """Return what all readings should have been [rows]."""
    told = tuple(effects)
    return stack.flat([run_channels(reading, rig, told, bars=bars) for reading in stack.readings])
