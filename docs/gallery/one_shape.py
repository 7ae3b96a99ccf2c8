"""
One shape with its error bars
=============================

Text.
"""

import matplotlib.pyplot as plt

plt.plot([1, 2])
