"""Rendered scenes with known truth: lenses, blur, noise and things in the way, cast ray by ray.

Nothing here imports what it judges.
"""

from tests.scenes.boards import Board, board_images, board_poses, checkerboard, pose_of
from tests.scenes.draw import Ball, Scene, TagAt, render
from tests.scenes.lenses import Lens, ring, towards
from tests.scenes.routes import arch, loop, tag_poses

__all__ = [
    "Ball",
    "Board",
    "Lens",
    "Scene",
    "TagAt",
    "arch",
    "board_images",
    "board_poses",
    "checkerboard",
    "loop",
    "pose_of",
    "render",
    "ring",
    "tag_poses",
    "towards",
]
