"""What several tendons are driven by and what they move: a motor's pulley, a joint, a bending segment."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

Course = tuple[np.ndarray, np.ndarray]
"""Times [s] and values, linear between."""


@dataclass(frozen=True, slots=True)
class Motor:
    """One pulley that pulls tendon 1 in as it turns, and lets tendon 2 out, where there is one."""

    kind: Literal["angle", "torque"]
    times: np.ndarray
    """[D] s, increasing."""
    values: np.ndarray
    """[D] rad, or N·m from rest: radius · (change of T_in,1 − coupling · change of T_in,2)."""
    radius_m: float
    coupling: float = 1.0
    """Tendon 2 is let out by coupling · radius · angle [1]."""
    play_rad: float = 0.0
    """Lost motion between motor and pulley when it turns back; it starts engaged for pulling tendon 1."""
    temperature_C: np.ndarray | None = None
    """[D] °C; none is 20 °C throughout."""

    def arms(self, tendons: int) -> np.ndarray:
        """[n] How far each tendon is pulled in per angle of the pulley [m]."""
        if tendons > 2:
            raise ValueError(f"{tendons} tendons on one pulley: give one or two")
        return np.array([self.radius_m, -self.coupling * self.radius_m])[:tendons]


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint of angle θ without mass, which tendon 1 turns to θ > 0 and tendon 2 to θ < 0.

    In balance radius · (change of T_out,1 − change of T_out,2) is
    stiffness · θ + hardening · θ³ + spring(θ)
    + gravity · (sin(θ + gravity angle) − sin(gravity angle)) + load.
    """

    radius_m: float
    stiffness_Nm_per_rad: float = 0.0
    gravity_Nm: float = 0.0
    """Weight times its distance from the axis; below 0 it stands on its head."""
    gravity_angle_rad: float = 0.0
    """Angle from the plumb line at θ = 0."""
    hardening_Nm_per_rad3: float = 0.0
    """Torque over the cube of θ, beside the spring's."""
    spring: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None
    """Torque of another spring at θ, none at 0, and its slope >= 0."""
    load: Course | None = None
    """Torque against θ > 0, from rest [N·m]."""
    angle: Course | None = None
    """θ where it is imposed [rad]; the torque that this takes is an outcome."""

    def arms(self, tendons: int) -> np.ndarray:
        """[n, 1] How far the far end of each tendon moves towards its drive per angle [m]."""
        if tendons > 2:
            raise ValueError(f"{tendons} tendons on one joint: give one or two")
        return np.array([[self.radius_m], [-self.radius_m]])[:tendons]

    def torque(self, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Torque that holds the joint at θ [1] without a load; its slope [1, 1], never below the spring's."""
        turned = at + self.gravity_angle_rad
        weight = self.gravity_Nm * (np.sin(turned) - np.sin(self.gravity_angle_rad))
        slope = self.stiffness_Nm_per_rad + np.maximum(self.gravity_Nm * np.cos(turned), 0.0)
        slope = slope + 3.0 * self.hardening_Nm_per_rad3 * at**2
        torque = self.stiffness_Nm_per_rad * at + self.hardening_Nm_per_rad3 * at**3 + weight
        if self.spring is not None:
            more, steeper = self.spring(at)
            torque, slope = torque + more, slope + steeper
        return torque, slope[:, None]


@dataclass(frozen=True, slots=True)
class Segment:
    """A backbone that n tendons round it bend to an arc; bending (b_x, b_y) [rad] goes to the pulled side.

    In balance Σ distance · (cos α, sin α) · change of T_out is stiffness · (b_x, b_y).
    """

    distance_m: float
    """Of the tendons from the backbone."""
    angles_rad: tuple[float, ...]
    """[n] α of each tendon round the backbone, from x towards y."""
    stiffness_Nm_per_rad: float
    length_m: float = 0.1
    marker_m: float = 0.0
    """How far beyond the tip, straight on, its position is measured."""

    def arms(self, tendons: int) -> np.ndarray:
        """[n, 2] How far the far end of each tendon moves towards its drive per bending [m]."""
        if tendons != len(self.angles_rad):
            raise ValueError(f"{tendons} tendons, {len(self.angles_rad)} angles round the backbone")
        angles = np.array(self.angles_rad)
        return self.distance_m * np.stack([np.cos(angles), np.sin(angles)], axis=1)

    def torque(self, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Bending moment [2] that holds the bending `at` [2]; its slope [2, 2]."""
        return self.stiffness_Nm_per_rad * at, self.stiffness_Nm_per_rad * np.eye(2)

    def tip(self, bending: np.ndarray) -> np.ndarray:
        """[F, 3] Position of the marker [m] for bending [F, 2]; straight, it is on z."""
        total = np.linalg.norm(bending, axis=1)
        way = bending / np.maximum(total, 1e-300)[:, None]
        half = 0.5 * total
        chord = self.length_m * np.sinc(half / np.pi)
        across = chord * np.sin(half) + self.marker_m * np.sin(total)
        along = chord * np.cos(half) + self.marker_m * np.cos(total)
        return np.concatenate([across[:, None] * way, along[:, None]], axis=1)
