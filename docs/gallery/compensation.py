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

SHAPE = Path("sample_shapes/setup_a.csv")
time = np.linspace(0.0, 4.0, 121)
target = 0.004 - 0.002 * np.cos(2 * np.pi * time / 2)  # m
commands = compensate(SHAPE, {"time_s": time, "displacement_out_m": target})
without = simulate(SHAPE, {"time_s": time, "displacement_in_m": target})

figure, (drive, load) = plt.subplots(1, 2, figsize=(8, 3.4), layout="constrained")
commands.plot(drive, "drive")
drive.plot(time, 1e3 * target, "k:", label="target as the drive")
drive.set(title="What the drive does", ylim=(0, 13))
drive.legend(loc="upper right")
commands.plot(load)
reached = [moment.transmission.displacement_out for moment in without]
load.plot(time, 1e3 * np.array(reached), "C1", label="with the target as the drive")
load.legend(loc="upper right")
load.set_ylim(0, 10)

# %%
# Each command comes with the standard error of where the load will be.
worst = max(command.displacement_out_se for command in commands)
print(f"largest standard error of the load: {1e3 * worst:.3f} mm")
