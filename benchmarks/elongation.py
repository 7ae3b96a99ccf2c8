"""Elongation of the paper's tendon on its first pull to 15 N, from any description of the route."""

from __future__ import annotations

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.rig import Rig

RIG = Rig()
TENSION_IN = 15.0
"""Tension at the proximal end, from a slack tendon [N]."""


def first_pull(length: Vector, angle: Vector) -> float:
    """Elongation [m] on pieces of the given lengths [m] and angles [rad]; docs/model.md (9), T_0 = 0."""
    turn = RIG.friction.coefficient * angle
    reaching = TENSION_IN * np.exp(-(np.cumsum(turn) - turn))
    mean = np.where(turn > 1e-12, -np.expm1(-turn) / np.maximum(turn, 1e-300), 1.0)
    return float(RIG.tendon.compliance_per_N * (length * mean) @ reaching)
