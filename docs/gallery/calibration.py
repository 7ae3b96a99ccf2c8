"""
Calibration of friction and compliance
======================================

A slow pull and release on a half circle. Friction, compliance and the zeros of the sensors are fitted
together; the residuals are what the sensors' noise explains.
"""

from pathlib import Path

import matplotlib.pyplot as plt

from tssgeom import calibrate

FOLDER = Path("../../sample_shapes/campaign_clean")
fitted = calibrate(FOLDER / "half_slow.csv", FOLDER / "route_half_circle.csv", FOLDER / "rig.toml")
for name in ("friction", "compliance"):
    one = fitted.estimates[name]
    print(f"{name:10} {one.value:.4g} {one.unit}  95 %: {one.low:.4g} to {one.high:.4g}")

figure, axes = plt.subplots(2, 2, figsize=(8, 4.4), sharex=True, height_ratios=(2, 1))
for k, (name, factor, unit) in enumerate((("tension_out", 1.0, "T_out [N]"), ("elongation", 1e3, "δ [mm]"))):
    measured, model = factor * fitted.measured[name], factor * fitted.fitted[name]
    axes[0, k].plot(fitted.tension_in, measured, ".", color="0.6", label="measured")
    axes[0, k].plot(fitted.tension_in, model, label="fitted")
    axes[1, k].plot(fitted.tension_in, measured - model, ".", markersize=3)
    axes[0, k].set_ylabel(unit)
    axes[1, k].set(xlabel="T_in [N]", ylabel="residual")
axes[0, 0].legend()
