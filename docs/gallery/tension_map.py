"""
Tension along the route
=======================

The tension falls where the sheath bends, and stays where it is straight. Colours are those of the viewer:
viridis.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection

import tssgeom

result = tssgeom.analyse(Path("../../sample_shapes/colon_fibre.csv"), tension_in=15.0)
profile = result.profile
tension = tssgeom.tension(result.state, profile.phi)  # [N] at each node

figure, (route, along) = plt.subplots(1, 2, figsize=(8, 3.4))
plane = 1e3 * result.route.position[:, :2]
lines = LineCollection(np.stack((plane[:-1], plane[1:]), 1), array=tension[:-1], linewidth=4)
route.add_collection(lines)
route.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
route.autoscale()
figure.colorbar(lines, ax=route, label="tension [N]")
along.plot(1e3 * profile.s, tension)
bends = along.twinx()
bends.fill_between(1e3 * profile.s, profile.kappa, alpha=0.2, color="0.4")
bends.set_ylabel("curvature [1/m]", color="0.4")
along.set(xlabel="arc length [mm]", ylabel="tension [N]", ylim=(0, None))
