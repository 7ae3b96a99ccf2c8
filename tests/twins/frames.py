"""Scenarios as sensed frames."""

from collections.abc import Iterator

import numpy as np

from tests.twins.scenarios import Scenario
from tssgeom import Frame

TURNED = 1.0  # of the plane of a piece against the one before, on spatial routes [rad]; chosen


def frames(
    scenario: Scenario,
    every: int = 1,
    points: int = 40,
    noise_m: float = 0.0,
    spatial: bool = False,
    tension_out: bool = False,
    seed: int = 0,
) -> Iterator[Frame]:
    """Yield each `every`-th sample as a frame of `points` sensed points, with white noise of `noise_m` [m].

    Points without noise are one and the same array while the shape sensor states the same. The route turns
    left and right in a plane, or is `spatial`. Points know nothing of a kink; where the shape is wrong, all
    angles have the gain of that time. T_in, displacement_in and, with `tension_out`, T_out are the readings.
    """
    rng, machine = np.random.default_rng((scenario.seed, seed)), scenario.machine
    gains, last, exact = scenario.truth["route_angle_gain"], np.nan, np.empty((0, 3))
    for i in range(0, len(scenario.times), every):
        if gains[i] != last:
            last = gains[i]
            exact = route_points(machine.lengths_m, last * machine.angles_rad, points, spatial)
            exact.setflags(write=False)
        sensed = exact + noise_m * rng.standard_normal(exact.shape) if noise_m else exact
        yield Frame(
            sensed,
            time=float(scenario.times[i]),
            tension_in=float(scenario.readings["tension_in_N"][i]),
            displacement_in=float(scenario.readings["displacement_in_m"][i]),
            tension_out=float(scenario.readings["tension_out_N"][i]) if tension_out else None,
        )


def route_points(lengths: np.ndarray, angles: np.ndarray, points: int, spatial: bool = False) -> np.ndarray:
    """Return [n, 3] points at even arc lengths on pieces of constant curvature, tangent to each other [m]."""
    stations = np.concatenate(([0.0], np.cumsum(lengths)))
    s = np.linspace(0.0, stations[-1], points)
    piece = np.clip(np.searchsorted(stations, s, side="right") - 1, 0, len(lengths) - 1)
    position, tangent, normal = np.zeros(3), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    result = np.empty((points, 3))
    for k, (length, angle) in enumerate(zip(lengths, angles, strict=True)):
        inside = piece == k
        along, across = _arc((s[inside] - stations[k]) / length, length, angle)
        result[inside] = position + along[:, None] * tangent + across[:, None] * normal
        along, across = _arc(np.ones(1), length, angle)
        position = position + along[0] * tangent + across[0] * normal
        turned = np.cos(angle) * tangent + np.sin(angle) * normal
        normal = np.cos(angle) * normal - np.sin(angle) * tangent
        tangent = turned
        turn = TURNED if spatial else np.pi
        normal = np.cos(turn) * normal + np.sin(turn) * np.cross(tangent, normal)
    return result


def _arc(portion: np.ndarray, length: float, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """How far along and across its first tangent a portion of an arc goes [m]."""
    half = 0.5 * portion * angle
    chord = portion * length * np.sinc(half / np.pi)
    return chord * np.cos(half), chord * np.sin(half)
