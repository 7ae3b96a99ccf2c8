"""
Two tendons on a pulley turn a joint
====================================

A motor winds one tendon up and lets the other out. Friction in the sheaths and 0.5 mm of slack make the
joint lag; the loop is wider where the sheaths bend more.
"""

import matplotlib.pyplot as plt
import msgspec
import numpy as np

from tssgeom import Arcs, Rig, simulate

RIG = """
[tendon]
pretension_N = 4.0
[drive]
kind = "pair"
radius_m = 0.01
slack_m = 0.5e-3
[end]
kind = "joint"
radius_m = 0.006
stiffness_Nm_per_rad = 0.05
"""
rig = msgspec.toml.decode(RIG, type=Rig)
time = np.linspace(0.0, 8.0, 241)
motor = 0.5 * np.sin(2 * np.pi * time / 4)  # rad
for degrees in (45, 180, 360):
    route = Arcs.exact([0.5], [np.radians(degrees)])
    run = simulate(route, {"time_s": time, "motor_angle_rad": motor}, rig)
    plt.plot(
        np.degrees(motor), np.degrees(run.channels["joint_angle_rad"]), label=f"sheaths bent by {degrees}°"
    )
plt.xlabel("angle of the motor [°]")
plt.ylabel("angle of the joint [°]")
plt.legend()
