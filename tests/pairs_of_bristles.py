"""Pairs of `tests/bristle` as the model takes them: their rig and their route."""

import numpy as np

from tests.bristle.chain import Bristles
from tests.bristle.machine import Pair, random_pair
from tests.bristle.sheath import Sheath
from tssgeom.mechanism import Drive, End
from tssgeom.rig import Friction, Rig, Tendon
from tssgeom.route.pieces import Arcs


def pair_that_gives(distance: float, rng: np.random.Generator) -> Pair:
    """Draw a pair whose contacts give so far before they slide [m]."""
    pair = random_pair(rng)
    pair.bristles = Bristles(breakaway_m=(distance,))
    return pair


def rig_of(pair: Pair) -> Rig:
    """Return the rig with all that is true of a pair, but what its contacts give."""
    return Rig(
        tendon=Tendon(pretension_N=pair.pretension, compliance_per_N=pair.compliance),
        friction=Friction(coefficient=pair.friction),
        drive=Drive(kind="pair", radius_m=pair.pulley),
        end=End(kind="joint", radius_m=pair.arm, stiffness_Nm_per_rad=pair.stiffness),
    )


def arcs_of(sheath: Sheath) -> Arcs:
    """Return a sheath as 60 exact pieces."""
    edge = np.linspace(0.0, sheath.length, 61)
    return Arcs.exact(np.diff(edge), np.diff(np.interp(edge, sheath.s, sheath.angle)))
