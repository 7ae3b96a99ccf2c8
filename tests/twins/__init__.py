"""Machines that run for hours, drift and break, for what follows and watches them while they run.

    from tests.twins import acts_s, frames, kinked_sheath

    scenario = kinked_sheath(seed=3, hours=0.5)
    for frame in frames(scenario, every=10):   # tssgeom.Frame, one by one
        ...
    scenario.truth["friction"], scenario.begins_s, acts_s(scenario)

Physics come from the lumped simulator, which shares nothing with `tssgeom`; `frames` alone knows both. A seed
chooses machine, motion, sensors, drifts, and when a fault begins and where it is. All faults of a seed begin
at the same time in the same motion, and a longer run begins as a shorter one does (but for its fault).

Against 600 cells, over 120 s of seeds 0 to 3 with friction 25 % above nominal, the cells of the route make
T_in wrong by 1 to 5 mN rms and by 7 to 20 mN just after the drive turns back, T_out by 2 mN and the load by
0.9 µm at most. The noise of one reading is 20 to 50 mN and 5 to 20 µm. The polygon holds θ²/12 more than a
curve at vertices of turn θ: 0.05 % of the friction on 7 rad. An hour takes 15 s of one core and 140 MB.
"""

from tests.twins.frames import frames, route_points
from tests.twins.machine import Machine, machine
from tests.twins.scenarios import (
    CHANNELS,
    DRIFTS,
    FAULTS,
    Scenario,
    acts_s,
    drifting,
    drifting_friction,
    drifting_zeros,
    frayed_tendon,
    growing_play,
    kinked_sheath,
    sound,
    unplugged,
    wet_sheath,
    wrong_shape,
)

__all__ = [
    "CHANNELS",
    "DRIFTS",
    "FAULTS",
    "Machine",
    "Scenario",
    "acts_s",
    "drifting",
    "drifting_friction",
    "drifting_zeros",
    "frames",
    "frayed_tendon",
    "growing_play",
    "kinked_sheath",
    "machine",
    "route_points",
    "sound",
    "unplugged",
    "wet_sheath",
    "wrong_shape",
]
