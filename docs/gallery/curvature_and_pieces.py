"""
Curvature with its band, and constant-curvature pieces
======================================================

Setup A of the paper is a half circle and then a loop, here as 200 points with 0.2 mm of noise. Two arcs
explain the points, so the route becomes two pieces.
"""

from itertools import pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import tssgeom

result = tssgeom.analyse(Path("../../sample_shapes/setup_a.csv"))
profile, arcs = result.profile, result.arcs
figure, (curvature, route) = plt.subplots(1, 2, figsize=(8, 3.2))
s = 1e3 * profile.s
band = 1.96 * profile.kappa_se
curvature.fill_between(s, profile.kappa - band, profile.kappa + band, alpha=0.35, label="95 % interval")
curvature.plot(s, profile.kappa, label="curvature κ")
joints = 1e3 * np.append(arcs.s_start, arcs.total_length)
curvature.stairs(arcs.kappa, joints, color="black", linestyle=":", label="pieces")
curvature.set(xlabel="arc length [mm]", ylabel="curvature [1/m]")
curvature.legend(loc="upper left")

for k, (first, last) in enumerate(pairwise(joints)):
    inside = (s >= first) & (s <= last)
    label = f"piece {k + 1}: {np.degrees(arcs.angle[k]):.1f} ± {np.degrees(arcs.angle_se[k]):.1f}°"
    route.plot(*(1e3 * result.route.position[inside, :2].T), linewidth=3, label=label)
route.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
route.margins(y=0.3)
route.legend(loc="upper right", fontsize="small")
