"""Rigs by chance, and one run of a rig: what truly happens, without sensors."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from tests.bristle.chain import Bristles, Build, Chain, Numerics, Table, linear
from tests.bristle.laws import Acts, play
from tests.bristle.sheath import Sheath

Array = np.ndarray


class Stride(NamedTuple):
    """Longest parts in which a drive is followed."""

    time_s: float = 0.02
    """(measured: half of it changes no channel by more than its test states)"""
    move_m: float = 1e-4
    """(measured, as above)"""
    tension_N: float = 0.25
    """(measured, as above)"""


STRIDE = Stride()
STRIDE_OVER_SPEED = Stride(0.005, 2.5e-5, 0.06)
"""Where friction follows speed, of the step before (measured, as above; with four times: 0.1 N at turns)."""


def stride(acts: Acts) -> Stride:
    """Return the longest parts for some laws."""
    return STRIDE if acts.over_speed is None else STRIDE_OVER_SPEED


@dataclass(slots=True)
class Rig:
    """A true rig; every number that a cause changes can be changed here."""

    friction: float
    compliance: float
    """Strain for tension [1/N]."""
    pretension: float
    """[N]"""
    stiffness: float
    """Of the load [N/m]."""
    sheaths: list[Sheath]
    """True routes."""
    drive: str = "position"
    strain: Table | None = None
    """Strain law, where it is no constant compliance."""
    load: Table | None = None
    """Force over movement, where it is no spring."""
    pull: Table | None = None
    """Force over stretch between drive and tendon."""
    near_friction: float = 0.0
    load_friction: float = 0.0
    cell_at_tendon: bool = False
    """Whether the distal cell stands before the friction of the load, not behind it."""
    drive_play: float = 0.0
    """Between drive and tendon [m]."""
    drive_play_open: float = 0.0
    """Of it, what is to be taken up when a run begins [m]."""
    bristles: Bristles = field(default_factory=Bristles)
    numerics: Numerics = field(default_factory=Numerics)

    def build(self, sheath: Sheath) -> Build:
        """Return what a chain of one tendon is made of."""
        rest = Table(np.array([0.0, 1.0]), self.pretension + np.array([0.0, self.stiffness]))
        return Build(
            sheaths=[sheath],
            friction=self.friction,
            strain=self.strain or linear(self.compliance),
            pretension=self.pretension,
            load=self.load or rest,
            bristles=self.bristles,
            near_friction=self.near_friction,
            load_friction=self.load_friction,
            pull=self.pull,
            drive=self.drive,
            numerics=self.numerics,
        )

    def reach(self, sheath: Sheath, tension_out: float, *, pulled: bool) -> float:
        """Return the drive [m or N] at a load of `tension_out` [N] when all of the tendon slides."""
        sign = 1.0 if pulled else -1.0
        left = sheath.total_angle - sheath.angle
        tension = tension_out * np.exp(sign * self.friction * left)
        if self.drive == "force":
            return float(tension[0])
        stretch = self.compliance * np.trapezoid(tension - self.pretension, sheath.s)
        return float((tension_out - self.pretension) / self.stiffness + stretch)


def run(rig: Rig, sheath: Sheath, time: Array, drive: Array, acts: Acts) -> dict[str, Array]:
    """Follow a drive.

    Parameters
    ----------
    rig, sheath
        What is driven.
    time, drive
        [n] times [s] and the drive then [m or N], straight between.
    acts
        Laws; fresh ones, since they keep their state.

    Returns
    -------
    True courses [n] of `tension_in`, `tension_out` [N], `displacement_in`, `displacement_out`, `elongation`
    [m], and of the reach of laws: `slide_speed` [m/s], `slide_travel` [m], `tension_low`, `tension_high` [N].
    """
    chain = Chain(rig.build(sheath))
    moved = drive
    if rig.drive == "position":
        moved = play(np.append(0.0, drive), rig.drive_play, rig.drive_play_open)[1:] - rig.drive_play_open
    rows = list[tuple[float, ...]]()
    longest = stride(acts)
    most = longest.move_m if rig.drive == "position" else longest.tension_N
    old, then = (0.0 if rig.drive == "position" else rig.pretension), 2.0 * time[0] - time[1]
    for now, goal in zip(time, moved, strict=True):
        parts = int(np.ceil(max((now - then) / longest.time_s, abs(goal - old) / most, 1.0)))
        dt = (now - then) / parts
        for k in range(parts):
            chain.advance(old + (goal - old) * (k + 1) / parts, dt, renew=acts.renew)
            acts.commit(chain, dt)
        old, then = goal, now
        rows.append(
            (
                chain.tension_in,
                chain.load_tensions[0] if rig.cell_at_tendon else chain.load_force,
                chain.drive_move,
                chain.load_move,
                float(np.max(np.abs(chain.slip_rate))),
                float(np.max(chain.travel)),
                float(np.min(chain.tension)),
                float(np.max(chain.tension)),
            )
        )
    names = ("tension_in", "tension_out", "displacement_in", "displacement_out")
    reach = ("slide_speed", "slide_travel", "tension_low", "tension_high")
    true: dict[str, Array] = dict(zip((*names, *reach), np.array(rows).T, strict=True))
    true["elongation"] = true["displacement_in"] - true["displacement_out"]
    if rig.drive_play:  # the sensor is at the drive, before the play
        true["displacement_in"] = drive
        true["elongation"] = drive - true["displacement_out"]
    return true
