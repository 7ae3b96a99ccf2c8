"""The threshold: what the best of a library reaches on clean campaigns of the same sensors.

A parametric bootstrap: clean residuals are drawn from the sensor specification, with bends of load cells of
other forms than the error model has, and looked at with the same straight lines. Source: docs/model.md (110).
"""

from __future__ import annotations

import math

import numpy as np

from tssgeom.arrays import Matrix
from tssgeom.identify.noise_model import Errors
from tssgeom.identify.problem import Problem
from tssgeom.identify.search import Screen
from tssgeom.rig import Sensor

DRAWS = 400
"""Clean campaigns that are drawn."""
_RATE = 0.01  # of clean campaigns that may pass
_LEAST = 10.0  # of the threshold: ΔBIC that would not convince of anything


def threshold(problem: Problem, errors: Errors, screen: Screen, seed: int) -> float:
    """Return what ΔBIC has to pass, family-wise over the library; docs/model.md (110)."""
    rng = np.random.default_rng(seed)
    drawn = problem.weighing.weighed(_clean(problem, errors, rng))
    frame, _ = np.linalg.qr(screen.base)
    drawn -= frame @ (frame.T @ drawn)
    best = np.full(DRAWS, -np.inf)
    for look in screen.looks:
        length = float(np.linalg.norm(look.column))
        if length > 0.0:
            score = look.column @ drawn / length
            gain = np.square(np.maximum(score, 0.0) if look.variant.positive else score)
            best = np.maximum(best, gain - len(look.variant.free) * math.log(problem.stack.size))
    return max(float(np.quantile(best, 1.0 - _RATE)), _LEAST)


def _clean(problem: Problem, errors: Errors, rng: np.random.Generator) -> Matrix:
    """Residuals of clean campaigns [rows, draws] [N, m]."""
    size = problem.stack.size
    told = np.array([0.0 if name.startswith("bend ") else 1.0 for name in errors.names])
    weight = told[:, None] * rng.standard_normal((len(told), DRAWS))
    out = rng.standard_normal((size, DRAWS)) + errors.modes @ weight
    out *= errors.sigma[:, None]
    for name in dict.fromkeys(block.channel for block in problem.stack.blocks):
        out += _bends(problem, name, rng)
    return out


def _bends(problem: Problem, channel: str, rng: np.random.Generator) -> Matrix:
    """Bends of one cell in each draw: a wave of any length and phase over the scale, as deep as specified."""
    told = problem.rig.sensors.get(channel, Sensor())
    out = np.zeros((problem.stack.size, DRAWS))
    depth = told.nonlinearity * told.full_scale
    if depth == 0.0:
        return out
    waves, phase = rng.uniform(0.5, 3.0, DRAWS), rng.uniform(0.0, 2.0 * math.pi, DRAWS)
    grid = np.linspace(0.0, 1.0, 101)[:, None]
    most = np.abs(_wave(grid, waves, phase)).max(axis=0)
    sized = depth * rng.uniform(0.3, 1.0, DRAWS) / most
    for block in problem.stack.blocks:
        if block.channel == channel:
            part = np.clip(problem.stack.measured[block.rows] / told.full_scale, 0.0, 1.0)
            out[block.rows] = _wave(part[:, None], waves, phase) * sized
    return out


def _wave(part: Matrix, waves: Matrix, phase: Matrix) -> Matrix:
    """Waves less the straight line through both ends of the scale."""
    start, end = np.sin(phase), np.sin(math.pi * waves + phase)
    return np.sin(math.pi * waves * part + phase) - start - (end - start) * part
