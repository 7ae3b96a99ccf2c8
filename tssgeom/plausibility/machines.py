"""Signs and units of the channels of a machine, which every fit takes as said."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.plausibility.kinds import Remark
from tssgeom.plausibility.limits import LIMITS
from tssgeom.plausibility.rules import remark
from tssgeom.plausibility.series import Series, correlation, filled

_MOTOR, _JOINT, _TORQUE, _LOAD = "motor_angle_rad", "joint_angle_rad", "motor_torque_Nm", "joint_torque_Nm"
_DRIVES = (_MOTOR, "displacement_in_m", "displacement_in_1_m")
_BENDS = (("bending_x_rad", "bending_y_rad"), ("tip_x_m", "tip_y_m"))
_SLOW = 0.2  # of the usual speed: slower rows have no direction [1]; chosen


def sign_remarks(run: Series) -> Iterator[Remark]:
    """Yield which channel of a joint and its motor has the sign of its opposite."""
    drive = next((name for name in _DRIVES if name in run.channels and run.moves(name)), None)
    share = _share_of_direction(run)
    inverted = share is not None and share < LIMITS.opposite
    if drive is not None and _JOINT in run.channels and run.moves(_JOINT):
        together = correlation(run.means[drive], run.means[_JOINT])
        if together < LIMITS.opposite:
            falls = f"{_JOINT} falls where {drive} rises (correlation {together:.2f})"
            if inverted and drive == _MOTOR:
                yield remark("motor_sign", "run", f"{falls}, and {_TORQUE} falls with it")
            else:
                yield remark("joint_sign", "run", falls)
            return
    if inverted:
        reads = f"{_TORQUE} is less where the motor winds than where it lets out at the same angle"
        yield remark("torque_sign", "run", reads)


def _share_of_direction(run: Series) -> float | None:
    """Return the correlation of the motor's torque with its direction, beside angle and load."""
    if not {_MOTOR, _TORQUE} <= run.channels.keys() or not run.moves(_MOTOR):
        return None
    if run.rig is not None and run.rig.end.given == "angle":
        return None  # a joint that is moved from outside may turn the motor
    rows = _rows([run], (_MOTOR, _TORQUE))
    beside = [rows[_MOTOR], *([rows[_LOAD]] if _LOAD in rows else [])]
    return _partial(rows[_TORQUE], rows["direction"], beside)


def load_sign_remarks(runs: Sequence[Series]) -> Iterator[Remark]:
    """Yield whether the motor's torque falls where the load rises, in one run or from run to run."""
    runs = [run for run in runs if {_MOTOR, _TORQUE, _LOAD} <= run.channels.keys()]
    if not runs:
        return
    rows = _rows(runs, (_MOTOR, _TORQUE, _LOAD))
    together = _partial(rows[_TORQUE], rows[_LOAD], [rows[_MOTOR], rows["direction"]])
    if together < LIMITS.opposite:
        over = f" over {len(runs)} runs" if len(runs) > 1 else ""
        yield remark("load_sign", "run", f"{_TORQUE} falls where {_LOAD} rises{over} ({together:.2f})")


def angle_remarks(run: Series) -> Iterator[Remark]:
    """Yield whether the angle of a joint can hardly be in radians."""
    if _JOINT not in run.channels or not run.moves(_JOINT):
        return
    span = run.span(_JOINT)
    if not LIMITS.least_turn_rad <= span <= 2.0 * math.pi:
        yield remark("joint_unit", "run", f"{_JOINT} moves by {span:.3g} rad")


def direction_remarks(run: Series) -> Iterator[Remark]:
    """Yield whether a segment bends to another side than its tendons, by the angles of the rig, pull it."""
    angles = np.radians(run.rig.end.tendon_angles_deg if run.rig is not None else ())
    pulls = _pulls(run, len(angles))
    bends = next((pair for pair in _BENDS if set(pair) <= run.channels.keys()), None)
    if pulls is None or bends is None:
        return
    bend = np.column_stack([run.means[name] for name in bends])
    there = np.isfinite(pulls).all(axis=1) & np.isfinite(bend).all(axis=1)
    if there.sum() < LIMITS.fewest_rows:
        return
    pulls, bend = (each[there] - each[there].mean(axis=0) for each in (pulls, bend))
    slopes = np.linalg.lstsq(pulls, bend, rcond=None)[0]
    size = float(np.linalg.norm(bend))
    explained = float(np.linalg.norm(pulls @ slopes)) / size if size > 0.0 else 0.0
    wanted = pulls @ np.column_stack((np.cos(angles), np.sin(angles)))
    along = float((wanted * bend).sum()) / (size * float(np.linalg.norm(wanted)) or 1.0)
    if explained > LIMITS.explained and along < LIMITS.along * explained:
        measured = ", ".join(
            f"{round(each) % 360}" for each in np.degrees(np.arctan2(slopes[:, 1], slopes[:, 0]))
        )
        listed = ", ".join(f"{each:g}" for each in np.degrees(angles))
        yield remark(
            "tendon_directions", "run", f"the tendons bend it towards {measured}°, and the rig has {listed}°"
        )


def _pulls(run: Series, count: int) -> Matrix | None:
    """Return what pulls each of so many tendons, [rows, count]; None where a run does not state it."""
    for name in ("displacement_in_{}_m", "tension_in_{}_N"):
        names = [name.format(which + 1) for which in range(count)]
        if names and set(names) <= run.channels.keys():
            return np.column_stack([run.means[each] for each in names])
    return None


def _rows(runs: Sequence[Series], names: Sequence[str]) -> Mapping[str, Vector]:
    """Return rows of all runs where the motor has a direction and every name a reading."""
    rows = dict[str, list[Vector]]()
    names = (
        *names,
        *([_LOAD] if _LOAD not in names and all(_LOAD in each.channels for each in runs) else ()),
    )
    for run in runs:
        speed = np.gradient(filled(run.means[_MOTOR])) if len(run.time) > 1 else np.zeros(len(run.time))
        usual = float(np.quantile(np.abs(speed), 0.9))
        moves = (np.abs(speed) > _SLOW * usual) & (usual > 0.0)
        used = np.all([moves, *(np.isfinite(run.means[each]) for each in names)], axis=0)
        rows.setdefault("direction", []).append(np.sign(speed[used]))
        for each in names:
            rows.setdefault(each, []).append(run.means[each][used])
    return {name: np.concatenate(values) for name, values in rows.items()}


def _partial(one: Vector, other: Vector, beside: Sequence[Vector]) -> float:
    """Return the correlation of two columns in what a constant and those beside leave of them."""
    if len(one) < LIMITS.fewest_rows:
        return 0.0
    basis = np.column_stack((np.ones(len(one)), *beside))
    left = [values - basis @ np.linalg.lstsq(basis, values, rcond=None)[0] for values in (one, other)]
    return correlation(*left)
