"""
Tension along the route
=======================

The tension falls where the sheath bends, and stays where it is straight. Colours are those of the viewer:
viridis.
"""

from pathlib import Path

import matplotlib.pyplot as plt

import tssgeom

result = tssgeom.analyse(Path("sample_shapes/colon_fibre.csv"), tension_in=15.0)
figure, (route, along) = plt.subplots(1, 2, figsize=(8, 3.4), layout="constrained")
result.plot(route, "route")
result.plot(along, "tension")
