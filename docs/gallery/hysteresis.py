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

figure, (force, length) = plt.subplots(1, 2, figsize=(8, 3.2), layout="constrained")
run.plot(force, "transmission")
run.plot(length, "elongation_loop")
