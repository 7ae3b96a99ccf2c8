"""Statistics that several parts use, each written once; the core has those of arrays."""

from __future__ import annotations

import math

import numpy as np

from tssgeom.core.constants import MEDIANS


def robust_sd(off: np.ndarray) -> float:
    """Return the standard deviation of deviations [n] by their median absolute value, whatever a few do."""
    return MEDIANS.sd_per_absolute * float(np.median(np.abs(off)))


def information_price(parameters: float, values: float) -> float:
    """Return what BIC, the Bayesian information criterion, adds to -2 ln likelihood for its parameters."""
    return parameters * math.log(values)
