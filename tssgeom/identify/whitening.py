"""Residuals against what the sensors explain: shared errors are solved for, the rest is counted.

Source: docs/model.md (103), (104).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from tssgeom.arrays import Matrix, Vector
from tssgeom.identify.noise_model import Errors


@dataclass(frozen=True, slots=True)
class Weighing:
    """Projects residuals off the shared errors, each held by its prior."""

    sigma: Vector
    """[rows]"""
    basis: Matrix
    """[rows + k, k] Orthonormal: the shared errors above their priors."""
    triangle: Matrix
    """[k, k]"""

    def weighed(self, residual: np.ndarray) -> np.ndarray:
        """Return residuals [rows] or [rows, c], [N, m], as [rows + k (, c)] whose squares add to χ²."""
        told = (residual.T / self.sigma).T
        rows, k = self.basis.shape[0] - self.basis.shape[1], self.basis.shape[1]
        own = self.basis[:rows].T @ told
        out = np.concatenate([told, np.zeros((k, *told.shape[1:]))])
        return out - self.basis @ own

    def shared(self, residual: Vector) -> Vector:
        """Return the shared errors that a residual speaks for, in standard deviations [k]."""
        rows = self.basis.shape[0] - self.basis.shape[1]
        own = self.basis[:rows].T @ (residual / self.sigma)
        return solve_triangular(self.triangle, own)


def weighing(errors: Errors) -> Weighing:
    """Prepare the projection."""
    k = errors.modes.shape[1]
    basis, triangle = np.linalg.qr(np.vstack([errors.modes, np.eye(k)]))
    return Weighing(errors.sigma, basis, triangle)
