"""
Friction that drifts, followed from frame to frame
==================================================

The friction of a tendon rises by a quarter within two minutes. A filter follows it from what the load
cells read. In the second minute friction rises four times as fast as in the first, and the filter trails it.
"""

import matplotlib.pyplot as plt
import msgspec
import numpy as np

from tssgeom import Arcs, Frame, MovingRoute, Rig, process, simulate
from tssgeom.adapt.follower import Follower

RIG = """
[tendon]
pretension_N = 2.0
[adapt]
"friction.coefficient" = { sd = 0.015, hourly_change = 0.15 }
[sensors.tension_in_N]
noise = 0.02
[sensors.tension_out_N]
noise = 0.02
"""

DRIFT = """
[[effects]]
name = "friction_law"
over = "time"
x = [0.0, 60.0, 120.0]
factor = [1.0, 1.05, 1.25]
"""
rig = msgspec.toml.decode(RIG, type=Rig)
true = msgspec.toml.decode(RIG + DRIFT, type=Rig)
time = np.arange(0.0, 120.0, 0.2)
pull = 8.0 - 5.0 * np.cos(2 * np.pi * time / 8)  # N
run = simulate(time, MovingRoute(np.array([0.0]), [Arcs.exact([0.5], [np.pi])]), true, tension_in=pull)
noise = np.random.default_rng(2).normal(0.0, 0.02, (2, len(time)))
s = np.linspace(0.0, 0.5, 60)
points = np.column_stack((np.sin(2 * np.pi * s), 1 - np.cos(2 * np.pi * s), 0 * s)) / (2 * np.pi)
frames = [
    Frame(
        points, t, tension_in=pull[k] + noise[0, k], tension_out=run[k].transmission.tension_out + noise[1, k]
    )
    for k, t in enumerate(time)
]

known = [one.followed for one in process(frames, rig, tension_in=2.0, follower=Follower(rig))]
value = np.array([one.values[0] for one in known])
band = 1.96 * np.array([one.se[0] for one in known])
plt.plot(time, value, label="followed")
plt.fill_between(time, value - band, value + band, alpha=0.3, label="95 % band")
truth = 0.145 * np.interp(time, [0, 60, 120], [1.0, 1.05, 1.25])
plt.plot(time, truth, "k:", label="true")
plt.xlabel("time [s]")
plt.ylabel("coefficient of friction [1]")
plt.legend(loc="upper center")

# the band is that of friction that drifts as the rig states
held = np.abs(value - truth) <= band
print(f"the band holds the true value in {held[time < 60].mean():.0%} of the frames of the first minute,")
print(f"and in {held[time >= 60].mean():.0%} of those of the second")
