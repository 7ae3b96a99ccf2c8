"""Shorthand from points to geometry."""

import numpy as np
import pytest

from tssgeom.route.curvature import CurvatureProfile
from tssgeom.route.observations import clean
from tssgeom.route.pieces import Arcs, smooth_geometry
from tssgeom.route.spline.fit import fit
from tssgeom.route.spline.spline import Spline
from tssgeom.route.synthetic import Course, positions


@pytest.fixture
def sensed():
    """Points of a course at even stations, with noise [m]."""

    def make(course: Course, n: int, noise: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
        s = np.linspace(0.0, course.total_length, n)
        return positions(course, s) + noise * np.random.default_rng(seed).standard_normal((n, 3)), s

    return make


@pytest.fixture
def geometry():
    """Spline, profile and pieces of sensed points."""

    def make(points, stations=None, noise=None) -> tuple[Spline, CurvatureProfile, Arcs]:
        spline = fit(clean(points, stations), noise)
        return spline, *smooth_geometry(spline)

    return make
