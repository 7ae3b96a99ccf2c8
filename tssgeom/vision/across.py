"""The noise of a whole route of markers, from the covariance of each; docs/model.md (143)."""

from __future__ import annotations

import numpy as np

from tssgeom.arrays import Points


def noise_across(points: Points, covariance: np.ndarray) -> float | None:
    """Return the root mean square standard deviation of the points across the route [m].

    Parameters
    ----------
    points
        Positions in the order of the route, a row of NaN for a point not detected [n, 3] [m].
    covariance
        Of each position [n, 3, 3] [m²].

    Returns
    -------
    float or None
        None where fewer than two points were detected.
    """
    visible = np.isfinite(points).all(axis=1)
    if np.count_nonzero(visible) < 2:
        return None
    tangent = np.gradient(points[visible], axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    spread = covariance[visible]
    along = np.einsum("ni,nij,nj->n", tangent, spread, tangent)
    across = 0.5 * (np.trace(spread, axis1=1, axis2=2) - along)
    return float(np.sqrt(np.mean(across)))
