"""
A route that moves while the tendon is pulled
=============================================

An endoscope is inserted over 20 s; its tendon is pulled and released again and again. The same pull
arrives weaker as the route bends more.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from tssgeom import Rejected, Rig, process, read

frames = read(Path("../../sample_shapes/insertion.jsonl"))
results = [one for one in process(frames, Rig(), tension_in=15.0) if not isinstance(one, Rejected)]
time = np.array([one.frame.time for one in results])
angle = np.degrees([one.profile.total_angle for one in results])
band = np.degrees([1.96 * one.profile.total_angle_se for one in results])
ends = [one.transmission for one in results]

figure, (bends, forces) = plt.subplots(2, 1, figsize=(7, 4.4), sharex=True)
bends.plot(time, angle)
bends.fill_between(time, angle - band, angle + band, alpha=0.3, label="95 % interval")
bends.set(ylabel="curve angle Φ [°]")
bends.legend(loc="lower right")
forces.plot(time, [end.tension_in for end in ends], color="0.6", label="T_in")
forces.plot(time, [end.tension_out for end in ends], label="T_out")
forces.set(xlabel="time [s]", ylabel="tension [N]", xlim=(0, 20))
forces.legend(loc="upper right", ncols=2)
forces.set_ylim(0, 19)
