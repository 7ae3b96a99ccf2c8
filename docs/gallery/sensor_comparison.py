"""
Which sensor for which error
============================

The same route as different sensors measure it: number of points and noise decide the error of the curve
angle. Bars are 95 % intervals of one measurement each.
"""

import matplotlib.pyplot as plt
import numpy as np

from tssgeom import analyse

SENSORS = {  # points, noise of a coordinate [mm]; typical values
    "8 EM coils, 0.5 mm": (8, 0.5),
    "24 markers, 0.5 mm": (24, 0.5),
    "24 markers, 0.1 mm": (24, 0.1),
    "100 points, 0.5 mm": (100, 0.5),
    "200 points, 0.2 mm": (200, 0.2),
}
s = np.linspace(0.0, 0.5, 2001)
phi = 2.2 * np.sin(np.pi * s / 0.5) ** 2 + 1.2 * s / 0.5  # direction of the tangent [rad]
step = s[1] * np.column_stack((np.cos(phi), np.sin(phi), 0 * s))
exact = np.cumsum(step, axis=0)
true = np.degrees(np.abs(np.diff(phi)).sum())
random = np.random.default_rng(4)
for row, (count, noise) in enumerate(SENSORS.values()):
    points = exact[np.linspace(0, 2000, count).astype(int)]
    profile = analyse(points + random.normal(0, 1e-3 * noise, points.shape)).profile
    angle, error = np.degrees([profile.total_angle, 1.96 * profile.total_angle_se])
    plt.errorbar(angle, row, xerr=error, fmt="o", capsize=4, color="C0")
plt.axvline(true, color="black", linestyle=":", label="true angle")
plt.yticks(range(len(SENSORS)), SENSORS)
plt.xlabel("curve angle Φ [°]")
plt.legend()
