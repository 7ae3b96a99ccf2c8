"""
Hysteresis: pull, release, and the dead zone between
====================================================

After each turn of the drive the friction reverses from the proximal end on. Until this slip front reaches
the distal end, the load does not follow: the dead zone.
"""

import matplotlib.pyplot as plt
import numpy as np

from tssgeom import Arcs, MovingRoute, simulate

route = Arcs.exact([0.5], [np.pi])  # a half circle of 0.5 m
time = np.linspace(0.0, 8.0, 401)
pull = np.interp(time, [0, 2, 4, 6, 8], [0, 15, 3, 15, 0])  # N
run = simulate(time, MovingRoute(np.array([0.0]), [route]), tension_in=pull)
ends = [moment.transmission for moment in run]
out = np.array([end.tension_out for end in ends])
stretch = np.array([1e3 * end.elongation for end in ends])
dead = np.array([end.dead_zone for end in ends])

figure, (force, length) = plt.subplots(1, 2, figsize=(8, 3.2))
for axes, value in ((force, out), (length, stretch)):
    axes.plot(pull, value)
    axes.plot(pull, np.where(dead, value, np.nan), linewidth=3, label="dead zone")
    axes.set_xlabel("tension at the drive, T_in [N]")
force.set_ylabel("tension at the load, T_out [N]")
length.set_ylabel("elongation δ [mm]")
force.legend()
