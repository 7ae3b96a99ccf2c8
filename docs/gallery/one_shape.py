"""
One shape, with its error bar
=============================

A shape-sensing fibre measures a colon-like route of 1.3 m. The curve angle grows along it; its standard
error grows too.
"""

# sphinx_gallery_thumbnail_number = 1
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import tssgeom

SAMPLES = Path("../../sample_shapes")  # `tssgeom samples --out FOLDER` writes them anywhere

result = tssgeom.analyse(SAMPLES / "colon_fibre.csv", tension_in=15.0)
profile, position = result.profile, 1e3 * result.route.position
figure = plt.figure(figsize=(8, 3.6))
route = figure.add_subplot(1, 2, 1, projection="3d")
route.plot(*(1e3 * result.frame.points.T), ".", markersize=2, color="0.6")
route.plot(*position.T)
route.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]", aspect="equal")
route.locator_params(nbins=4)
angle = figure.add_subplot(1, 2, 2)
phi, band = np.degrees(profile.phi), np.degrees(1.96 * profile.phi_se)
angle.plot(1e3 * profile.s, phi)
angle.fill_between(1e3 * profile.s, phi - band, phi + band, alpha=0.3, label="95 % interval")
angle.set(xlabel="arc length [mm]", ylabel="curve angle φ [°]")
angle.legend(loc="upper left")

# %%
# The tension at the distal end has the error that the angle gives it.
tendon = result.transmission
print(f"Φ = {phi[-1]:.1f} ± {np.degrees(profile.total_angle_se):.1f}°")
print(f"T_out = {tendon.tension_out:.3f} ± {tendon.tension_out_se:.3f} N")
