"""
What the model lacks: a bend that no sensor measures
====================================================

Five measured runs disagree with the calibrated model. ``discover`` names the cause, a hidden bend of 0.6
rad at 0.21 m, and the misfit on the run that was held out falls to the noise.
"""

from pathlib import Path

import matplotlib.pyplot as plt

from tssgeom import discover

finding = discover(Path("sample_shapes/campaign_hidden_bend"))
print(finding.sentence)

figure, (ranking, left) = plt.subplots(2, 1, figsize=(8, 5.2), layout="constrained", height_ratios=(3, 2))
finding.plot(ranking)
finding.plot(left, "tension_in_N_residual")
left.legend(loc="lower right", ncols=3)
