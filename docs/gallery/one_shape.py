"""
One shape, with its error bar
=============================

A shape-sensing fibre measures a colon-like route of 1.3 m. The curve angle grows along it; its standard
error grows too.
"""

# sphinx_gallery_thumbnail_number = 1
from pathlib import Path

import matplotlib.pyplot as plt

import tssgeom

SAMPLES = Path("sample_shapes")  # `tssgeom samples` writes them

result = tssgeom.analyse(SAMPLES / "colon_fibre.csv", tension_in=15.0)
figure, (angle, resolution) = plt.subplots(1, 2, figsize=(8, 3.2), layout="constrained")
result.plot(angle, "angle")
result.plot(resolution, "resolution")

# %%
# The tension at the distal end has the error that the angle gives it.
print(result)
