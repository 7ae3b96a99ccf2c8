"""Steps of bars without effects, each with one drive; users reach the same core by `tssgeom.tendon.state`."""

import math

import numpy as np

from tssgeom.tendon.bars.bar_state import BARS, bars_with_tension
from tssgeom.tendon.bars.base import one_drive, step_on
from tssgeom.tendon.bars.contact_grid import equal_edges


def pretensioned_bars(rig, arcs, bars=BARS):
    """Return the tendon before its first pull, cut into equal bars: the rig's pretension all along."""
    edge = equal_edges(bars)
    return bars_with_tension(edge, np.full(len(edge) + 1, rig.tendon.pretension_N), 1, arcs, rig)


def step(state, arcs, rig, *, tension_in=None, displacement_in=None, stretches_with_route=True):
    """Move the drive and the route at once, with the rig's tendon, load and Coulomb friction."""
    drive, load = one_drive(tension_in, displacement_in), rig.load.stiffness_N_per_m
    return step_on(state, (arcs, arcs), rig, load, drive, stretches_with_route, math.inf)[0]
