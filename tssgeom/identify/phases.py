"""Phases of a run: pull and release where the distal end follows, the dead zones between, and holds."""

from __future__ import annotations

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.identify.finding import PHASES
from tssgeom.identify.readings import Reading

_STILL = 0.05  # of the median step in motion: slower is a hold


def phases(reading: Reading, slip_out: Vector) -> np.ndarray:
    """Return the phase of each sample, index into `PHASES` [n], by the drive and the last contact."""
    drive = reading.given[reading.drive]
    step = np.gradient(drive)
    moving = np.abs(step) > 2.0 * reading.noise[reading.drive]
    usual = float(np.median(np.abs(step[moving]))) if moving.any() else 0.0
    still = np.abs(step) <= _STILL * usual
    pulling = step > 0.0
    out = np.where(
        pulling,
        np.where(slip_out > 0, PHASES.index("pull"), PHASES.index("release_to_pull")),
        np.where(slip_out < 0, PHASES.index("release"), PHASES.index("pull_to_release")),
    )
    return np.where(still, PHASES.index("hold"), out)
