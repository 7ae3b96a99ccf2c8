"""
A route that moves while the tendon is pulled
=============================================

An endoscope is inserted over 20 s; its tendon is pulled and released again and again. The same pull
arrives weaker as the route bends more.
"""

from pathlib import Path

import matplotlib.pyplot as plt

from tssgeom import analyse_all

result = analyse_all(Path("sample_shapes/insertion.jsonl"))
print(result)

figure, (bends, forces) = plt.subplots(2, 1, figsize=(7, 4.6), sharex=True, layout="constrained")
result.plot(bends, "angle")
result.plot(forces, "tension")
bends.set_xlabel("")
forces.set_ylim(0, 21)
forces.legend(loc="upper right", ncols=2)
