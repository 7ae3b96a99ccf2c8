"""
An added curve that scales perturbations down
=============================================

Theorem 3 of the paper: a loop before the route divides every perturbation of the distal end by exp(μβ),
and costs as much tension.
"""

import matplotlib.pyplot as plt
import numpy as np

from tssgeom import Arcs, Rig, compensate, pretensioned

friction = Rig().friction.coefficient
turns = np.linspace(0.0, 2.0, 21)
pulls = []
for turn in turns:
    beta = 2 * np.pi * turn
    route = Arcs.exact([0.5], [np.pi]) if turn == 0 else Arcs.exact([beta / 40, 0.5], [beta, np.pi])
    command = compensate(pretensioned(Rig()), route, Rig(), tension_out=5.0)
    pulls.append(command.tension_in)
figure, (scale, cost) = plt.subplots(1, 2, figsize=(8, 3.0))
scale.plot(turns, np.exp(-friction * 2 * np.pi * turns))
scale.set(xlabel="turns of the added loop [1]", ylabel="scaling factor S [1]", ylim=(0, 1))
cost.plot(turns, pulls)
_ = cost.set(
    xlabel="turns of the added loop [1]",
    ylabel=r"$T_\mathrm{in}$ for $T_\mathrm{out}$ = 5 N [N]",
    ylim=(0, None),
)
