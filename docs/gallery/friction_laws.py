"""
Friction that is not constant
=============================

A law multiplies the coefficient of friction by a factor over tension, speed or another quantity;
``discover`` writes such laws, and every command takes them.
"""

import matplotlib.pyplot as plt
import msgspec
import numpy as np

from tssgeom import Arcs, MovingRoute, Rig, simulate

LAWS = {
    "constant": "",
    "less friction under load": '[[effects]]\nname = "friction_law"\nover = "tension"\n'
    "x = [0.0, 5.0, 15.0]\nfactor = [1.4, 1.0, 0.8]",
    "more friction at speed": '[[effects]]\nname = "friction_law"\nover = "speed"\n'
    "x = [0.0, 0.001, 0.01]\nfactor = [1.0, 1.1, 1.4]",
}
route = MovingRoute(np.array([0.0]), [Arcs.exact([0.5], [2 * np.pi])])
time = np.linspace(0.0, 4.0, 121)
pull = np.interp(time, [0, 2, 4], [2, 15, 2])
for name, law in LAWS.items():
    rig = msgspec.toml.decode("[tendon]\npretension_N = 2.0\n" + law, type=Rig)
    run = simulate(time, route, rig, tension_in=pull)
    plt.plot(pull, [moment.transmission.tension_out for moment in run], label=name)
plt.xlabel(r"$T_\mathrm{in}$ [N]")
plt.ylabel(r"$T_\mathrm{out}$ [N]")
plt.legend()
