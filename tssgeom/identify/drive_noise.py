"""What else a measured drive may have been: drives of the same noise, and levels of its turns.

They depend on the readings alone, so that all models of a campaign share them. Source: docs/model.md (100),
(102).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from tssgeom.arrays import Matrix, Vector, read_only
from tssgeom.identify.drive import DRIVE, blunted, calmed, hold, turn_levels, turning_points


@dataclass(frozen=True, slots=True)
class DriveNoiseSettings:
    """How drives are sampled.

    Frozen on the development seeds of `benchmarks.discovery`.
    """

    draws: int = 8
    """Draws of the noise of the drive; chosen: its s.d. is known to 25 %."""
    soft: int = 3
    """Samples over which a hold may begin and end; chosen on development seeds."""


DRIVE_NOISE = DriveNoiseSettings()
_SEED = 20  # of the draws; any, but the same in all fits of a campaign


class SampledDrives(NamedTuple):
    """Drives that may have been, and what is denoised of their readings."""

    true: Matrix
    """[draws, n]"""
    denoised: Matrix
    """[draws, n]"""
    beside_turns: Vector
    """[n] 1 at sharp turns and their neighbours, else 0."""
    turns: tuple[tuple[int, Vector], ...]
    """Sample of each turn, and [n] one standard deviation of its level."""
    leaving: tuple[tuple[int, Vector], ...]
    """First sample of each hold, and [n] how far the drive may leave it early, at one standard deviation."""


def sampled_drives(drive: Vector, noise: float, time: Vector) -> SampledDrives:
    """Return what else a drive [n], already denoised, may have been.

    Parameters
    ----------
    drive, time
        [n] N or m, and s.
    noise
        Standard deviation of the readings of the drive [N, m].
    """
    return _sampled(*(np.asarray(each, dtype=np.float64).tobytes() for each in (drive, time)), noise)


@lru_cache(maxsize=64)
def _sampled(of_drive: bytes, of_time: bytes, noise: float) -> SampledDrives:
    drive, time = np.frombuffer(of_drive), np.frombuffer(of_time)
    rng, holds = np.random.default_rng(_SEED), _holds(drive, noise)
    soft, blunt = _softened(drive, [hold(drive, 0, noise), *holds]) - drive, blunted(drive, holds)
    true, denoised = np.empty((2, DRIVE_NOISE.draws, len(drive)))
    for k in range(DRIVE_NOISE.draws):
        read = drive + rng.uniform() * soft
        true[k] = read + rng.uniform() * blunt
        again = calmed(read + noise * rng.standard_normal(len(drive)), noise, time)
        denoised[k] = again + (drive[0] - again[0])
    turns = tuple((sample, read_only(sd * plateau)) for sample, plateau, sd in turn_levels(drive, noise))
    beside = read_only(_beside_turns(drive, holds))
    rests = [each for each in (hold(drive, 0, noise), *holds) if each[1] - each[0] > 1]
    leaving = tuple((each[0], _leaving(drive, each, noise)) for each in rests)
    return SampledDrives(read_only(true), read_only(denoised), beside, turns, leaving)


def _holds(drive: Vector, noise: float) -> list[tuple[int, int]]:
    """Return the first sample of each turn and the one behind its last; a sharp turn is one sample long."""
    return [hold(drive, sample, noise) for sample in turning_points(drive, noise)]


def _beside_turns(drive: Vector, holds: Sequence[tuple[int, int]]) -> Vector:
    """Return 1 at each sharp turn and its neighbours, else 0: between which samples it lies is unsure."""
    out = np.zeros(len(drive))
    for start, stop in holds:
        if stop - start == 1:
            out[max(start - 1, 0) : start + 2] = 1.0
    return out


def _softened(drive: Vector, holds: Sequence[tuple[int, int]]) -> Vector:
    """Return a drive whose holds begin late and end early by less than its noise would show.

    After a turn friction answers to a motion of a tenth of a micrometre, which no reading shows.
    """
    width, out = 2 * DRIVE_NOISE.soft + 1, drive.copy()
    means = np.convolve(np.pad(drive, DRIVE_NOISE.soft, "edge"), np.full(width, 1.0 / width), "valid")
    for start, stop in holds:
        if stop - start > 2 * DRIVE_NOISE.soft:
            for edge in (start, stop):
                near = slice(max(edge - DRIVE_NOISE.soft, 0), edge + DRIVE_NOISE.soft)
                out[near] = means[near]
    return out


def _leaving(drive: Vector, held: tuple[int, int], noise: float) -> Vector:
    """Return what is added to a drive that leaves a hold early, hidden by noise; docs/model.md (249)."""
    start, stop = held
    first = (start + stop) // 2
    way = np.square(np.arange(1.0, stop - first + 1) / (stop - first))
    most = DRIVE.flat / math.sqrt(3.0) * noise / math.sqrt(float(np.square(way).sum()))
    sign = 1.0 if drive[min(stop, len(drive) - 1)] >= drive[stop - 1] else -1.0
    out = np.zeros(len(drive))
    out[first:stop] = sign * most * way
    gone = sign * (drive[stop:] - drive[stop - 1])  # until the drive itself is farther
    near = int(np.argmax(gone > most)) if np.any(gone > most) else len(gone)
    out[stop : stop + near] = sign * (most - gone[:near])
    return read_only(out)
