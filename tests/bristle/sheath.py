"""Sheaths in space: smooth curves by their curvature, and what a shape sensor makes of them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

Array = np.ndarray


@dataclass(frozen=True, slots=True)
class Sheath:
    """A route, finely sampled.

    `s` is [m] of arc length [m], `points` [m,3] in m, `angle` [m] the curve angle up to there [rad], and
    `curvature` [m,2] its vectors in a frame without twist [1/m].
    """

    s: Array
    points: Array
    angle: Array
    curvature: Array

    @property
    def length(self) -> float:
        """Arc length [m]."""
        return float(self.s[-1])

    @property
    def total_angle(self) -> float:
        """Curve angle of all [rad]."""
        return float(self.angle[-1])

    def bend(self, at: Array) -> Array:
        """Return the curve angle for each length [rad/m] at arc lengths [m]."""
        return np.interp(at, self.s, np.gradient(self.angle, self.s))


def sheath_of(curvature: Array, length: float) -> Sheath:
    """Integrate a curve from its curvature vectors in a frame without twist.

    Parameters
    ----------
    curvature
        [m,2] components [1/m] at equal distances.
    length
        Arc length [m].
    """
    s = np.linspace(0.0, length, len(curvature))
    frame, points = np.eye(3), [np.zeros(3)]
    h = s[1]
    for first, second in pairwise(curvature):
        turn = 0.5 * h * (first + second)
        half = _turned(frame, 0.5 * turn)
        points.append(points[-1] + h * half[2])
        frame = _turned(frame, turn)
    points = np.array(points)
    ways = np.diff(points, axis=0)
    way = ways / np.linalg.norm(ways, axis=1)[:, None]
    corners = 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(np.diff(way, axis=0), axis=1), 0.0, 1.0))
    ends = 0.5 * h * np.linalg.norm(curvature[[0, -1]], axis=1)
    angle = np.cumsum([0.0, ends[0] + 0.5 * corners[0], *(0.5 * (corners[:-1] + corners[1:]))])
    return Sheath(s, points, np.append(angle, angle[-1] + 0.5 * corners[-1] + ends[1]), curvature)


def _turned(frame: Array, turn: Array) -> Array:
    """Return a frame (rows: two across, one along) after the last row turned to the others by [rad]."""
    across = turn[0] * frame[0] + turn[1] * frame[1]
    angle = float(np.hypot(*turn))
    if angle < 1e-15:
        return frame
    across /= angle
    along = frame[2]
    new = np.cos(angle) * along + np.sin(angle) * across
    rows = []
    for row in frame[:2]:
        part = row @ across
        rows.append(row + part * ((np.cos(angle) - 1.0) * across - np.sin(angle) * along))
    return np.array([*rows, new])


SAMPLES = 1601
"""Points of a curve (chosen: 0.4 mm apart; the turn of a bend is then true to 1e-5)."""


def random_sheath(rng: np.random.Generator, length: float, total_angle: float, kind: int) -> Sheath:
    """Draw a sheath of a total angle [rad]: 0 a wave in space, 1 two bends with straight ends, 2 a helix."""
    x = np.linspace(0.0, 1.0, SAMPLES)
    if kind == 0:
        waves = np.arange(1, 4)
        vector = sum(
            rng.normal(size=2)[None, :] / n * np.sin(np.pi * n * x + rng.uniform(0.0, 2.0 * np.pi))[:, None]
            for n in waves
        )
        vector = vector + rng.normal(size=2)[None, :]
    elif kind == 1:
        first, second = rng.uniform(0.2, 0.35), rng.uniform(0.65, 0.8)
        turned = rng.uniform(0.3, np.pi)
        vector = _bump(x, first, rng.uniform(0.12, 0.18))[:, None] * np.array([1.0, 0.0])
        height = rng.uniform(0.6, 1.6)
        second_bend = _bump(x, second, rng.uniform(0.1, 0.18))[:, None]
        vector = vector + height * second_bend * np.array([np.cos(turned), np.sin(turned)])
    else:
        pitch = rng.uniform(1.0, 3.0)
        grown = 1.0 + rng.uniform(-0.5, 0.5) * x
        vector = grown[:, None] * np.stack([np.cos(pitch * x), np.sin(pitch * x)], axis=1)
    size = np.linalg.norm(vector, axis=1)
    return sheath_of(vector * total_angle / (np.mean(0.5 * (size[1:] + size[:-1])) * length), length)


def _bump(x: Array, middle: float, half: float) -> Array:
    """Return a bend of constant curvature that is entered and left smoothly."""
    edge = 0.25 * half
    return 0.5 * (np.tanh((x - middle + half) / edge) - np.tanh((x - middle - half) / edge))


def bent_more(sheath: Sheath, at: float, extra: float, width: float) -> Sheath:
    """Return a sheath with an angle more [rad] about an arc length [m], which its points do not have."""
    share = np.clip((sheath.s - at) / width + 0.5, 0.0, 1.0)
    return Sheath(sheath.s, sheath.points, sheath.angle + extra * share, sheath.curvature)


def sensed(
    sheath: Sheath, rng: np.random.Generator, points: int, noise: float, gain: float
) -> tuple[Array, Array]:
    """Return sensed stations [n] and points [n,3], in m.

    The angles of the sensed curve are `gain` times the true ones, and each coordinate has `noise` [m].
    """
    points_of = sheath_of(gain * sheath.curvature, sheath.length).points
    stations = np.linspace(0.0, sheath.length, points)
    clean = np.stack([np.interp(stations, sheath.s, points_of[:, k]) for k in range(3)], axis=1)
    return stations, clean + noise * rng.normal(size=clean.shape)
