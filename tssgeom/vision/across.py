"""The noise of a whole route of markers, from the covariance of each; docs/model.md (143)."""

from __future__ import annotations

import numpy as np

from tssgeom.arrays import Points


def noise_across(points: Points, covariance: np.ndarray) -> float | None:
    """Return the root mean square standard deviation of the points across the route [m].

    Parameters
    ----------
    points
        Places in the order of the route, a row of NaN for one not seen [n, 3] [m].
    covariance
        Of each place [n, 3, 3] [m²].

    Returns
    -------
    float or None
        None where fewer than two points were seen.
    """
    seen = np.isfinite(points).all(axis=1)
    if np.count_nonzero(seen) < 2:
        return None
    tangent = np.gradient(points[seen], axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    spread = covariance[seen]
    along = np.einsum("ni,nij,nj->n", tangent, spread, tangent)
    across = 0.5 * (np.trace(spread, axis1=1, axis2=2) - along)
    return float(np.sqrt(np.mean(across)))
