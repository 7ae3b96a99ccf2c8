"""
Curvature with its band, and constant-curvature pieces
======================================================

Setup A of the paper is a half circle and then a loop, here as 200 points with 0.2 mm of noise. Two arcs
explain the points, so the route becomes two pieces.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import tssgeom

result = tssgeom.analyse(Path("sample_shapes/setup_a.csv"))
figure, (curvature, angle) = plt.subplots(1, 2, figsize=(8, 3.2), layout="constrained")
result.plot(curvature, "curvature")
result.plot(angle, "angle")

# %%
# Each piece has its angle with a standard error.
for k, (bend, error) in enumerate(zip(result.arcs.angle, result.arcs.angle_se, strict=True)):
    print(f"piece {k + 1}: {np.degrees(bend):.1f} ± {np.degrees(error):.1f}°")
