"""
How much of the angle is in short waves
=======================================

A centre line from a scan winds through the voxels of its image, which adds bends that the sheath does not
have. Φ over the shortest wave that counts has a plateau at the true angle.
"""

import matplotlib.pyplot as plt
import numpy as np

from tssgeom import analyse
from tssgeom.route.resolution import angle_over_resolution

s = np.linspace(0.0, 0.5, 150)
exact = np.column_stack((np.sin(2 * np.pi * s), 1 - np.cos(2 * np.pi * s), 0 * s)) / (
    2 * np.pi
)  # half circle
waves = 4e-4 * np.column_stack((0 * s, np.sin(2 * np.pi * s / 0.025), np.cos(2 * np.pi * s / 0.03)))
length = np.geomspace(0.004, 0.2, 80)  # m
for name, points in (("exact route", exact), ("route that winds by 0.4 mm", exact + waves)):
    fit = analyse(points + np.random.default_rng(0).normal(0, 2e-5, points.shape)).fit
    plt.semilogx(1e3 * length, np.degrees(angle_over_resolution(fit, length)), label=name)
plt.axhline(180, color="black", linestyle=":", label="true angle")
plt.xticks([5, 10, 20, 50, 100, 200], ["5", "10", "20", "50", "100", "200"])
plt.xlabel("shortest wave that counts [mm]")
plt.ylabel("curve angle Φ [°]")
plt.legend()
