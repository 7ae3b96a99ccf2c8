"""What the angles of a route may be off: steps of one standard deviation; docs/model.md (101), (115)."""

from __future__ import annotations

import math

import numpy as np

from tssgeom.arrays import Matrix, Vector
from tssgeom.route.pieces import Arcs


def main_directions(arcs: Arcs, most: int) -> list[Vector]:
    """Return at most so many steps of the angles that differ by the points, the widest first [rad].

    Without that of a form which no point shows: all runs on a route share it, as they do its friction.
    """
    k = len(arcs.length)
    return _widest(arcs.covariance_without_form[k:, k:])[:most]


def other_directions(arcs: Arcs, most: int) -> list[Vector]:
    """Return the steps that `main_directions` leaves of the covariance, that of the form with them [rad]."""
    k = len(arcs.length)
    main = np.column_stack([np.zeros((k, 0)), *main_directions(arcs, most)])
    return _widest(arcs.covariance[k:, k:] - main @ main.T)


def _widest(covariance: Matrix) -> list[Vector]:
    value, way = np.linalg.eigh(covariance)
    return [math.sqrt(value[i]) * way[:, i] for i in np.argsort(value)[::-1] if value[i] > 1e-9]
