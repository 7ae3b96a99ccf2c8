"""
Compensation of a move
======================

The load is to follow a sine. A drive that makes the same sine falls short and lags; the computed command
does not. The model plays the tendon in both cases.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from tssgeom import compensate, simulate

SHAPE = Path("../../sample_shapes/setup_a.csv")
time = np.linspace(0.0, 4.0, 121)
target = 0.004 - 0.002 * np.cos(2 * np.pi * time / 2)  # m
commands = compensate(SHAPE, {"time_s": time, "displacement_out_m": target})
drives = {
    "target as the drive": target,
    "compensated": np.array([command.displacement_in for command in commands]),
}

figure, axes = plt.subplots(1, 2, figsize=(8, 3.2), sharey=True)
for colour, (name, drive) in zip(("C1", "C0"), drives.items(), strict=True):
    run = simulate(SHAPE, {"time_s": time, "displacement_in_m": drive})
    load = np.array([moment.transmission.displacement_out for moment in run])
    axes[0].plot(time, 1e3 * drive, colour, label=name)
    axes[1].plot(time, 1e3 * load, colour, label=name)
axes[1].plot(time, 1e3 * target, "k:", label="target")
axes[0].set(xlabel="time [s]", ylabel="displacement [mm]", title="drive")
axes[1].set(xlabel="time [s]", title="load")
axes[0].legend(loc="upper right", fontsize="small")
axes[1].legend(loc="upper right", fontsize="small")

# %%
# Each command comes with the standard error of where the load will be.
worst = max(command.displacement_out_se for command in commands)
print(f"largest standard error of the load: {1e3 * worst:.3f} mm")
