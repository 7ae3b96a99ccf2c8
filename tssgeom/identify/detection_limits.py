"""How large a change has to be: what the sensor specification alone can fake is not an effect.

Source: docs/model.md (111).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tssgeom.arrays import Vector
from tssgeom.identify.noise_model import CELLS
from tssgeom.identify.problem import Fit, Problem
from tssgeom.identify.stack import Stack
from tssgeom.rig import Rig, Sensor

_PART = 0.99  # of the readings change by less than what is told as the change
_CELL = 0.06  # N: guard of a tension that nobody measured


def guards(stack: Stack, rig: Rig) -> dict[str, float]:
    """Return what each channel may be off by its specification [N, m]; docs/model.md (111).

    A position answers to what the load cells may be off, through the compliance of the tendon.
    """
    own: dict[str, float] = {}
    for block in stack.blocks:
        told = rig.sensors.get(block.channel, Sensor())
        noise = stack.readings[block.run].noise[block.channel]
        own[block.channel] = told.nonlinearity * told.full_scale + told.resolution + noise
    cell = max((own[name] for name in CELLS if name in own), default=_CELL)
    length = max(reading.route.arcs.total_length for reading in stack.readings)
    give = rig.tendon.compliance_per_N * length * cell
    return {name: value if name in CELLS else value + give for name, value in own.items()}


def size_over_guard(stack: Stack, change: Vector, guard: Mapping[str, float]) -> float:
    """Return the largest change of any channel of any run over its guard [1]; `change` [rows] [N, m]."""
    parts = [
        float(np.quantile(np.abs(change[block.rows]), _PART)) / guard[block.channel] for block in stack.blocks
    ]
    return max(parts)


def leftover(problem: Problem, fit: Fit, guard: Mapping[str, float]) -> dict[str, float]:
    """Return by channel what is left beyond white noise, rms over its guard [1]; docs/model.md (113)."""
    stack, out = problem.stack, dict[str, float]()
    square = np.square(fit.residual[: stack.size])
    for name in dict.fromkeys(block.channel for block in stack.blocks):
        rows = np.concatenate([np.r_[block.rows] for block in stack.blocks if block.channel == name])
        beyond = max(float(square[rows].mean()) - 1.0, 0.0)
        sigma = float(np.sqrt(np.mean(np.square(problem.weighing.sigma[rows]))))
        out[name] = np.sqrt(beyond) * sigma / guard[name]
    return out
