"""An independent lumped simulator of a tendon in a sheath."""

from tests.lumped.physics import Distal, Drive, Physics
from tests.lumped.route import Path, from_angle, from_pieces, from_points
from tests.lumped.simulate import NoBalanceError, Run, simulate

__all__ = [
    "Distal",
    "Drive",
    "NoBalanceError",
    "Path",
    "Physics",
    "Run",
    "from_angle",
    "from_pieces",
    "from_points",
    "simulate",
]
