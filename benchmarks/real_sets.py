"""Runs of two continuum robots, of stretched tendons and of a band round a drum, as cases to fit.

- `robot_cases`: ContinuumRoboticsLab/opencr-mujoco, two robots of three segments with nine tendons. Servos
  state displacements, cameras the tip; tensions are not known. A segment alone is one case, with every
  other direction held out; displacement and angle count from the first row of each direction. A label
  changes before the pattern before has ended, so rows with a displaced proximal tendon are left out. Below
  zero a tendon is slack and the tip rests. Robot v6 states its displacements about 0.2 s late; its third
  segment does not fit its stated lengths.
- `stretch_cases`: c3polab/tendon-characterization, elastomer tendons between two clamps. Nothing slides:
  what differs between stretching and releasing is relaxation at constant length. Force and length were
  recorded by two programs without a common clock.
- `band_cases`: ARTS-Laboratory/Dataset-Friction-Damper-with-Backlash (CC BY-SA 4.0), a band that is pulled
  to and fro round a drum. The linkage has clearance: force is about zero over a few millimetres of every
  reversal. The slack end reads below zero, which no band carries, so the zero of its cell is not known.
"""

from __future__ import annotations

import csv
import gzip
import json
from dataclasses import dataclass

import numpy as np

from benchmarks.run_laws import DATA, Case, Mask, Response
from tssgeom.arrays import Matrix, Points, Vector

ROBOTS = DATA / "real" / "tdcr_tendon_tip"
STRETCH = DATA / "real" / "tendon_stretch"
BAND = DATA / "real" / "band_friction"

RADIUS = 4.5e-3  # m; from the backbone to each tendon of the robots
_MARKER = 8e-3  # m; beyond the tip
_PROXIMAL = 0.3e-3  # m; a proximal tendon beyond it bends another segment
_NEUTRAL = 0.5e-3  # m
_AROUND = np.radians([0.0, 120.0, 240.0])  # the three tendons of a segment
_ROBOTS = {
    "v4": ("tdcr_sysid_20260511-183002_keypoints.csv", (0.060, 0.0625, 0.064)),
    "v6": ("tdcrv6_sysid_20260406-181730_keypoints.csv", (0.100, 0.100, 0.022)),
}
_SPECIMENS = ("filament5", "sc11", "sc21", "ss21")
_JUMP = 2.0  # cm beyond any plateau; a jump of the tracker
_INCH, _POUND = 0.0254, 4.4482216  # m, N
_BAND = {"0.5Hz22lb": 2.0, "0.5Hz35lb": 2.0, "0.5Hz80lb": 2.0, "1Hz35lb": 1.0}  # s a cycle
_FULL_STROKE = 1.95 * _INCH  # m peak to peak; smaller cycles are run-up and run-down


@dataclass(frozen=True, slots=True)
class Robot:
    """Recording of one robot; n rows."""

    lengths: tuple[float, ...]
    """Of each segment [m]."""
    time: Vector
    """[s]"""
    labels: np.ndarray
    pulled: Matrix
    """[n, 9] Displacement of each tendon [m]."""
    tip: Points
    """[n, 3] [m]"""


def read_robot(name: str) -> Robot:
    """Read robot `v4` or `v6`."""
    file, lengths = _ROBOTS[name]
    with (ROBOTS / file).open(newline="", encoding="utf-8") as stream:
        _, *lines = csv.reader(stream)
    labels = np.array([line[1] for line in lines])
    table = np.array([[line[0], *line[2:]] for line in lines], dtype=float)
    return Robot(lengths, table[:, 0] - table[0, 0], labels, 1e-3 * table[:, 1:10], 1e-3 * table[:, 10:])


def robot_cases(*, quick: bool = False) -> list[Case]:
    """Return each segment of both robots alone; `quick` leaves the first robot's first and third."""
    robots = {name: read_robot(name) for name in (["v4"] if quick else _ROBOTS)}
    return [
        _segment(name, robot, k) for name, robot in robots.items() for k in ([1, 3] if quick else [1, 2, 3])
    ]


def _segment(name: str, robot: Robot, segment: int) -> Case:
    single = np.char.find(robot.labels, "_pull") >= 0
    neutral = robot.tip[(np.abs(robot.pulled) < _NEUTRAL).all(axis=1) & ~single].mean(axis=0)
    alone = (np.abs(robot.pulled[:, : 3 * (segment - 1)]) <= _PROXIMAL).all(axis=1)
    parts = list[dict[str, Vector]]()
    for label in dict.fromkeys(robot.labels):
        if label.startswith(f"rep1_seg{segment}_dir") and not label.endswith("hold"):
            parts.append(_direction(robot, segment, alone & (robot.labels == label), neutral))
    run = np.repeat(np.arange(len(parts)), [len(part["time_s"]) for part in parts])
    columns = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    response = Response("bending_angle_rad", "displacement_in_m", zeroed=True)
    known = {"radius_m": RADIUS, "length_m": robot.lengths[segment - 1], "marker_m": _MARKER}
    even = run % 2 == 0
    name = f"{name} segment {segment}"
    return Case("tdcr_tendon_tip", name, columns, run, even, ~even, (response,), known)


def _direction(robot: Robot, segment: int, rows: Mask, neutral: Vector) -> dict[str, Vector]:
    """Return the displacement in the plane of bending and the angle, both from the first row."""
    pulled = robot.pulled[rows]
    three = pulled[:, 3 * (segment - 1) : 3 * segment]
    along = _along_farthest(2.0 / 3.0 * three @ np.column_stack([np.cos(_AROUND), np.sin(_AROUND)]))
    lateral = _along_farthest(robot.tip[rows, :2] - neutral[:2])
    length, beyond = robot.lengths[segment - 1], sum(robot.lengths[segment:]) + _MARKER
    height = robot.tip[rows, 2] - sum(robot.lengths[: segment - 1])
    angle = bending_angle(lateral, height, length, beyond)
    given = {f"displacement_in_{k}_m": column for k, column in enumerate(pulled.T, start=1)}
    tip = {f"tip_{axis}_m": robot.tip[rows, k] for k, axis in enumerate("xyz")}
    projected = {"displacement_in_m": along - along[0], "bending_angle_rad": angle - angle[0]}
    return {"time_s": robot.time[rows], **given, **tip, **projected}


def _along_farthest(vectors: Matrix) -> Vector:
    """Project [n, 2] on the direction of the longest one."""
    farthest = vectors[np.argmax(np.hypot(*vectors.T))]
    return vectors @ farthest / np.hypot(*farthest)


def bending_angle(lateral: Vector, height: Vector, length: float, beyond: float) -> Vector:
    """Return the angle of an arc, with a straight rest, whose end lies in the sensed direction [rad].

    `lateral` and `height` [m] count from where the arc begins; `length` and `beyond` [m] are those of the arc
    and of the rest.
    """
    angle = np.linspace(-2.4, 2.4, 4800)  # an even count leaves zero out
    across = length * (1.0 - np.cos(angle)) / angle + beyond * np.sin(angle)
    up = length * np.sin(angle) / angle + beyond * np.cos(angle)
    return np.interp(np.arctan2(lateral, height), np.arctan2(across, up), angle)


def servo_lag(robot: Robot, lags: Vector) -> Vector:
    """Return the rms of the tip about a curve over displacement [m], with the servos read `lags` later [s].

    The curve is a quadratic in each pull of a single tendon, where it is taut.
    """
    labels = [label for label in dict.fromkeys(robot.labels) if str(label).endswith("_pull")]
    left = np.zeros((len(lags), 0))
    for label in labels:
        tendon = int(label.split("tendon")[1].split("_")[0])
        taut = (robot.labels == label) & (robot.pulled[:, tendon] > _PROXIMAL)
        tip, time = robot.tip[taut], robot.time[taut]
        errors = list[Vector]()
        for lag in lags:
            powers = np.vander(np.interp(time + lag, robot.time, 1e3 * robot.pulled[:, tendon]), 3)
            rest = tip - powers @ np.linalg.lstsq(powers, tip, rcond=None)[0]
            errors.append(np.linalg.norm(rest, axis=1))
        left = np.column_stack([left, errors])
    return np.sqrt(np.mean(np.square(left), axis=1))


def stretch_cases(*, quick: bool = False) -> list[Case]:
    """Return the plateaus and the whole recording of each specimen; the second half is held out."""
    names = _SPECIMENS[:2] if quick else _SPECIMENS
    return [make(name) for make in (_plateaus, _recording) for name in names]


def _stretch(name: str, time: Vector, length: Vector, force: Vector, half: int) -> Case:
    first = np.arange(len(force)) < half
    columns = {"time_s": time, "length_m": length, "force_N": force}
    response = Response("force_N", "length_m")
    return Case("tendon_stretch", name, columns, np.zeros(len(force), int), first, ~first, (response,))


def _plateaus(name: str) -> Case:
    force, length = _plateau_table(name)
    time = 45.0 * np.arange(1.0, len(force) + 1)
    return _stretch(f"{name} plateaus", time, 1e-2 * length, force, len(force) // 2 + 1)


def _plateau_table(name: str) -> Matrix:
    """Return forces [N] and lengths [cm] at the ends of the plateaus."""
    return np.loadtxt(STRETCH / f"{name}_plats.csv", delimiter=",", skiprows=1).T


def _recording(name: str) -> Case:
    """Force at 1 Hz with the length on its clock, shifted to where their steps agree best."""
    _, force, time = np.loadtxt(STRETCH / f"{name}_force.csv", delimiter=",", skiprows=1).T
    length = without_jumps(np.loadtxt(STRETCH / f"{name}_length.csv"), _plateau_table(name)[1])
    force, length = np.sign(force[np.argmax(np.abs(force))]) * force, _resampled(length, len(force))
    shifts = range(-60, 61)
    moved = [np.interp(np.arange(len(force)) - shift, np.arange(len(force)), length) for shift in shifts]
    agree = [_coincidence(force, one) for one in moved]
    best = moved[int(np.argmax(agree))]
    rows = len(force) // 10
    tenths = [one[: 10 * rows].reshape(rows, 10).mean(axis=1) for one in (time, best, force)]
    return _stretch(f"{name} recording", tenths[0], 1e-2 * tenths[1], tenths[2], rows // 2)


def without_jumps(length: Vector, plateaus: Vector) -> Vector:
    """Return lengths with those far beyond any plateau, where the tracker jumped, interpolated; both [cm]."""
    sound = (length > plateaus.min() - _JUMP) & (length < plateaus.max() + _JUMP)
    rows = np.arange(len(length))
    return np.interp(rows, rows[sound], length[sound])


def _resampled(values: Vector, count: int) -> Vector:
    return np.interp(np.linspace(0.0, 1.0, count), np.linspace(0.0, 1.0, len(values)), values)


def _coincidence(force: Vector, length: Vector) -> float:
    """Return the correlation of both changes over 2 s."""
    pulled, stretched = (one[20:] - one[:-20] for one in (force, length))
    return float(pulled @ stretched / (np.linalg.norm(pulled) * np.linalg.norm(stretched)))


def band_cases(*, quick: bool = False) -> list[Case]:
    """Return the three full cycles of each file: two fitted, the third held out."""
    names = list(_BAND)[:2] if quick else list(_BAND)
    return [_band(name, 16 if quick else 8) for name in names]


def _band(name: str, mean_of: int) -> Case:
    period = _BAND[name]
    with gzip.open(BAND / f"{name}tension.json.gz", "rt") as stream:
        table = np.array(json.load(stream)["data"])
    per_cycle = int(period * 1024)
    start = _first_full_cycle(_INCH * table[:, 1], per_cycle)
    rows = 3 * per_cycle // mean_of
    part = table[start : start + rows * mean_of].reshape(rows, mean_of, -1).mean(axis=1)
    columns = {
        "time_s": part[:, 0],
        "displacement_in_m": _INCH * part[:, 1],
        "friction_force_N": 1e3 * _POUND * part[:, 2],
        "force_1_N": _POUND * part[:, 4],
        "force_2_N": _POUND * part[:, 5],
    }
    fitted = np.arange(rows) < 2 * per_cycle // mean_of
    responses = tuple(
        Response(column, "displacement_in_m", resists=True, zeroed=column == "friction_force_N")
        for column in ("friction_force_N", "force_1_N", "force_2_N")
    )
    run = np.zeros(rows, dtype=int)
    return Case("band_friction", name, columns, run, fitted, ~fitted, responses, period=period)


def _first_full_cycle(displacement: Vector, per_cycle: int) -> int:
    """Return the row where the first cycle of full stroke rises through the middle of its stroke."""
    cycles = np.lib.stride_tricks.sliding_window_view(displacement, per_cycle)
    stroke: Vector = np.max(cycles, axis=1) - np.min(cycles, axis=1)
    middle = 0.5 * (displacement.max() + displacement.min())
    rising = (displacement[:-1] < middle) & (displacement[1:] >= middle)
    return int(np.flatnonzero(rising[: len(stroke)] & (stroke[: len(rising)] > _FULL_STROKE))[0]) + 1
