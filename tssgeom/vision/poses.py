"""Poses as rotation vectors and shifts: one after the other, backwards, and from a detected board."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from tssgeom.arrays import Matrix, Vector


class Pose(NamedTuple):
    """From one frame into another: x' = R(turn) x + shift."""

    turn: Vector
    """Rotation vector [3] [rad]."""
    shift: Vector
    """[3] [m]."""

    @property
    def rotation(self) -> Matrix:
        """[3, 3]."""
        return np.asarray(cv2.Rodrigues(self.turn)[0], dtype=np.float64)


def pose_of(turn: object, shift: object) -> Pose:
    """Return a pose from what OpenCV gives."""
    return Pose(np.asarray(turn, dtype=np.float64).ravel(), np.asarray(shift, dtype=np.float64).ravel())


STILL = Pose(np.zeros(3), np.zeros(3))


def after(first: Pose, second: Pose) -> Pose:
    """Return the pose of going through `first`, then `second`."""
    turn, shift = cv2.composeRT(first.turn, first.shift, second.turn, second.shift)[:2]
    return pose_of(turn, shift)


def backwards(pose: Pose) -> Pose:
    """Return the pose that undoes another."""
    return Pose(-pose.turn, -pose.rotation.T @ pose.shift)
