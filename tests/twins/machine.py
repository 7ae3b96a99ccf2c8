"""A machine by its seed: route, tendon, sensors, and how it is moved."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tests.lumped import Path, from_angle

RATE_HZ = 100.0
CELLS = 96  # 48 leave up to 18 mN rms in T_in on 7 rad, 96 leave 5 mN: as much as 100 readings of noise


class Range(NamedTuple):
    """What the seeds choose from. Chosen: machines of the paper's kind, with sensors of the shop."""

    friction: tuple[float, float] = (0.1, 0.2)
    most_exponent: float = 0.75
    """Of friction times total angle [1]. Chosen: 30 % more and T_in still stays between 2 and 25 N."""
    compliance_per_N: tuple[float, float] = (2.7e-4, 3.3e-4)
    total_angle_rad: tuple[float, float] = (3.0, 7.5)
    length_m: tuple[float, float] = (0.9, 1.1)
    pretension_N: tuple[float, float] = (2.8, 3.2)
    stiffness_N_per_m: tuple[float, float] = (1000.0, 3000.0)
    tension_noise_N: tuple[float, float] = (0.02, 0.05)
    displacement_noise_m: tuple[float, float] = (5e-6, 20e-6)
    stroke_s: tuple[float, float] = (1.0, 10.0)
    """Half a period of 2 to 20 s."""
    dwell_s: tuple[float, float] = (0.5, 5.0)
    dwell_chance: float = 0.4
    tension_in_N: tuple[float, float] = (2.2, 23.0)
    """T_in at both ends of the longest stroke with 30 % more friction."""


RANGE = Range()


@dataclass(frozen=True, slots=True)
class Machine:
    """What the machine is when a run begins: what a rig file may state of it."""

    lengths_m: np.ndarray
    """[p] Of the pieces of the route, proximal to distal."""
    angles_rad: np.ndarray
    """[p] Turn of each piece, 0 where it is straight."""
    friction: float
    compliance_per_N: float
    pretension_N: float
    stiffness_N_per_m: float
    """Of the spring at the load: displacement_out = (tension_out − pretension) / stiffness."""
    noise: dict[str, float]
    """Standard deviation of the readings of each channel, in its unit."""

    @property
    def length_m(self) -> float:
        """Length of the route [m]."""
        return float(self.lengths_m.sum())

    @property
    def total_angle_rad(self) -> float:
        """Total turn of the route [rad]."""
        return float(self.angles_rad.sum())

    def angle_at(self, s: np.ndarray) -> np.ndarray:
        """Return the accumulated angle at arc lengths [rad]."""
        stations = np.concatenate(([0.0], np.cumsum(self.lengths_m)))
        return np.interp(s, stations, np.concatenate(([0.0], np.cumsum(self.angles_rad))))


def machine(seed: int) -> Machine:
    """Return the machine of a seed."""
    rng = np.random.default_rng((seed, 1))
    pieces = int(rng.integers(3, 7))
    lengths = rng.uniform(0.5, 1.5, pieces)
    lengths *= rng.uniform(*RANGE.length_m) / lengths.sum()
    angles = rng.uniform(0.3, 1.5, pieces)
    angles[int(rng.integers(pieces))] = 0.0
    angles *= rng.uniform(*RANGE.total_angle_rad) / angles.sum()
    low, high = RANGE.friction
    tension, displacement = rng.uniform(*RANGE.tension_noise_N), rng.uniform(*RANGE.displacement_noise_m)
    return Machine(
        lengths_m=lengths,
        angles_rad=angles,
        friction=rng.uniform(low, min(high, RANGE.most_exponent / angles.sum())),
        compliance_per_N=rng.uniform(*RANGE.compliance_per_N),
        pretension_N=rng.uniform(*RANGE.pretension_N),
        stiffness_N_per_m=float(np.exp(rng.uniform(*np.log(RANGE.stiffness_N_per_m)))),
        noise={
            "tension_in_N": tension,
            "displacement_in_m": displacement,
            "tension_out_N": tension,
            "displacement_out_m": displacement,
        },
    )


def route(given: Machine, cells: int = CELLS, fine: tuple[float, float] | None = None) -> Path:
    """Return the route of a machine in cells that are fine at the drive, and between two arc lengths [m].

    Cells across the route have the same mean of portion of length and portion of angle. Just after the drive
    turns back only the first ones slide, so these grow from an eighth.
    """
    s = np.linspace(0.0, given.length_m, 4001)
    measure = 0.5 * s / given.length_m + 0.5 * given.angle_at(s) / given.total_angle_rad
    first = np.cumsum(1.3 ** np.arange(8) / 8.0) / cells
    even = np.linspace(first[-1], 1.0, max(round(cells * (1.0 - first[-1])), 1) + 1)
    edges = np.interp(np.concatenate(([0.0], first[:-1], even)), measure, s)
    if fine is not None:
        outside = edges[(edges < fine[0] - 1e-4) | (edges > fine[1] + 1e-4)]
        edges = np.sort(np.concatenate((outside, np.linspace(*fine, 9))))
    return from_angle(edges, given.angle_at(edges))


def motion(given: Machine, seed: int, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times [s] at 100 Hz and displacement of the drive [m]: strokes of varying depth, and dwells.

    A stroke goes from one position to another with the least jerk. It starts from the pretensioned state.
    """
    rng = np.random.default_rng((seed, 2))
    low, high = (_held_at(given, tension) for tension in (-RANGE.tension_in_N[0], RANGE.tension_in_N[1]))
    starts, spans, positions, at, upper = [], [], [0.0], 0.0, high
    while at < seconds:
        if len(spans) % 2 == 0:
            upper = low + (high - low) * rng.uniform(0.35, 1.0)
            positions.append(upper)
        else:
            positions.append(low + (upper - low) * rng.uniform(0.0, 0.8))
        starts.append(at)
        spans.append(float(np.exp(rng.uniform(*np.log(RANGE.stroke_s)))))
        dwell = rng.uniform(*RANGE.dwell_s) if rng.uniform() < RANGE.dwell_chance else 0.0
        at += spans[-1] + dwell
    times = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    now = np.searchsorted(starts, times, side="right") - 1
    part = np.clip((times - np.array(starts)[now]) / np.array(spans)[now], 0.0, 1.0)
    begin, end = np.array(positions)[now], np.array(positions)[now + 1]
    return times, begin + (end - begin) * part**3 * (10.0 - 15.0 * part + 6.0 * part**2)


def _held_at(given: Machine, tension: float) -> float:
    """Displacement at which T_in is that after a long pull, or minus that after a long release [m]."""
    exponent = np.sign(tension) * 1.3 * given.friction * given.total_angle_rad
    portion = np.linspace(0.0, 1.0, 1001)
    along = abs(tension) * np.exp(-exponent * np.interp(portion * given.length_m, *_angle_portions(given)))
    stretch = given.compliance_per_N * given.length_m * (np.trapezoid(along, portion) - given.pretension_N)
    return float((along[-1] - given.pretension_N) / given.stiffness_N_per_m + stretch)


def _angle_portions(given: Machine) -> tuple[np.ndarray, np.ndarray]:
    stations = np.concatenate(([0.0], np.cumsum(given.lengths_m)))
    return stations, given.angle_at(stations) / given.total_angle_rad
