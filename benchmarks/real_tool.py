"""A cable-driven instrument of a surgical robot, with encoder and torque cell at both ends.

O'Neill, Stephens, Kowalewski, IEEE RA-L 3(4), 2018, doi 10.1109/LRA.2018.2849862; Open Database License.
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
  -14 mN·m, the zero of the cell if friction is the same both ways. The heads of the files state +9 to +11
  mN·m of mean torque instead, which does not mend it.
- A pair of equal linear cables with a fixed preload and a capstan's friction has slopes of 1/cosh(α) to 1
  both ways: one cable loses what the other gains. So either the slack cable keeps its tension while the
  load rises, or friction of the joint grows with the load; half the width of the loop is 0.28 to 0.41 of
  the joint torque on top of 40 to 47 mN·m.
- At a reversal the motor torque changes by 75 to 90 mN·m (load 20 %) to 90 to 145 mN·m (80 %) before the
  joint starts to move, at 30 to 57 mN·m a degree.
- Held-out cycles repeat the mean of fitted ones within 0.09 to 0.23 N of T_in (1 N is 10 mN·m), 0.015 to
  0.05 N of T_out and 0.07 to 0.11 degrees of the joint. The first cycle differs by the state it starts
  from.
"""

from __future__ import annotations

import gzip
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.run_laws import DATA, Case, Response
from tssgeom.arrays import Matrix, Vector

TOOL = DATA / "davinci_tool"
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
    runs = {(pitch, load): _run(pitch, load) for pitch in PITCHES for load in range(len(LOADS))}
    single = [(1, 0), (3, 3)] if quick else list(runs)
    cases = [_by_cycles(f"pitch {p}, load {LOADS[k]:.0%}", runs[p, k], p, step) for p, k in single]
    for pitch in [1] if quick else PITCHES:
        chosen = [runs[pitch, k] for k in range(len(LOADS))]
        cases.append(_by_runs(f"pitch {pitch}, load 60% held out", chosen, [2], pitch, 2 * step))
    chosen = [runs[pitch, k] for pitch in PITCHES for k in range(len(LOADS))]
    return [*cases, _by_runs("pitch 2 held out", chosen, range(4, 8), None, 4 * step)]


def _run(pitch: int, load: int) -> dict[str, Vector]:
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
