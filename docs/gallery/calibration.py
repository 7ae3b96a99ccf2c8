"""
Calibration of friction and compliance
======================================

A slow pull and release on a half circle. Friction, compliance and the zeros of the sensors are fitted
together; the residuals are what the sensors' noise explains.
"""

from pathlib import Path

import matplotlib.pyplot as plt

from tssgeom import calibrate

FOLDER = Path("sample_shapes/campaign_clean")
fitted = calibrate(FOLDER / "half_slow.csv", FOLDER / "route_half_circle.csv", FOLDER / "rig.toml")
print(fitted)

figure, axes = plt.subplots(2, 2, figsize=(8, 4.8), height_ratios=(2, 1), layout="constrained")
for k, channel in enumerate(("tension_out", "elongation")):
    fitted.plot(axes[0, k], f"{channel}_loop")
    fitted.plot(axes[1, k], f"{channel}_residual")
    axes[1, k].set_title("")
axes[0, 0].legend()
