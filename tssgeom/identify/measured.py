"""Measured runs as the model takes them: a drive, and what both ends answered."""

from __future__ import annotations

from dataclasses import dataclass

from tssgeom.arrays import Vector


@dataclass(frozen=True, slots=True)
class Measured:
    """Columns of one run, in SI; NaN where a reading is missing."""

    time: Vector
    """[n] [s]."""
    tension_in: Vector | None = None
    """[n] Total tension at the proximal end [N]."""
    displacement_in: Vector | None = None
    """[n] Of the tendon at the proximal end [m]."""
    tension_out: Vector | None = None
    """[n] Total tension at the distal end [N]."""
    elongation: Vector | None = None
    """[n] Displacement of the proximal less that of the distal end [m]."""
    temperature: Vector | None = None
    """[n] Temperature [°C]."""
