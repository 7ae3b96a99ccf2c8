"""Drives: courses between 0 (lowest) and 1 (peak), as rigs are moved."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
KINDS = ("sinus", "trapezoid", "chirp")


def course(kind: str, rng: np.random.Generator, samples: int) -> Array:
    """Return a course [samples] that starts at 0 and stays between 0 and 1.

    Raises
    ------
    ValueError
        Where there is no such kind.
    """
    x = np.linspace(0.0, 1.0, samples)
    if kind == "sinus":
        cycles = int(rng.integers(2, 5))
        height = np.where(
            np.floor(np.minimum(cycles * x, cycles - 1e-9)) % 2 == 0, 1.0, rng.uniform(0.5, 0.8)
        )
        return height * 0.5 * (1.0 - np.cos(2.0 * np.pi * cycles * x))
    if kind == "chirp":
        slow, fast = 1.2, rng.uniform(2.5, 4.0)
        phase = slow * x + 0.5 * (fast - slow) * x**2
        return (1.0 - rng.uniform(0.2, 0.4) * x) * 0.5 * (1.0 - np.cos(2.0 * np.pi * phase))
    if kind == "trapezoid":
        turns = [0.0, 1.0, rng.uniform(0.25, 0.5), rng.uniform(0.7, 0.9), 0.0, rng.uniform(0.85, 1.0), 0.1]
        corners, levels, at = [0.0], [0.0], 0.0
        for level in turns[1:]:
            at += abs(level - levels[-1]) * rng.uniform(0.7, 1.4)
            corners.append(at)
            at += rng.uniform(0.15, 0.35)
            corners.append(at)
            levels += [level, level]
        return np.interp(x * corners[-1], corners, levels)
    raise ValueError(f"no such drive: {kind}")
