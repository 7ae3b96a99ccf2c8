"""Runs before the first frame all code that a frame may need, so that compiled code is loaded."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from tssgeom.adapt.follower import Follower
from tssgeom.engine import process
from tssgeom.io.formats.jsonl import frame_of
from tssgeom.io.results import answers
from tssgeom.mechanism import tendon_count
from tssgeom.rig import Rig
from tssgeom.stream import Frame, FrameResult, Rejected
from tssgeom.tendon.commander import Commander
from tssgeom.tendon.machine_simulation import drive_channels
from tssgeom.tendon.machine_target import name_of, possible_outputs

_LINE = b'{"t": 0, "points": [[0, 0, 0], %s, [1, 0, 0.5]], "unit": "mm", "s": [0, 1, 2]}'
_COUNT = 60  # frames of each route; chosen: all drives and faults of `_driven` come up
_NOISE = 2e-4  # m; chosen: as of a good sensor


def warm_up(rig: Rig, commander: Commander | None = None, *, adapt: bool = False) -> None:
    """Follow pieces and a smooth route that move under load, with all that frames may bring."""
    for route in (_pieces, _spiral):
        frames = list(_frames(route))
        follower = Follower(rig) if adapt else None
        if rig.is_machine:
            frames = [_of_machine(frame, rig) for frame in frames]
        for result in process(frames, rig, tension_in=10.0, commander=commander, follower=follower):
            if isinstance(result, FrameResult):
                answers.answer(result, 0.0, 0, 0.0, 0)
                result.route.position.sum()  # written out when it is asked for
            else:
                answers.refusal(result)
    answers.refusal(Rejected(0, math.nan, "warm"))
    answers.stale(0.0, 0, 0.2, 0)
    answers.late(None, -1, 0, 0.2, 0)
    for point in (b"null", b"[0.5, null, 1]"):  # read straight from the text, and by the JSON library
        frame_of(_LINE % point, None)


def _pieces(part: np.ndarray, sway: float) -> np.ndarray:
    """Points on four bends of 0.12 m one after the other [m]."""
    kappa = sway * np.array([4.0, 25.0, 0.0, 15.0])[np.minimum((4 * part).astype(int), 3)]
    step = 0.48 / (len(part) - 1)
    turn = np.cumsum(kappa) * step
    return np.cumsum(step * np.column_stack((np.cos(turn), np.sin(turn), 0.2 * np.sin(turn))), axis=0)


def _spiral(part: np.ndarray, sway: float) -> np.ndarray:
    """Points on a curve whose curvature grows steadily, 0.5 m long [m]."""
    turn = 4.0 * sway * part**2
    step = 0.5 / (len(part) - 1)
    return np.cumsum(step * np.column_stack((np.cos(turn), np.sin(turn), 0.3 * part)), axis=0)


def _frames(route: Callable[[np.ndarray, float], np.ndarray]) -> Iterator[Frame]:
    rng = np.random.default_rng(0)
    for i in range(_COUNT):
        count = 60 + 5 * (i % 3)
        points = route(np.linspace(0.0, 1.0, count), 1.0 + 0.05 * math.sin(0.3 * i))
        points += _NOISE * rng.standard_normal(points.shape)
        yield _driven(i, points)


def _of_machine(frame: Frame, rig: Rig) -> Frame:
    """Return a frame with the drive of a machine instead of that of one tendon, and sometimes a target."""
    angle = 0.1 * math.sin(0.4 * frame.time)
    by_motor, count = rig.drive.radius_m > 0.0, tendon_count(rig.drive, rig.end)
    names = drive_channels("motor_angle_rad" if by_motor else "displacement_in", count)
    readings = dict.fromkeys(names, angle if by_motor else 0.01 * angle)
    segment = rig.end.kind == "segment"
    if frame.time > 50.0 and (by_motor or segment):
        readings |= {name_of(each, "target"): angle for each in possible_outputs(rig)[: 1 + segment]}
    return Frame(frame.points, frame.time, of_machine=readings)


def _driven(i: int, points: np.ndarray) -> Frame:
    """Return a frame with one of the drives and faults that a stream may bring."""
    if i == 20:
        points[30:34] = np.nan
    if i == 25:
        points[20] += 0.02
    if i == 30:
        points = points[::-1] * 1.5
    if i == 40:
        points = np.random.default_rng(i).permutation(points)
    tension = 8.0 + 4.0 * math.sin(0.4 * i)
    if i > 55:
        return Frame(points, float(i), displacement_target=1e-3)
    if i > 52:
        return Frame(points, float(i), displacement_in=2e-3)
    if i > 45:
        return Frame(points, float(i), tension_in=tension, tension_out_target=4.0)
    return Frame(points, float(i), tension_in=tension)
