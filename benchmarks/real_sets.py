"""Runs of two robots, stretched tendons, a band round a drum and an instrument, as cases to fit.

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
- `tool_cases`: a cable-driven instrument of a surgical robot, with encoder and torque cell at both ends
  (O'Neill, Stephens, Kowalewski, IEEE RA-L 3(4), 2018, doi 10.1109/LRA.2018.2849862; Open Database License).
  Three pitches of the wrist (60, 30, 0 degrees) by four loads (20 to 80 % of the load motor's torque), six
  cycles of 0.3 Hz each. What the recordings hold:
  - The motor angle is imposed: a servo follows a sine of ±30 degrees within 0.04 s. Its own encoder, before
    the gear, agrees with the spindle's but for 1.4 % of gain and 0.5 degrees rms.
  - The load motor gets a constant current, so the joint torque has one sign and is nearly imposed: -22, -46,
    -70, -93 mN·m. The load motor's own friction and cogging add 2 to 6 mN·m against the motion, and more near
    a dip at mid-stroke of pitch 1.
  - The joint angle responds. It is 0.89 to 0.94 of the motor angle while both move and rests for 3 to 4
    degrees of motor angle at a reversal (growing with load); it yields 0.075 to 0.09 degrees per mN·m of
    load. Against the encoder's zero it depends on the pitch: 46, 66, 84 degrees at the start.
  - The motor torque responds. At mid-stroke it is -slope · joint torque + intercept: slopes 1.34 to 1.46 and
    intercepts +24 to +29 mN·m against the load, 0.65 to 0.76 and -51 to -57 mN·m with it. The product of both
    slopes is 0.95 to 1.01, as exp(α) · exp(-α) of a capstan with α = 0.28 to 0.40; half the distance of the
    intercepts, 37 to 43 mN·m, is friction of the preload, which is there without load, and their mean, -13 to
    -14 mN·m, the zero of the cell if friction is the same both ways.
  - A pair of equal linear cables with a fixed preload and a capstan's friction has slopes of 1/cosh(α) to 1
    both ways: one cable loses what the other gains. So either the slack cable keeps its tension while the
    load rises, or friction of the joint grows with the load; half the width of the loop is 0.28 to 0.41 of
    the joint torque on top of 40 to 47 mN·m.
  - At a reversal the motor torque changes by 75 to 90 mN·m (load 20 %) to 90 to 145 mN·m (80 %) before the
    joint starts to move, at 30 to 57 mN·m a degree.
  - Held-out cycles repeat the mean of fitted ones within 0.09 to 0.23 N of T_in (1 N is 10 mN·m), 0.015 to
    0.05 N of T_out and 0.07 to 0.11 degrees of the joint.
"""

from __future__ import annotations

import csv
import gzip
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.run_laws import DATA, Case, Mask, Response
from tssgeom.arrays import Matrix, Points, Vector

ROBOTS = DATA / "real" / "tdcr_tendon_tip"
STRETCH = DATA / "real" / "tendon_stretch"
BAND = DATA / "real" / "band_friction"
TOOL = DATA / "davinci_tool"

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


TORQUE = 0.000039811  # N·m for each count
BACK = 2.0 * np.pi / 8192  # rad for each count of the back-end encoder
FRONT = 2.0 * np.pi / 4000  # rad for each count of the front-end encoder
ARM = 0.01  # m; twice an assumed radius of the spindle of 5 mm: a pair of cables shares the torque
PRELOAD = 12.6  # N in each cable, and the zero of the back-end cell in N·m: what the intercepts of the
ZERO = -0.020  # straight lines of back-end over front-end torque come to, if friction is a capstan's
MEAN_OF = 25  # samples of 1 ms
PERIOD = 1.0 / 0.3  # s
LOADS = (0.2, 0.4, 0.6, 0.8)  # of the load motor's torque, by the last digit of the file's name
PITCHES = {1: 60.0, 2: 30.0, 3: 0.0}  # degrees of the wrist, by the number in the file's name
_MID = 2048  # counts; the middle of the commanded sine is 30 degrees from its start
_RESPONSES = (
    Response("tension_in_N", "motor_angle_rad", ("load_command_A",), resists=True),
    Response("tension_out_N", "motor_angle_rad", ("load_command_A",), resists=True),
    Response("joint_angle_rad", "motor_angle_rad", ("load_command_A",)),
)


def read_tool(path: Path) -> Matrix:
    """Return the columns of a file, in counts and seconds, as means of 25 samples."""
    with gzip.open(path, "rt") as stream:
        table = np.loadtxt(stream, delimiter=",", comments="%")
    rows = len(table) // MEAN_OF
    return table[: rows * MEAN_OF].reshape(rows, MEAN_OF, -1).mean(axis=1)


def tensions(back: Vector, front: Vector) -> tuple[Vector, Vector]:
    """Return proximal and distal tension of the pulling cable [N] from the torques of both cells [counts]."""
    return PRELOAD + (TORQUE * back - ZERO) / ARM, PRELOAD - TORQUE * front / ARM


def tool_file(pitch: int, load: int, source: Path = TOOL) -> Path:
    """Return the file of a pitch (1 to 3) at a load (0 to 3)."""
    return source / f"Pitch_{pitch}_00{load}.TXT.gz"


def tool_cases(*, quick: bool = False) -> list[Case]:
    """Return each run by cycles, then one load of each pitch held out, then the pitch in the middle.

    `quick` leaves one run of each kind and takes every second row.
    """
    step = 2 if quick else 1
    runs = {(pitch, load): _tool_run(pitch, load) for pitch in PITCHES for load in range(len(LOADS))}
    single = [(1, 0), (3, 3)] if quick else list(runs)
    cases = [_by_cycles(f"pitch {p}, load {LOADS[k]:.0%}", runs[p, k], p, step) for p, k in single]
    for pitch in [1] if quick else PITCHES:
        chosen = [runs[pitch, k] for k in range(len(LOADS))]
        cases.append(_by_runs(f"pitch {pitch}, load 60% held out", chosen, [2], pitch, 2 * step))
    chosen = [runs[pitch, k] for pitch in PITCHES for k in range(len(LOADS))]
    return [*cases, _by_runs("pitch 2 held out", chosen, range(4, 8), None, 4 * step)]


def _tool_run(pitch: int, load: int) -> dict[str, Vector]:
    table = read_tool(tool_file(pitch, load))
    first = read_tool(tool_file(pitch, 0))[0, 4]
    tension_in, tension_out = tensions(table[:, 2], table[:, 5])
    return {
        "time_s": table[:, 0],
        "motor_angle_rad": -BACK * (table[:, 1] - _MID),
        "motor_torque_Nm": TORQUE * table[:, 2],
        "joint_angle_rad": FRONT * (table[:, 4] - first),
        "joint_torque_Nm": TORQUE * table[:, 5],
        "load_command_A": table[:, 6],
        "tension_in_N": tension_in,
        "tension_out_N": tension_out,
    }


def _known(pitch: int | None) -> dict[str, float]:
    angle = {} if pitch is None else {"pitch_rad": float(np.radians(PITCHES[pitch]))}
    return {"arm_m": ARM, "torque_resolution_Nm": TORQUE, "angle_resolution_rad": BACK, **angle}


def _by_cycles(name: str, run: dict[str, Vector], pitch: int, step: int) -> Case:
    """Cycles 2 to 4 are fitted, 5 and 6 held out."""
    columns = {key: values[::step] for key, values in run.items()}
    cycle = columns["time_s"] / PERIOD
    fitted, held_out = (cycle >= 1.0) & (cycle < 4.0), cycle >= 4.0
    none = np.zeros(len(cycle), dtype=int)
    return Case("davinci_tool", name, columns, none, fitted, held_out, _RESPONSES, _known(pitch), PERIOD)


def _by_runs(
    name: str, runs: Sequence[dict[str, Vector]], held: Sequence[int], pitch: int | None, step: int
) -> Case:
    """Cycles 2 and 3 of all other runs are fitted, those of the runs `held` are held out."""
    used = [slice(0, int(np.searchsorted(run["time_s"], 3.0 * PERIOD)), step) for run in runs]
    columns = {
        key: np.concatenate([run[key][rows] for run, rows in zip(runs, used, strict=True)]) for key in runs[0]
    }
    number = np.repeat(np.arange(len(runs)), [len(r["time_s"][k]) for r, k in zip(runs, used, strict=True)])
    counted, away = columns["time_s"] >= PERIOD, np.isin(number, held)
    return Case(
        *("davinci_tool", name, columns, number, counted & ~away, counted & away),
        *(_RESPONSES, _known(pitch)),
    )
